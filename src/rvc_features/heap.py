"""How the C heap treats large blocks, such as images."""

from __future__ import annotations

import ctypes

# Parameters of glibc's mallopt (malloc.h).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_LARGEST_BLOCK = 32 << 20   # bytes: the most that mallopt accepts for the second; a 4K colour image has 25 million
_KEPT = 512 << 20           # bytes that may lie free before any are given back


def keep_large_blocks() -> bool:
    """Have freed images kept for the next ones, instead of given back to the kernel and cleared anew each time.

    Page faults on fresh memory are otherwise half the time that a frame of two megapixels takes. All threads share
    one arena: those of their own, 64 MB at the most, are given back whatever the thresholds say. To be called before
    the first thread starts.

    Returns
    -------
    bool
        Whether the C library could be told so; only glibc can.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):   # musl, macOS, Windows
        return False
    settings = ((_M_MMAP_THRESHOLD, _LARGEST_BLOCK), (_M_TRIM_THRESHOLD, _KEPT), (_M_ARENA_MAX, 1))
    return all(mallopt(parameter, value) == 1 for parameter, value in settings)
