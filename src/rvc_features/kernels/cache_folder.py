"""Where compiled kernels are kept: a folder for each state of the source, version of Numba and kind of processor.

Numba itself looks at the file of a kernel only, and would go on with what was compiled from an older vectors.py. Here
the folder's name is a fingerprint of all that decides what comes out, and nothing else: not where the package lies nor
when its files were written. So the build can compile for everybody (`python3 -m rvc_features.kernels.warm_up`), and
what it leaves beside the package can be installed, copied, and read where nothing can be written.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import sys
import tempfile
from pathlib import Path
from typing import Any, Callable

import llvmlite
import llvmlite.binding
import numba

import rvc_features

try:
    from numba.core import caching
except ImportError:   # Numba before 0.49, as in ROS Noetic's Ubuntu 20.04
    from numba import caching  # type: ignore[attr-defined, no-redef]

BESIDE_THE_PACKAGE = 'compiled_kernels'   # the folder that the build fills; CMakeLists.txt names it too

_logger = logging.getLogger('rvc_features')


def find() -> Path | None:
    """The folder to keep kernels in: the first of those below that can be written; None if there is none.

    1. in NUMBA_CACHE_DIR;
    2. beside the package, where the build has compiled for this processor;
    3. in the user's cache, `~/.cache/rvc_features`.

    Where none can be written it is what the build has compiled.
    """
    return _find(getattr(numba.config, 'CACHE_DIR', ''), tuple(rvc_features.__path__))


@functools.lru_cache(maxsize=None)
def _find(named: str, package: tuple[str, ...]) -> Path | None:
    name = f'rvc_features-{fingerprint()}'
    beside = built(package)
    user = Path(os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')) / 'rvc_features' / name
    if named and _can_be_written(Path(named) / name):
        return Path(named) / name
    if beside is None and any(any(Path(folder, BESIDE_THE_PACKAGE).glob('rvc_features-*')) for folder in package):
        _logger.warning('the kernels that the build compiled are for another processor, Numba or state of the source: '
                        'they are compiled anew, for a minute or two')
    if beside is not None and _can_be_written(beside):
        return beside
    return user if user.is_absolute() and _can_be_written(user) else beside


def built(package: tuple[str, ...] | None = None) -> Path | None:
    """What the build has compiled for this processor, which is read too; None if there is nothing."""
    for folder in package or rvc_features.__path__:
        beside = Path(folder) / BESIDE_THE_PACKAGE / f'rvc_features-{fingerprint()}'
        if beside.is_dir():
            return beside
    return None


@functools.lru_cache(maxsize=None)
def fingerprint() -> str:
    """Of the source of all kernels, the versions of Python, Numba and LLVM, and the processor."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob('*.py')):
        digest.update(path.name.encode() + path.read_bytes())
    processor = llvmlite.binding.get_host_cpu_name(), sorted(llvmlite.binding.get_host_cpu_features().items())
    digest.update(repr((sys.version_info[:2], numba.__version__, llvmlite.__version__, processor)).encode())
    return digest.hexdigest()[:16]


class Locator(caching._CacheLocator):
    """Tells Numba the folder."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._line = function.__code__.co_firstlineno
        self._folder = folder

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> Locator | None:
        """Numba's name for making one; None if there is no folder."""
        folder = find()
        return None if folder is None else cls(function, folder)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """What Numba compares to notice a change of the source."""
        return fingerprint()

    def get_disambiguator(self) -> str:
        """What tells functions of one name in one file apart."""
        return str(self._line)


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
