"""Whatever is wrong with the cache of compiled kernels: they are compiled, it is said once, and mended if it can be."""

import logging
import os
import resource
from contextlib import contextmanager

import pytest

numba = pytest.importorskip('numba')

from rvc_features.kernels import cache, compiler  # noqa: E402

if not compiler.available():
    pytest.skip('kernels are turned off', allow_module_level=True)


def twice(number):
    return 2 * number


def as_folder(path):
    path.unlink()
    path.mkdir()


DAMAGES = {
    'empty': lambda path: path.write_bytes(b''),
    'cut off': lambda path: path.write_bytes(path.read_bytes()[:path.stat().st_size // 2]),
    'noise': lambda path: path.write_bytes(os.urandom(2000)),
    'zeros': lambda path: path.write_bytes(bytes(path.stat().st_size)),
    'text': lambda path: path.write_text('no such thing'),
    'missing': lambda path: path.unlink(),
    'folder': as_folder,
}


def flip(path, position):
    content = bytearray(path.read_bytes())
    content[position] ^= 0x55
    path.write_bytes(content)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where the cache lies, with one kernel in it."""
    monkeypatch.setattr(numba.config, 'CACHE_DIR', str(tmp_path))
    monkeypatch.setattr(cache, '_said', set())
    first = cache.njit(twice)
    assert first(21) == 42
    return tmp_path


def file_of(folder, ending):
    found, = folder.rglob(f'*.{ending}')
    return found


def loaded():
    """Whether a new process would load the kernel, which it must call right either way."""
    kernel = cache.njit(twice)
    assert kernel(21) == 42
    return sum(kernel.stats.cache_hits.values()) > 0


@contextmanager
def no_room():
    """As on a full disk: no file can grow."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_sound_cache_is_used_and_nothing_is_said(folder, caplog):
    assert loaded()
    assert not caplog.records


@pytest.mark.parametrize('ending', ['nbi', 'nbc'])
@pytest.mark.parametrize('damage', DAMAGES)
def test_damage_is_compiled_over_and_mended(folder, caplog, ending, damage):
    DAMAGES[damage](file_of(folder, ending))
    with caplog.at_level(logging.WARNING, 'rvc_features'):
        assert not loaded()
        if damage == 'folder':
            assert 'each start compiles' in caplog.text
        else:
            assert ('compiled anew' in caplog.text) == (damage != 'missing')
            assert loaded()   # mended
    assert len(caplog.records) <= 2


def test_a_flipped_byte_never_reaches_the_processor(folder):
    """Machine code is in there: what is loaded must be to the bit what was saved."""
    data = file_of(folder, 'nbc')
    content = data.read_bytes()
    code = content.index(b'\x7fELF')
    for position in (0, 20, len(content) // 3, code + 4, code + 200, len(content) - 20):
        flip(data, position)
        assert not loaded(), f'byte {position} of {len(content)}'
        assert loaded()


def test_an_entry_under_another_kernels_name_is_not_taken(folder):
    """One flipped bit in the index is enough for that."""
    kernel = cache.njit(twice)
    assert kernel(0.25) == 0.5
    whole_numbers, fractions = sorted(folder.rglob('*.nbc'))
    whole_numbers.write_bytes(fractions.read_bytes())
    assert not loaded()


def test_a_full_disk_is_said_once_and_kernels_work(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(numba.config, 'CACHE_DIR', str(tmp_path))
    monkeypatch.setattr(cache, '_said', set())
    with caplog.at_level(logging.WARNING, 'rvc_features'):
        with no_room():
            assert not loaded()
            assert not loaded()
        assert len(caplog.records) == 1
        assert 'each start compiles' in caplog.text
        assert 'File too large' in caplog.text
    assert not loaded()
    assert loaded()   # as soon as there is room again


def test_nowhere_to_write_is_said_and_kernels_work(monkeypatch, caplog):
    monkeypatch.setattr(cache, '_said', set())
    monkeypatch.setattr(cache.SoundCache, '__init__', refuse)
    with caplog.at_level(logging.WARNING, 'rvc_features'):
        assert not loaded()
    assert 'no locator available' in caplog.text


def refuse(self, function):
    raise RuntimeError(f'cannot cache function {function.__name__!r}: no locator available')
