"""Which of the candidates become key points: three filters (exercise 2), each a choice of indices.

All three take the candidates of every octave together and know nothing of images.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels import compiler, sorting, spread, suppression
from rvc_features.parameters import Flag, Integer, Real, check

ANMS = Flag('Adaptive non-maximal suppression: spread the points over the image, which costs some repeatability. '
            'Wins over fixed_number_of_points.')
ANMS_POINTS = Integer('How many points adaptive non-maximal suppression takes at the most.', 0)
ANMS_ROBUSTNESS = Real('c_r: a point is suppressed only by one that is stronger by 1 / c_r.', 0, 1, above_low=True)
ANMS_POOL = Real('Adaptive non-maximal suppression chooses from the strongest, this many times the points it takes: '
                 '1.3 keeps nearly all repeatability, 4 covers nearly all of the image, 0 chooses from all.', 0, 1000)


def above_threshold(responses: np.ndarray, threshold: float, maximum: float) -> np.ndarray:
    """Indices of the responses greater than `threshold` times `maximum`, strongest first."""
    responses = np.asarray(responses)
    chosen = np.flatnonzero(responses.astype(np.float64) > threshold * maximum)
    return chosen[_strongest_first(responses[chosen])]


def strongest(responses: np.ndarray, count: int) -> np.ndarray:
    """Indices of the `count` strongest, strongest first; of equals the lower index."""
    return _largest_first(np.asarray(responses), count)


def adaptive_non_maximal_suppression(points: np.ndarray, responses: np.ndarray, count: int,
                                     robustness: float = 0.9) -> np.ndarray:
    """The `count` points with the largest suppression radius: strong ones, spread over the image.

    The suppression radius of a point is its distance to the nearest point that is significantly stronger,
    r_i = min |x_i - x_j| over all j with f_i < c_r f_j. The strongest point has no such neighbour: its radius is
    infinite, and it is always kept.

    Parameters
    ----------
    points : array_like, float, shape (N, 2)
    responses : array_like, float, shape (N,)
        f above, compared in double precision.
    count : int
        How many points to keep, at least 0; all N where there are no more.
    robustness : float
        c_r above, in (0, 1].

    Returns
    -------
    ndarray, int64, shape (min(count, N),)
        Indices, largest radius first; of equal radii the stronger response first, then the lower index.

    Raises
    ------
    TypeError, ValueError
        When an argument is not as above, or holds NaN or infinity.

    References
    ----------
    M. Brown, R. Szeliski and S. Winder, "Multi-image matching using multi-scale oriented patches", CVPR 2005, sec. 3.

    Examples
    --------
    >>> adaptive_non_maximal_suppression([[0, 0], [1, 0], [9, 0]], [10, 8, 5], count=2).tolist()
    [0, 2]
    """
    points, responses = _checked_candidates(points, responses)
    check('count', count, Integer('', 0))
    check('robustness', robustness, Real('', 0, 1, above_low=True))

    if compiler.available():
        found = spread.reach_largest_radius(points, responses, robustness, count)
        if found is not None:
            candidates, radii = found
            order = _strongest_first(responses.take(candidates))
            return candidates.take(order).take(_largest_first(radii.take(order), count))
    order = _strongest_first(responses)
    radii = suppression_radii(points.take(order, axis=0), responses.take(order), robustness, count)
    # Of equal radii the first in the order of response and index.
    return order[_largest_first(radii, count)]


def most_spread(points: np.ndarray, count: int, robustness: float, pool: float) -> np.ndarray:
    """The `count` of the key points that adaptive non-maximal suppression takes out of the strongest `pool` * `count`.

    Parameters
    ----------
    points : ndarray of key_points.DTYPE
    count : int
    robustness : float
        c_r.
    pool : float
        0: all of them may be taken.
    """
    if pool > 0:
        points = points.take(strongest(points['response'], max(count, round(pool * count))))
    positions = np.column_stack((points['x'], points['y']))
    return points.take(adaptive_non_maximal_suppression(positions, points['response'], count, robustness))


def suppression_radii(points: np.ndarray, responses: np.ndarray, robustness: float,
                      count: int | None = None) -> np.ndarray:
    """Suppression radius of each point; the points come strongest first (see above for the definition).

    Where only the `count` largest radii matter, the others may come out larger than they are, yet stay below those.
    """
    stronger = significantly_stronger(responses, robustness)
    if compiler.available():
        exact = len(points) if count is None else min(count, len(points))
        return suppression.suppression_radii(points, stronger, exact)
    return reference_radii(points, stronger)


def reference_radii(points: np.ndarray, stronger: np.ndarray) -> np.ndarray:
    """Distance of each point i to the nearest of the first stronger[i] points, by looking at all of them."""
    radii = np.full(len(points), np.inf)
    for i in np.flatnonzero(stronger):
        offsets = points[:stronger[i]] - points[i]
        radii[i] = np.sqrt((offsets * offsets).sum(axis=1).min())
    return radii


def significantly_stronger(responses: np.ndarray, robustness: float) -> np.ndarray:
    """For responses that fall from the first to the last: how many of the first ones are significantly stronger."""
    if compiler.available():
        return suppression.significantly_stronger(responses, robustness)
    return reference_stronger(responses, robustness)


def reference_stronger(responses: np.ndarray, robustness: float) -> np.ndarray:
    """`significantly_stronger` by binary search."""
    rising = responses[::-1]
    exceeding = len(responses) - np.searchsorted(robustness * rising, responses, side='right')
    # Never a weaker one, which the product alone would allow among negative responses.
    return np.minimum(exceeding, len(responses) - np.searchsorted(rising, responses, side='right'))


def _largest_first(values: np.ndarray, count: int) -> np.ndarray:
    """Indices of the `count` largest values, largest first; of equals the lower index."""
    return sorting.strongest_first(values, count) if compiler.available() else reference_order(values, count)


def _strongest_first(responses: np.ndarray) -> np.ndarray:
    return _largest_first(responses, len(responses))


def reference_order(responses: np.ndarray, count: int | None = None) -> np.ndarray:
    """Indices from the largest response to the least, of equals the lower first; of `count` of them."""
    return np.argsort(-responses, kind='stable')[:count]


def _checked_candidates(points: np.ndarray, responses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    try:
        points, responses = np.asarray(points, np.float64), np.asarray(responses, np.float64)
    except (TypeError, ValueError):
        raise TypeError('points and responses must be arrays of numbers') from None
    if points.size == 0 and responses.size == 0:
        points = points.reshape(0, 2)
    if responses.ndim != 1 or points.shape != (len(responses), 2):
        raise ValueError('points must have shape (N, 2) and responses shape (N,); '
                         f'got {points.shape} and {responses.shape}')
    if not (np.isfinite(points).all() and np.isfinite(responses).all()):
        raise ValueError('points and responses must be finite; got NaN or infinity')
    return points, responses
