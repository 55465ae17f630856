"""Whatever is wrong with the cache of compiled kernels: they are compiled, it is said once, and mended if it can be."""

import logging
import os
import resource
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

numba = pytest.importorskip('numba')

from rvc_features.kernels import cache, cache_folder, compiler  # noqa: E402

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
            assert 'at each start' in caplog.text
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
        assert 'at each start' in caplog.text
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


# ---- The folder ----

@pytest.fixture
def home(tmp_path, monkeypatch):
    """A user with an empty home and a package that the build has not compiled for."""
    monkeypatch.setattr(numba.config, 'CACHE_DIR', '')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'home'))
    monkeypatch.setattr(cache_folder.rvc_features, '__path__', [str(tmp_path / 'package')])
    cache_folder._find.cache_clear()
    yield tmp_path
    cache_folder._find.cache_clear()


def test_kernels_are_kept_in_the_users_cache_where_nothing_else_is_said(home):
    assert not loaded()
    assert loaded()
    assert file_of(home / 'home' / 'rvc_features', 'nbc')


def test_what_the_build_has_compiled_is_read_where_nothing_can_be_written(home, monkeypatch):
    with monkeypatch.context() as build:
        build.setattr(numba.config, 'CACHE_DIR', str(home / 'package' / cache_folder.BESIDE_THE_PACKAGE))
        assert not loaded()
    monkeypatch.setattr(cache_folder, '_can_be_written', lambda folder: False)
    assert loaded()


def test_what_the_build_left_out_is_kept_in_the_users_cache(home, monkeypatch):
    """As in a system-wide installation: images of floats, say, are not compiled for by the build."""
    beside = home / 'package' / cache_folder.BESIDE_THE_PACKAGE
    with monkeypatch.context() as build:
        build.setattr(numba.config, 'CACHE_DIR', str(beside))
        assert not loaded()
    cache_folder._find.cache_clear()
    monkeypatch.setattr(cache_folder, '_can_be_written', lambda folder: beside not in folder.parents)
    before = sorted(beside.rglob('*'))
    kernel = cache.njit(twice)
    assert (kernel(21), kernel(0.25)) == (42, 0.5)   # the one from the build, the other compiled
    assert list(kernel.stats.cache_hits.values()) == [1]
    again = cache.njit(twice)
    assert (again(21), again(0.25)) == (42, 0.5)
    assert list(again.stats.cache_hits.values()) == [1, 1]
    assert sorted(beside.rglob('*')) == before


def test_a_build_for_another_processor_is_said_once_and_left_alone(home, caplog):
    other = home / 'package' / cache_folder.BESIDE_THE_PACKAGE / 'rvc_features-of-another'
    other.mkdir(parents=True)
    assert not loaded()
    assert loaded()
    assert [record.message.split(':')[0] for record in caplog.records] == [
        'the kernels that the build compiled are for another processor, Numba or state of the source']
    assert not list(other.iterdir())


def test_a_changed_helper_of_kernels_means_another_folder(monkeypatch, tmp_path):
    """Numba's own cache would keep what was compiled from an older vectors.py."""
    for path in Path(cache_folder.__file__).parent.glob('*.py'):
        shutil.copy(path, tmp_path)
    found = []
    for change in ('', '# something else\n'):
        with open(tmp_path / 'vectors.py', 'a') as file:
            file.write(change)
        monkeypatch.setattr(cache_folder, '__file__', str(tmp_path / 'cache_folder.py'))
        cache_folder.fingerprint.cache_clear()
        found.append(cache_folder.fingerprint())
    monkeypatch.undo()
    cache_folder.fingerprint.cache_clear()
    assert found[0] == cache_folder.fingerprint() != found[1]
