"""Grey of colour in one pass and without other threads for small images; reference: feature_detector.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import in_bands, kernel, read_only


def grey_of_colour(image: np.ndarray) -> np.ndarray:
    """The grey image of a BGR one; reference: `feature_detector.grey_of_colour`."""
    height, width = image.shape[:2]
    pixels, grey = read_only(image).reshape(-1), np.empty((height, width), np.uint8)
    out = grey.reshape(-1)
    in_bands(lambda first, last: _grey_of_colour(pixels[3 * first * width:], out[first * width:last * width]),
             height, width)
    return grey


@kernel
def _grey_of_colour(pixels, out):
    # OpenCV's weights and rounding. A loop this plain becomes vectors on its own, with every third byte of a load; from
    # another beginning than 0 it does not, for indices might be negative.
    for i in range(len(out)):
        blue, green, red = np.int32(pixels[3 * i]), np.int32(pixels[3 * i + 1]), np.int32(pixels[3 * i + 2])
        weighed = np.int32(3735) * blue + np.int32(19235) * green + np.int32(9798) * red
        out[i] = (weighed + np.int32(16384)) >> np.int32(15)
