"""Pictures to measure on: OpenCV's documentation examples where they are installed, else generated ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

_EXAMPLES = Path('/usr/share/doc/opencv-doc/examples/data')   # Debian's package opencv-doc
_NAMES = ('graf1.png', 'left01.jpg', 'aloeL.jpg', 'home.jpg')


def source() -> str:
    """In words, where the pictures come from."""
    names = [path.name for path in _installed()]
    if names:
        return f'{", ".join(names)} of the package opencv-doc, resized'
    return 'generated pictures (the package opencv-doc is not installed)'


def pictures(size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Grey pictures of that width and height by name; the same at every call."""
    installed = {path.name: cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in _installed()}
    if installed:
        return {name: cv2.resize(image, size, interpolation=cv2.INTER_CUBIC) for name, image in installed.items()}
    return {f'generated {seed}': _generated(size, seed) for seed in range(3)}


def picture(size: tuple[int, int]) -> np.ndarray:
    """The first of them."""
    return next(iter(pictures(size).values()))


def _installed() -> list[Path]:
    return [_EXAMPLES / name for name in _NAMES if (_EXAMPLES / name).is_file()]


def _generated(size: tuple[int, int], seed: int) -> np.ndarray:
    """Noise with the spectrum of natural images (amplitude 1 / frequency), and polygons with sharp corners."""
    width, height = size
    random = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None] * height, np.fft.rfftfreq(width) * width)
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(random.normal(0, 1, (height, width))) / frequency
    noise = np.fft.irfft2(spectrum, s=(height, width))
    image = 128 + 40 * noise / noise.std()
    for _ in range(60):
        corners = random.uniform((0, 0), size, 2) + random.normal(0, width / 20, (random.integers(3, 6), 2))
        cv2.fillPoly(image, [corners.astype(np.int32)], float(random.uniform(0, 255)))
    return np.clip(image, 0, 255).astype(np.uint8)
