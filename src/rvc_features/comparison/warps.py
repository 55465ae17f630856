"""One photograph under known changes, for when there is no data with ground truth.

Both images of a pair are drawn from the photograph itself, at 1 / SHRINK of its size and with 2x2 samples to the pixel,
so that neither is a resampled copy of the other: a warped copy would be smoother than its original, and favour
detectors that smooth. What lies beyond the photograph is mirrored, which makes no edges that are not there.
"""

from __future__ import annotations

import math
import os
from typing import Callable, Iterator

import cv2
import numpy as np

from rvc_features.comparison.homographies import oriented, project

SHRINK = 1.5
IDENTITY_CROP = 37, 23   # pixels left and above that the second image lacks where nothing moves (see datasets)

ROTATIONS = (5, 15, 30, 45, 60, 90, 135, 180)          # degrees
ZOOMS = (0.5, 0.63, 0.8, 1.25, 1.5)                    # factor; above 1: nearer
TILTS = (15, 30, 45, 60)                               # degrees between camera and normal of the picture
BLURS = (0.5, 1, 1.5, 2, 3)                            # standard deviation in pixels
NOISES = (2, 5, 10, 20)                                # standard deviation in grey values
JPEGS = (90, 50, 25, 10, 5)                            # quality
LIGHTS = (0.25, 0.5, 0.75, 1.5, 2.0)                   # factor on the grey values, which saturate

# Title, unit of the change, amounts.
KINDS: dict[str, tuple[str, tuple[float, ...]]] = {
    'rotation': ('degrees', ROTATIONS), 'zoom': ('factor', ZOOMS), 'tilt': ('degrees', TILTS),
    'blur': ('px, sigma', BLURS), 'noise': ('grey values, sigma', NOISES), 'jpeg': ('quality', JPEGS),
    'light': ('factor', LIGHTS)}

OPENCV_EXAMPLES = '/usr/share/doc/opencv-doc/examples/data', '/usr/share/doc/opencv-doc/examples'


def default_photograph() -> str | None:
    """A photograph that comes with Debian's and Ubuntu's opencv-doc; None where that isn't installed."""
    return opencv_example('building.jpg')


def opencv_example(name: str) -> str | None:
    """Path of a file among OpenCV's examples, as Debian and Ubuntu install them; None where it isn't there."""
    paths = (os.path.join(folder, name) for folder in OPENCV_EXAMPLES)
    return next((path for path in paths if os.path.isfile(path)), None)


