"""The points with the largest suppression radii, without a look at most of the others; reference: filters.py.

What decides is one radius r that at least as many points reach as are wanted. Cells of a grid, much smaller than r,
know their strongest point. A point with a significantly stronger one in the cells round its own, all of which lies
within r, can't be among the wanted ones; most fall so, unsorted, by one look at the grid. For the few others the
nearest stronger point is sought in the grid. If enough of them reach r, the guess was right and the result is exact; if
not, a smaller r is tried. Where points cluster tightly the guesses fail soon, or the search looks at too many points:
then None says so, and the tree of suppression.py, which nothing unbalances, has to do it.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import installed, kernel

if installed:
    from rvc_features.kernels.vectors import LANES, load, lowest_bit, maximum, splat, store, where_not_less

_FINENESS = 2.83   # cells to the radius that is tried first, at the most: so that all round a point's own lie within it
_ATTEMPTS = 8
_PATIENCE = 20   # how many points the search may look at for each that there is


def reach_largest_radius(points: np.ndarray, responses: np.ndarray, robustness: float,
                         count: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Points among which are the `count` of largest suppression radius, and their radii.

    The largest of what has the reference: `filters.reference_radii`. The points may come in any order here.

    Parameters
    ----------
    points : ndarray, float64, shape (N, 2)
    responses : ndarray, float64, shape (N,)
    robustness : float
    count : int

    Returns
    -------
    ndarray of int64 and ndarray of float64, both of shape (M,), or None
        Indices in rising order and radii, at least `count`; None where the points do not lend themselves to it.
    """
    if not 0 < 2 * count <= len(points):
        return None
    chosen, radii = _reach_largest_radius(points, responses, float(robustness), count)
    return (chosen, radii) if len(chosen) > 0 else None


@kernel
def _reach_largest_radius(points, responses, robustness, count):
    size = len(points)
    nobody = np.empty(0, np.int64), np.empty(0, np.float64)
    left, top, right, bottom, strongest = np.inf, np.inf, -np.inf, -np.inf, -np.inf
    # Point j suppresses point i if and only if its power is greater than the response of i.
    power = np.empty(size, np.float64)
    for i in range(size):
        x, y = points[i, 0], points[i, 1]
        left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
        power[i] = min(responses[i], robustness * responses[i])
        strongest = max(strongest, power[i])
    area = _occupied(points, left, top, right, bottom) * (right - left) * (bottom - top)
    # Of points strewn evenly over the area, in any order of response, `count` have a radius of 0.6 of the root or more.
    wanted = 0.55 * np.sqrt(area / count)
    side = max(wanted / _FINENESS, np.sqrt((right - left) * (bottom - top) / (40 * count + 2 * size)))
    per_pixel = 1 / side
    if not 1e-100 < side < 1e100:
        return nobody
    columns, rows = np.int64((right - left) * per_pixel) + 1, np.int64((bottom - top) * per_pixel) + 1
    if columns * rows > 200 * count + 4 * size + 1000:   # a thin strip
        return nobody

    stride = columns + 2 * LANES   # room to read beyond either end
    # In single precision, which keeps the order of numbers or makes them equal.
    grid = np.full(rows * stride, np.float32(-np.inf))
    cell_of, starts = np.empty(size, np.int32), np.zeros(rows * stride + 1, np.int32)
    strongest_in = np.empty(rows * stride, np.int32)
    for i in range(size):
        column, row = np.int64((points[i, 0] - left) * per_pixel), np.int64((points[i, 1] - top) * per_pixel)
        cell = row * stride + LANES + column
        cell_of[i] = cell
        starts[cell + 1] += 1
        if np.float32(power[i]) > grid[cell]:
            grid[cell], strongest_in[cell] = np.float32(power[i]), i
    by_cell = np.empty((0, 3), np.float64)

    chosen, radii, known = np.empty(size, np.int64), np.empty(size, np.float64), np.full(size, np.inf)
    is_exact = np.empty(size, np.bool_)
    for i in range(size):
        is_exact[i] = not strongest > responses[i]   # their radius is infinite
    patience = _PATIENCE * size
    for _ in range(_ATTEMPTS):
        # How many cells away lie within the radius as a whole; if not even a point's own does, there is no telling.
        reach = np.int64(wanted * (1 - 1e-6) / (np.sqrt(2.0) * side)) - 1
        around = _strongest_round(grid, rows, stride, reach)
        left_over = 0
        for i in range(size):
            chosen[left_over] = i
            if reach < 0 or not around[cell_of[i]] > np.float32(responses[i]):
                left_over += 1
        found = 0
        if left_over >= count:
            if len(by_cell) == 0:
                by_cell = _sorted_by_cell(points, power, cell_of, starts)
            for at in range(left_over):
                i = chosen[at]
                if known[i] < wanted:   # a bound on the radius, from an attempt before
                    continue
                if not is_exact[i]:
                    other = strongest_in[cell_of[i]]
                    if power[other] > responses[i]:
                        known[i] = np.sqrt((points[other, 0] - points[i, 0]) ** 2
                                           + (points[other, 1] - points[i, 1]) ** 2)
                        if known[i] < wanted:
                            continue
                    known[i], seen = _nearest_stronger(points[i, 0], points[i, 1], responses[i], cell_of[i], wanted,
                                                       side, rows, stride, grid, starts, by_cell)
                    is_exact[i] = known[i] >= wanted
                    patience -= seen
                    if patience < 0:
                        return nobody
                if is_exact[i]:
                    chosen[found], radii[found] = i, known[i]
                    found += 1
            if found >= count:
                return chosen[:found].copy(), radii[:found].copy()
        wanted *= min(max(0.93 * (found / count) ** (2 / 3), 0.5), 0.9)
    return nobody


