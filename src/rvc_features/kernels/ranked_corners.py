"""Local maxima ranked by their rise beside the contrast round them, in one pass; reference: ranked_corners.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import in_bands, kernel, read_only
from rvc_features.kernels.contrast import between
from rvc_features.kernels.maxima import BLOCK_BITS, maxima_of_row, most_maxima, rise_at

BLOCK = 1 << BLOCK_BITS
LEAST_ENERGY = 1e-12   # squared grey values per pixel: what counts at the least, not to divide by zero
_LITTLE_LESS = 1 - 1e-5   # times a bound: what single precision may take away from what is compared with it
_NO_MASK = np.empty((0, 0), np.uint8)


def ranked_corners(strength: np.ndarray, minimum: float, border: int, mask: np.ndarray | None,
                   averages: list[np.ndarray], sides: tuple[int, ...], lowest: np.ndarray, evenness: float,
                   least_of_energy: float, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners in reading order, x, y and rank; reference: `ranked_corners.reference_ranked_corners`.

    Parameters
    ----------
    strength, minimum, border, mask, evenness, least_of_energy, share
        As there.
    averages : list of two ndarray, float32
        Energies under either Gaussian, of squares.
    sides : tuple of two int
        Pixels to a side of these.
    lowest : ndarray, float32
        For each block of BLOCK by BLOCK pixels what no energy in it is below, nor in the half of a block after it.
    """
    strength, near, far = (np.ascontiguousarray(each) for each in (strength, *averages))
    mask = read_only(_NO_MASK if mask is None else mask)
    found = in_bands(lambda first, last: _ranked_corners(strength, minimum, border, mask, near, far, sides, lowest,
                                                         evenness, least_of_energy, share, first, last),
                     *strength.shape)
    return found[0] if len(found) == 1 else tuple(np.concatenate(parts) for parts in zip(*found))


@kernel
def _ranked_corners(strength, minimum, border, mask, near, far, sides, lowest, evenness, least_of_energy, share, first,
                    last):
    """Those in the rows from `first` to before `last`.

    What passes is not known before the end, but more of it with each corner: the best rank so far gives a rank, that
    and the least energy round there a strength, which what is looked at must exceed.
    """
    height, width = strength.shape
    first, last, left, right = max(first, border), min(last, height - border), border, width - border
    capacity = most_maxima(max(last - first, 0), max(right - left, 0))
    found_x, found_y, ranks = np.empty(capacity, np.int64), np.empty(capacity, np.int64), np.empty(capacity, np.float32)
    least = np.empty(lowest.shape[1], np.float32)
    best, count = 0.0, 0
    for y in range(first, last if left < right else first):
        if y == first or y % BLOCK == 0:
            for i in range(len(least)):
                floor = np.float64(lowest[y >> BLOCK_BITS, i])
                bound = max(least_of_energy * floor, best * share * floor ** evenness)
                least[i] = max(minimum, bound * _LITTLE_LESS)
        end = maxima_of_row(strength, y, left, right, minimum, least, found_x, count)
        for i in range(count, end):
            x = found_x[i]
            if len(mask) > 0 and mask[y, x] == 0:
                continue
            energy = max(_energy(near, far, x, y, sides), LEAST_ENERGY)
            value = np.float64(strength[y, x])
            if value < least_of_energy * energy:
                continue
            rank = np.float32(rise_at(strength, x, y) / energy ** evenness)   # at most the value's
            if rank > best * share * _LITTLE_LESS:
                found_x[count], found_y[count], ranks[count] = x, y, rank
                best = max(best, float(rank))
                count += 1
    return found_x[:count].copy(), found_y[:count].copy(), ranks[:count].copy()


@kernel
def _energy(near, far, x, y, sides):
    """The geometric mean of both averages, at a pixel."""
    return np.sqrt(between(near, (x + 0.5) / sides[0] - 0.5, (y + 0.5) / sides[0] - 0.5)
                   * between(far, (x + 0.5) / sides[1] - 0.5, (y + 0.5) / sides[1] - 0.5))
