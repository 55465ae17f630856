"""How the C heap treats large blocks, such as images: what the camera needs is kept, the rest is given back."""

from __future__ import annotations

import ctypes
import functools
import gc
import os
import threading
import time
from typing import Any

# Parameters of glibc's mallopt (malloc.h).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_LARGEST_BLOCK = 32 << 20   # bytes: the most that mallopt accepts for the second; a 4K colour image has 25 million
_LEAST_KEPT, _MOST_KEPT = 64 << 20, 512 << 20   # bytes that may lie free before any are given back
_SLACK = 32 << 20           # bytes beyond what may lie free by which a process may grow before any are given back
_PAUSE = 2.0                # seconds until that is tried again: less than a hundred frames take
_BLOCKS = 12                # of the size of a frame that one round of the node takes and frees, at the most
_FRAMES = 50                # smaller ones in a row, after which a large one is a thing of the past
_SHRUNK = 0.5               # of the largest size: what counts as smaller


def keep_large_blocks(frame: int = 0) -> bool:
    """Have freed images kept for the next ones, instead of given back to the kernel and cleared anew each time.

    Page faults on fresh memory are otherwise half the time that a frame of two megapixels takes. All threads share
    one arena: those of their own, 64 MB at the most, are given back whatever the thresholds say. To be called before
    the first thread starts.

    Parameters
    ----------
    frame : int
        Bytes of one image, where that is known: so many times as much is kept as its processing takes.

    Returns
    -------
    bool
        Whether the C library could be told so; only glibc can.
    """
    settings = ((_M_MMAP_THRESHOLD, _LARGEST_BLOCK), (_M_ARENA_MAX, 1),
                (_M_TRIM_THRESHOLD, min(max(_BLOCKS * frame, _LEAST_KEPT), _MOST_KEPT)))
    mallopt = _c_function('mallopt')
    return mallopt is not None and all(mallopt(parameter, value) == 1 for parameter, value in settings)


def give_back() -> None:
    """Give all memory that lies free back to the kernel; only glibc can."""
    trim = _c_function('malloc_trim')
    if trim is not None:
        trim(ctypes.c_size_t(0))


def settle() -> None:
    """Leave what there is by now out of the searches for garbage to come; to be called when all is loaded.

    With the compiled loops there are more than a hundred thousand objects: to look through them takes 80 ms, in which
    Python's lock is held and every thread stands still, again and again while frames come. One in a hundred of them is
    garbage by then, and stays: looking for it would cost the start what is to be saved. A program may turn the
    collector off at its start; here it is turned on.
    """
    gc.freeze()
    gc.enable()


def resident_bytes() -> int:
    """Memory that this process has at the moment; 0 where the kernel doesn't tell."""
    try:
        with open('/proc/self/statm') as file:
            return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE')
    except (OSError, ValueError, IndexError):
        return 0


class FrameHeap:
    """Follows the size of the frames: what is kept grows with them at once, and shrinks when large ones are past."""

    def __init__(self) -> None:
        self._largest = self._recent = 0   # bytes: of the frames that memory is kept for, and of those since
        self._smaller_in_a_row = 0
        self._kept = _LEAST_KEPT
        self._least = self._after_trim = resident_bytes()
        self._last_trim = time.monotonic()
        self._lock = threading.Lock()

    def note(self, size: int) -> None:
        """A block of that many bytes has come in; to be called for every frame, good or bad."""
        with self._lock:
            if size > _SHRUNK * self._largest:
                self._smaller_in_a_row = self._recent = 0
                if size > self._largest:
                    self._keep(size)
                return
            self._smaller_in_a_row += 1
            self._recent = max(self._recent, size)
            if self._smaller_in_a_row < _FRAMES:
                return
            self._keep(self._recent)
            self._smaller_in_a_row = self._recent = 0
        give_back()

    def tidy(self) -> None:
        """Give back what else has gathered, such as messages that never became frames; to be called now and then.

        What was in use at a peak may lie free since, without any growth that shows it. So it is tried again as long as
        there is more than the least that there was; it takes milliseconds.
        """
        resident, now = resident_bytes(), time.monotonic()
        self._least = min(self._least, resident)
        enough = self._kept + _SLACK
        if (resident - self._after_trim > enough
                or (resident - self._least > enough and now - self._last_trim > _PAUSE)):
            give_back()
            self._after_trim, self._last_trim = resident_bytes(), now

    def _keep(self, size: int) -> None:
        self._largest = size
        self._kept = min(max(_BLOCKS * size, _LEAST_KEPT), _MOST_KEPT)
        keep_large_blocks(size)


@functools.lru_cache(maxsize=None)
def _c_function(name: str) -> Any:
    try:
        return getattr(ctypes.CDLL(None), name)
    except (AttributeError, OSError, TypeError):   # musl, macOS, Windows
        return None
