"""What libjpeg and libpng have to say about an image, instead of on the terminal.

They write it to C's `stderr`, and only there: that a JPEG was damaged and has been filled up with grey nobody learns
otherwise. `stderr` is a variable of the C library; while an image is decoded it points to a piece of memory. The
descriptor beneath it stays what it was, for Python, for child processes, and for whoever writes to it directly.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import threading
from typing import Any, Iterator

_lock = threading.Lock()   # there is one stderr: one image at a time
_DECODERS = re.compile(r'libpng (error|warning): |Corrupt JPEG data|Premature end of JPEG|Inconsistent progression|'
                       r'Invalid SOS parameters|Warning: |Unsupported|Unknown Adobe')
_DAMAGE = re.compile(r'(?:libpng error: |Corrupt JPEG data: )(.*)|(Premature end of JPEG.*|Inconsistent progression.*)')
_PADDING = re.compile(r'(\d+) extraneous bytes before marker 0xd9')
_MOST_PADDING = 16         # bytes that many cameras write between the pixels of a JPEG and its end
_UNBUFFERED = 2            # _IONBF of stdio.h


class Heard:
    """The lines that came while an image was decoded."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def damage(self) -> str:
        """The first line that tells of damage, or nothing."""
        for line in self.lines:
            found = _DAMAGE.match(line)
            padding = _PADDING.search(line)
            if found and not (padding and int(padding[1]) <= _MOST_PADDING):
                return found[1] or found[2]
        return ''


@contextlib.contextmanager
def heard() -> Iterator[Heard]:
    """Listen to the decoders; the lines are there when the context has ended."""
    said = Heard()
    with _lock:
        ear = _ear()
        if ear is None:
            yield said
            return
        ear.begin()
        try:
            yield said
        finally:
            lines = ear.end().splitlines()
            said.lines = [line for line in lines if _DECODERS.match(line)]
            others = [line for line in lines if not _DECODERS.match(line)]
            if others:   # of another thread, in another library
                os.write(2, ''.join(f'{line}\n' for line in others).encode())


class _Ear:
    """A stream into memory that takes the place of C's stderr."""

    def __init__(self, library: Any) -> None:
        library.fmemopen.restype = ctypes.c_void_p
        library.fmemopen.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p]
        library.setvbuf.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_size_t]
        library.rewind.argtypes = [ctypes.c_void_p]
        self._rewind = library.rewind
        self._variable = ctypes.c_void_p.in_dll(library, 'stderr')
        self._memory = ctypes.create_string_buffer(4096)
        self._stream = library.fmemopen(self._memory, len(self._memory) - 1, b'w')
        library.setvbuf(self._stream, None, _UNBUFFERED, 0)
        self._original: int | None = None

    def begin(self) -> None:
        self._rewind(self._stream)
        ctypes.memset(self._memory, 0, len(self._memory))
        self._original, self._variable.value = self._variable.value, self._stream

    def end(self) -> str:
        self._variable.value = self._original
        return self._memory.value.decode(errors='replace')


_ears: list[_Ear | None] = []


def _ear() -> _Ear | None:
    """The one there is; None where the C library is not glibc: with others stderr can't be assigned to."""
    if not _ears:
        try:
            library = ctypes.CDLL(None)
            library.gnu_get_libc_version   # noqa: B018
            _ears.append(_Ear(library))
        except (AttributeError, OSError, TypeError, ValueError):
            _ears.append(None)
    return _ears[0]
