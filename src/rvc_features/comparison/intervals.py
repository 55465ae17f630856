"""How far chance reaches: bootstrap intervals of means over pairs."""

from __future__ import annotations

import numpy as np


def bootstrap_means(values: np.ndarray, seed: int, rounds: int = 2000) -> np.ndarray:
    """Means of resampled rows: `rounds` times, as many rows as there are are drawn with replacement.

    Parameters
    ----------
    values : ndarray, shape (pairs, detectors)
        NaN is left out of a mean. Drawing whole rows keeps detectors paired, so that differences can be judged.

    Returns
    -------
    ndarray, shape (rounds, detectors)

    References
    ----------
    B. Efron and R. J. Tibshirani, "An introduction to the bootstrap", 1993, ch. 13 (percentile interval).
    """
    generator = np.random.default_rng(seed)
    rows = len(values)
    weights = generator.multinomial(rows, [1 / rows] * rows, size=rounds).astype(np.float64)
    known = ~np.isnan(values)
    totals = weights @ np.where(known, values, 0)
    counts = weights @ known
    return np.divide(totals, counts, out=np.full_like(totals, np.nan), where=counts > 0)


def interval(means: np.ndarray) -> tuple[float, float]:
    """The middle 95 per cent of bootstrap means (a vector)."""
    low, high = np.nanpercentile(means, [2.5, 97.5])
    return float(low), float(high)
