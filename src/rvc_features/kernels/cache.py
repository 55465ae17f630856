"""Numba's cache of compiled kernels on disk, made so that nothing that is wrong with it keeps a program from running.

Numba believes what it finds there: a full disk or a damaged index ends the program with a traceback, damaged machine
code with a crash. Here what was saved is loaded only if its checksum is right; everything else is compiled anew, said
once in the log, and replaced where the disk allows it.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from typing import Any, Callable

import numba

from rvc_features.kernels.cache_folder import Locator, built, caching

_UNCACHED = 'what is compiled now is compiled again at each start, for it can not be kept'

_logger = logging.getLogger('rvc_features')
_said: set[str] = set()


def njit(function: Callable[..., Any], **options: Any) -> Any:
    """`numba.njit(cache=True, ...)` of a function, with a cache that can do no harm."""
    compiled = numba.njit(**options)(function)
    try:
        compiled._cache = SoundCache(function)
    except (OSError, RuntimeError) as error:   # no place to write: a read-only installation without a home directory
        _say_once(_UNCACHED, error)
    return compiled


class _InOurFolder(caching.CompileResultCacheImpl):
    _locator_classes = [Locator]  # noqa: RUF012  (as in the base class)


class SoundCache(caching.FunctionCache):
    """The cache of one kernel; takes the place of the one that `njit(cache=True)` makes.

    Parameters
    ----------
    function : callable
        As written in Python, not compiled.
    """

    _impl_class = _InOurFolder

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        files = [self._cache_file]
        beside = built()
        if beside is not None and str(beside) != self.cache_path:   # the build's, not ours to write
            base, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
            files.append(caching.IndexDataCacheFile(str(beside), base, stamp))
        self._cache_file: Any = _CheckedFile(files)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function, or None where it has to be compiled."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:   # damage raises whatever unpickling can raise
            _say_once('kernels are compiled anew, for what was kept of them is damaged', error, self.cache_path)
        try:
            self.flush()   # or saving would read the damaged index first
        except Exception as error:
            _say_once(_UNCACHED, error, self.cache_path)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function for the next start, if the disk allows it."""
        try:
            super().save_overload(sig, data)
        except Exception as error:   # full, read-only, or with a folder where a file should be
            _say_once(_UNCACHED, error, self.cache_path)


class _CheckedFile:
    """Numba's files of one kernel's variants, with a checksum over each of them and the key it was saved under.

    All are read, the first is written.
    """

    def __init__(self, files: list[Any]) -> None:
        self._files = files
        self._file = files[0]
        self.flush = self._file.flush

    def save(self, key: Any, data: Any) -> None:
        content = self._file._dump((repr(key), data))
        self._file.save(key, (_checksum(content), content))

    def load(self, key: Any) -> Any:
        """What was saved under `key`; None if nothing was, an exception if it is damaged."""
        found = next((found for found in (file.load(key) for file in self._files) if found is not None), None)
        if found is None:
            return None
        checksum, content = found
        if _checksum(content) != checksum:
            raise ValueError('the checksum is wrong')
        saved_as, data = pickle.loads(content)
        if saved_as != repr(key):
            raise ValueError('it is that of another function')
        return data


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


def _say_once(sentence: str, error: Exception, path: str = '') -> None:
    """One line for a whole set of kernels, which mostly share the trouble."""
    if sentence not in _said:
        _said.add(sentence)
        place = f' in {path}' if path else ''
        _logger.warning('%s%s (%s: %s)', sentence, place, type(error).__name__, str(error)[:200])