def generated_photograph(seed: int = 1) -> np.ndarray:
    """A picture to fall back on: polygons and discs of many sizes over a soft texture, uint8 (900, 1200)."""
    generator = np.random.default_rng(seed)
    height, width = 900, 1200
    picture = np.zeros((height, width), np.float32)
    for side in (8, 30, 120):
        coarse = generator.normal(0, 12, (height // side + 2, width // side + 2)).astype(np.float32)
        picture += np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
    picture += 128
    for _ in range(260):
        centre = generator.random(2) * (width, height)
        radius = 8 * 12 ** generator.random()
        if generator.random() < 0.2:
            middle = int(16 * centre[0]), int(16 * centre[1])
            cv2.circle(picture, middle, int(16 * radius), (float(generator.integers(20, 236)),), -1, cv2.LINE_AA, 4)
            continue
        angles = np.sort(generator.random(generator.integers(3, 7))) * 2 * math.pi
        corners = centre + radius * np.column_stack((np.cos(angles), np.sin(angles)))
        cv2.fillPoly(picture, [np.rint(16 * corners).astype(np.int32)], [float(generator.integers(20, 236))],
                     cv2.LINE_AA, 4)
    picture += generator.normal(0, 2, picture.shape).astype(np.float32)
    return np.rint(picture.clip(0, 255)).astype(np.uint8)


def reference(photograph: np.ndarray) -> np.ndarray:
    """The first image of every pair: the photograph at 1 / SHRINK of its size."""
    return _drawn(photograph, np.eye(3), _reference_shape(photograph))


def warped(photograph: np.ndarray, kind: str, amount: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The second image of a pair, and the homography from `reference(photograph)` to it.

    Parameters
    ----------
    photograph : ndarray, uint8, shape (H, W)
    kind : one of KINDS
    amount : float
        In the unit that KINDS gives.
    seed : int
        Of the noise.
    """
    shape = _reference_shape(photograph)
    if kind in _GEOMETRY:
        homography = _GEOMETRY[kind](amount, shape)
        return _drawn(photograph, homography, shape), homography
    changed = _APPEARANCE[kind](reference(photograph), amount, np.random.default_rng([seed, int(amount * 1000)]))
    x, y = min(IDENTITY_CROP[0], shape[1] // 4), min(IDENTITY_CROP[1], shape[0] // 4)
    return np.ascontiguousarray(changed[y:, x:]), shift(-x, -y)


def all_changes() -> Iterator[tuple[str, float]]:
    """Each kind with each of its amounts."""
    for kind, (_, amounts) in KINDS.items():
        for amount in amounts:
            yield kind, amount


def shift(x: float, y: float) -> np.ndarray:
    """Homography that moves everything by (x, y)."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1]], np.float64)


def _reference_shape(photograph: np.ndarray) -> tuple[int, int]:
    return int(photograph.shape[0] / SHRINK), int(photograph.shape[1] / SHRINK)


def _drawn(photograph: np.ndarray, homography: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The reference's scene under a homography, drawn from the photograph with 2x2 samples to the pixel."""
    # Centres of pixels: reference x is photograph SHRINK x + (SHRINK - 1) / 2, a sample s is pixel s / 2 - 1 / 4.
    offset = (SHRINK - 1) / 2
    to_photograph = np.array([[SHRINK, 0, offset], [0, SHRINK, offset], [0, 0, 1]])
    from_samples = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    sample_to_photograph = to_photograph @ np.linalg.inv(homography) @ from_samples
    source = photograph
    spacing = _spacing(sample_to_photograph, shape)
    if spacing > 1:
        # Fewer than one sample to the photograph's pixel: smooth away first what the samples would fold into patterns.
        source = cv2.GaussianBlur(photograph, (0, 0), 0.5 * math.sqrt(spacing ** 2 - 1))
    samples = cv2.warpPerspective(source, sample_to_photograph, (2 * shape[1], 2 * shape[0]),
                                  flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT_101)
    return cv2.resize(samples, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)


def _spacing(sample_to_photograph: np.ndarray, shape: tuple[int, int]) -> float:
    """Pixels of the photograph from one sample to the next, in the middle; the geometric mean of the directions."""
    height, width = shape   # the middle of twice as many samples
    near = np.array([(width, height), (width + 1, height), (width, height + 1)])
    origin, right, below = project(oriented(sample_to_photograph, (2 * height, 2 * width)), near)
    return math.sqrt(abs(np.linalg.det(np.array([right - origin, below - origin]))))


def _about_centre(matrix: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    x, y = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    return shift(x, y) @ matrix @ shift(-x, -y)


def _rotation(degrees: float, shape: tuple[int, int]) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return _about_centre(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), shape)


def _zoom(factor: float, shape: tuple[int, int]) -> np.ndarray:
    return _about_centre(np.diag([factor, factor, 1]), shape)


def _tilt(degrees: float, shape: tuple[int, int]) -> np.ndarray:
    """A camera that looks at the picture's centre from the side, as far away as twice its width."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return _about_centre(np.array([[c, 0, 0], [0, 1, 0], [s / (2 * shape[1]), 0, 1]]), shape)


def _blur(image: np.ndarray, sigma: float, generator: np.random.Generator) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma)


def _noise(image: np.ndarray, sigma: float, generator: np.random.Generator) -> np.ndarray:
    return np.rint((image + generator.normal(0, sigma, image.shape)).clip(0, 255)).astype(np.uint8)


def _jpeg(image: np.ndarray, quality: float, generator: np.random.Generator) -> np.ndarray:
    _, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))


def _light(image: np.ndarray, factor: float, generator: np.random.Generator) -> np.ndarray:
    return np.rint((image * float(factor)).clip(0, 255)).astype(np.uint8)


_GEOMETRY: dict[str, Callable[[float, tuple[int, int]], np.ndarray]] = {
    'rotation': _rotation, 'zoom': _zoom, 'tilt': _tilt}
_APPEARANCE: dict[str, Callable[[np.ndarray, float, np.random.Generator], np.ndarray]] = {
    'blur': _blur, 'noise': _noise, 'jpeg': _jpeg, 'light': _light}
