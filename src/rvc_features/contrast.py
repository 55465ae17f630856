"""How much contrast an image has, and where: its noise, and the energy of its gradients round points.

Both scale with the image: `noise` with the gain, `local_energy` with the gain squared.
"""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features.kernels import compiler
from rvc_features.kernels import contrast as compiled
from rvc_features.response import BORDER

RUN = 64           # pixels of a row that one estimate of the noise is averaged over
QUIET = 0.2        # share of the runs that are less noisy than what counts as the image's noise
SIGMAS = 16, 64    # pixels: widths of the two neighbourhoods whose energies are averaged
SIDE = 8           # pixels: of the squares that the narrower one is computed on
FACTORS = tuple(sigma // SIGMAS[0] for sigma in SIGMAS)
SIDES = tuple(factor * SIDE for factor in FACTORS)
WEIGHTS = cv2.getGaussianKernel(17, SIGMAS[0] / SIDE, cv2.CV_32F).ravel()[8:]   # of squares, from the centre outwards


def noise(image: np.ndarray) -> float:
    """Standard deviation of the white noise in an image, in grey values.

    The mask [1 -2 1]^T [1 -2 1] answers to noise, and hardly to what is in the picture. The mean of its magnitude over
    runs of 64 pixels, in every eighth row, is least where the picture is smooth; a fifth of the runs lie below what
    is taken.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)

    Returns
    -------
    float
        0 for images less than five pixels high.

    References
    ----------
    J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64(2), 1996.
    """
    run = min(RUN, image.shape[1])
    vectors = compiler.available() and run == RUN
    magnitudes = (compiled.noise_of_runs if vectors else reference_noise_of_runs)(image, run)
    # The mean magnitude of a normal variable is sqrt(2 / pi), and the mask multiplies noise by 6.
    return _quiet(magnitudes) * float(np.sqrt(np.pi / 2)) / 6


def where_quiet(values: np.ndarray) -> float:
    """Mean of `values` over such runs of every eighth row, of the run that a fifth of them lie below; 0 without any."""
    return _quiet(_means_of_runs(values[4:-4:8], min(RUN, values.shape[1])))


def _quiet(means: np.ndarray) -> float:
    """What a fifth of the means of runs lie below; 0 where there are none."""
    quiet = int(QUIET * (len(means) - 1))
    return float(np.partition(means, quiet)[quiet]) if len(means) > 0 else 0.0


def local_energy(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Energy of the gradients round points: how much contrast the neighbourhood has.

    The squared gradient, by Sobel's masks over 8, of every second row is averaged with Gaussians of sigma 16 and 64
    pixels; the energy is the geometric mean of the two. It is computed on squares of sigma / 2 and read bilinearly
    between their centres.

    Parameters
    ----------
    image : ndarray, uint8 or float32, shape (H, W)
    x, y : ndarray of float or int, shape (N,)
        Positions in pixels of that image.

    Returns
    -------
    ndarray, float64, shape (N,)
        In squared grey values per squared pixel.
    """
    x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
    near, far = (between(average, (x + 0.5) / side - 0.5, (y + 0.5) / side - 0.5)
                 for average, side in zip(averages(image), SIDES))
    return np.sqrt(near * far)


def averages(image: np.ndarray) -> list[np.ndarray]:
    """Energies, float32, of squares of either of SIDES pixels, each under a Gaussian of two of them."""
    vectors = compiler.available() and image.shape[1] >= compiler.LEAST_WIDTH
    sums = (compiled.energy_of_cells if vectors else reference_energy_of_cells)(image, SIDE)
    if compiler.available():
        return [compiled.averages(sums, *image.shape, SIDE, factor, WEIGHTS) for factor in FACTORS]
    return reference_averages(sums, image.shape)


def reference_averages(sums: np.ndarray, shape: tuple[int, ...]) -> list[np.ndarray]:
    """`averages` of an image of that shape out of the sums over its squares."""
    return [cv2.GaussianBlur(_means_of_cells(sums, factor, SIDE, shape), (0, 0), SIGMAS[0] / SIDE, borderType=BORDER)
            for factor in FACTORS]


def between(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`values` between the pixels, bilinearly, float64; beyond the rim the nearest pixel counts."""
    return (compiled.bilinear if compiler.available() else reference_bilinear)(values, x, y)


def _means_of_cells(sums: np.ndarray, factor: int, side: int, shape: tuple[int, ...]) -> np.ndarray:
    """Means, float32, in squares of `factor` by `factor` cells; squares at the rim may be cut off."""
    starts = [np.arange(0, cells, factor) for cells in sums.shape]
    counted = (np.arange(shape[0]) % 2 == 0).astype(np.int64), np.ones(shape[1], np.int64)
    pixels = [np.add.reduceat(count, start * side) for count, start in zip(counted, starts)]
    if factor > 1:
        sums = np.add.reduceat(np.add.reduceat(sums, starts[0], axis=0), starts[1], axis=1)
    return (sums / np.outer(*pixels)).astype(np.float32)


def reference_energy_of_cells(image: np.ndarray, side: int) -> np.ndarray:
    """Sums, float64, of the squared gradient of every second row over squares of `side` pixels, an even number.

    Squares at the right and below may be cut off.
    """
    image = image.astype(np.float64)
    gradient_x = cv2.Sobel(image, -1, 1, 0, ksize=3, scale=1 / 8, borderType=BORDER)
    gradient_y = cv2.Sobel(image, -1, 0, 1, ksize=3, scale=1 / 8, borderType=BORDER)
    energy = gradient_x * gradient_x + gradient_y * gradient_y
    energy[1::2] = 0
    rows, columns = (np.arange(0, length, side) for length in image.shape)
    return np.add.reduceat(np.add.reduceat(energy, rows, axis=0), columns, axis=1)


def reference_noise_of_runs(image: np.ndarray, run: int) -> np.ndarray:
    """Mean magnitude of the noise mask's response over runs of pixels of every eighth row, float64."""
    mask = np.array([1.0, -2, 1])
    magnitude = np.abs(cv2.sepFilter2D(image.astype(np.float64), -1, mask, mask, borderType=BORDER))[2:-2:8]
    return _means_of_runs(magnitude, run)


def _means_of_runs(magnitude: np.ndarray, run: int) -> np.ndarray:
    """Means over runs of pixels of each row, one after the other; what is left at the end of a row does not count."""
    return magnitude[:, :magnitude.shape[1] // run * run].reshape(-1, run).mean(axis=1)


def reference_bilinear(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`between` for all positions at once."""
    height, width = values.shape
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    u, v = x - left, y - top
    values = values.astype(np.float64)
    above = values[top, left] * (1 - u) + values[top, right] * u
    below = values[bottom, left] * (1 - u) + values[bottom, right] * u
    return above * (1 - v) + below * v
