"""What all kernels share: Numba's decorator, whether it is there, threads. Of ours it imports cache and vectors only.

Kernels release the GIL and hold no state: they may run in several threads at once. Those that go over whole images do
so themselves: each thread takes a band of rows, as many as OpenCV has threads (`cv2.setNumThreads`).
"""

from __future__ import annotations

import functools
import logging
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable

import cv2
import numpy as np

try:
    import numba

    from rvc_features.kernels import cache, vectors  # noqa: F401  (whether it can be imported, too)
    installed = True
    _reason_against = 'NUMBA_DISABLE_JIT is set' if getattr(numba.config, 'DISABLE_JIT', False) else ''
except Exception as error:   # an ImportError, or whatever a Numba that does not fit this NumPy raises
    installed = False
    _reason_against = str(error)

LEAST_WIDTH = 18   # pixels: a vector, and one more on either side
_LEAST_BAND = 250_000   # pixels: fewer are done about as soon as another thread wakes up

_logger = logging.getLogger('rvc_features')


@functools.lru_cache(maxsize=None)
def available() -> bool:
    """Whether the kernels can be called; the first call says in the log when they can't."""
    if _reason_against:
        _logger.warning('Without Numba the detector runs slower, on OpenCV and NumPy alone (%s).', _reason_against)
    return not _reason_against


def description() -> str:
    """What the detector runs on, with versions, for people."""
    by_numba = f'without Numba ({_reason_against})' if _reason_against else f'Numba {numba.__version__}'
    return f'{by_numba}, NumPy {np.__version__}, OpenCV {cv2.__version__}'


def kernel(function: Callable[..., Any]) -> Any:
    """Numba's decorator with the options of this package; without Numba the function stays as it is."""
    if _reason_against:
        return function
    return cache.njit(function, nogil=True, error_model='numpy')


def read_only(image: np.ndarray) -> np.ndarray:
    """A contiguous read-only view or copy: one type for Numba, which would compile again for each kind of array."""
    view = np.ascontiguousarray(image).view()
    view.setflags(write=False)
    return view


def in_bands(work: Callable[[int, int], Any], height: int, width: int, cost: int = 1) -> list[Any]:
    """What `work(first, last)` gives for bands of rows that make up the image, in their order.

    `cost` is that of a pixel, in multiples of a fast kernel's.
    """
    count = bands(height, width, cost)
    if count == 1:
        return [work(0, height)]
    ends = [height * (band + 1) // count for band in range(count)]
    others = [_threads().submit(work, first, last) for first, last in zip(ends, ends[1:])]
    return [work(0, ends[0]), *(other.result() for other in others)]


def bands(height: int, width: int, cost: int = 1) -> int:
    """How many bands that takes: threads that are worth their waking up."""
    most = min(height * width * cost // _LEAST_BAND, height)
    return max(min(cv2.getNumThreads(), most), 1) if most > 1 else 1   # asking OpenCV takes a while


@functools.lru_cache(maxsize=None)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), 'rvc_features')


if hasattr(os, 'register_at_fork'):   # a forked process has none of its parent's threads
    os.register_at_fork(after_in_child=_threads.cache_clear)