@kernel
def _occupied(points, left, top, right, bottom):
    """Share of the cells of a coarse grid that points lie in."""
    cells = int(min(64, 1 + np.sqrt(len(points) / 8)))
    across, down = (cells - 1e-6) / (right - left), (cells - 1e-6) / (bottom - top)
    if not (across < 1e100 and down < 1e100):
        return np.nan
    occupied = np.zeros((cells, cells), np.uint8)
    for i in range(len(points)):
        occupied[np.int64((points[i, 1] - top) * down), np.int64((points[i, 0] - left) * across)] = 1
    return occupied.sum() / occupied.size


@kernel
def _strongest_round(grid, rows, stride, reach):
    """For each cell the greatest power in the square of cells up to `reach`, at the most `LANES`, away."""
    along, result = np.full_like(grid, np.float32(-np.inf)), np.empty_like(grid)
    for row in range(rows):
        for i in range(row * stride + LANES, (row + 1) * stride - LANES, LANES):
            most = load(grid, i)
            for distance in range(1, reach + 1):
                most = maximum(most, maximum(load(grid, i - distance), load(grid, i + distance)))
            store(along, i, most)
    for row in range(rows):
        first, last = max(row - reach, 0), min(row + reach, rows - 1)
        for i in range(LANES, stride - LANES, LANES):
            most = load(along, first * stride + i)
            for other in range(first + 1, last + 1):
                most = maximum(most, load(along, other * stride + i))
            store(result, row * stride + i, most)
    return result


@kernel
def _sorted_by_cell(points, power, cell_of, starts):
    """x, y and power of the points of cell after cell; `starts` holds how many each has, one further on."""
    result = np.empty((len(points), 3), np.float64)
    for cell in range(1, len(starts)):
        starts[cell] += starts[cell - 1]
    filled = starts[:-1].copy()
    for i in range(len(points)):
        at = filled[cell_of[i]]
        filled[cell_of[i]] += 1
        result[at, 0], result[at, 1], result[at, 2] = points[i, 0], points[i, 1], power[i]
    return result


@kernel
def _nearest_stronger(x, y, response, cell, enough, side, rows, stride, grid, starts, by_cell):
    """Distance to the nearest point that suppresses, or one below `enough`; and how many were looked at for it.

    In squares of cells round the point's own, each larger than the one before.
    """
    row, column = cell // stride, cell % stride
    threshold = splat(np.float32(response))
    best, seen = np.inf, 0
    reach = np.int64(enough / side) + 1
    while True:
        first, last = max(column - reach, LANES), min(column + reach, stride - LANES - 1)
        for step in range(2 * reach + 1):
            v = row + ((step + 1) // 2 if step % 2 == 1 else -(step // 2))   # the nearest rows first
            if not 0 <= v < rows:
                continue
            away = max(abs(v - row) - 1, 0) * side * (1 - 1e-6)
            if away * away > best:
                break
            for u in range(first, last + 1, LANES):
                bits = where_not_less(load(grid, v * stride + u), threshold)
                if u + LANES > last + 1:
                    bits &= (1 << (last + 1 - u)) - 1
                while bits != 0:
                    other = v * stride + u + lowest_bit(bits)
                    bits &= bits - 1
                    for at in range(starts[other], starts[other + 1]):
                        if by_cell[at, 2] > response:
                            dx, dy = by_cell[at, 0] - x, by_cell[at, 1] - y
                            squared = dx * dx + dy * dy
                            if squared < best:
                                best = squared
                                if np.sqrt(best) < enough:
                                    return np.sqrt(best), seen + at - starts[other]
                    seen += starts[other + 1] - starts[other]
        if np.sqrt(best) <= reach * side * (1 - 1e-6) or reach > max(rows, stride):
            return np.sqrt(best), seen
        reach = 2 * reach if best == np.inf else min(2 * reach, np.int64(np.sqrt(best) / side) + 1)
