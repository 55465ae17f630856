"""Grey of colour in one pass and without other threads for small images; reference: feature_detector.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import in_bands, installed, kernel, read_only

if installed:
    from rvc_features.kernels.colour_instructions import PIXELS, blues_and_greens, bytes_of_sums, reds
    from rvc_features.kernels.vectors import load, products_of_pairs, store
    _bytes = bytes_of_sums(1 << 14, 15)

# OpenCV's, of 2^15: of blue and green, and of red, for pixel after pixel.
_BLUE_GREEN, _RED = np.array([3735, 19235] * 8, np.int16), np.array([9798, 0] * 8, np.int16)


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
    vectors = max(0, (len(out) - 2) // PIXELS)   # as more is read than they have
    for i in range(0, PIXELS * vectors, PIXELS):
        at = 3 * i
        store(out, i, _bytes(_weighed(pixels, at), _weighed(pixels, at + 24), _weighed(pixels, at + 48),
                             _weighed(pixels, at + 72)))
    for i in range(PIXELS * vectors, len(out)):
        blue, green, red = np.int32(pixels[3 * i]), np.int32(pixels[3 * i + 1]), np.int32(pixels[3 * i + 2])
        weighed = np.int32(3735) * blue + np.int32(19235) * green + np.int32(9798) * red
        out[i] = (weighed + np.int32(16384)) >> np.int32(15)


@kernel
def _weighed(pixels, at):
    return (products_of_pairs(blues_and_greens(pixels, at), load(_BLUE_GREEN, 0))
            + products_of_pairs(reds(pixels, at), load(_RED, 0)))
