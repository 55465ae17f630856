"""Files that appear whole or not at all, and never in place of another unasked."""

import os
import stat

import pytest

from rvc_features.recordings.regular_files import SourceError, check_regular, read_text
from rvc_features.recordings.whole_files import whole_file


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_when_it_is_complete(tmp_path):
    with whole_file(tmp_path / 'a') as unfinished:
        unfinished.write_text('new')
        assert not (tmp_path / 'a').exists()
    assert names_in(tmp_path) == ['a']
    assert (tmp_path / 'a').read_text() == 'new'
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE((tmp_path / 'a').stat().st_mode) == 0o666 & ~mask


@pytest.mark.parametrize('error', [ValueError, KeyboardInterrupt])
def test_what_was_there_stays_when_it_does_not_become_complete(tmp_path, error):
    (tmp_path / 'a').write_text('old')
    def fail_half_way():
        with whole_file(tmp_path / 'a') as unfinished:
            unfinished.write_text('half')
            raise error

    with pytest.raises(error):
        fail_half_way()
    assert names_in(tmp_path) == ['a']
    assert (tmp_path / 'a').read_text() == 'old'


def test_nothing_is_replaced_unasked(tmp_path):
    (tmp_path / 'a').write_text('old')
    with pytest.raises(FileExistsError, match='a: there is such a file already'), \
            whole_file(tmp_path / 'a', overwrite=False):
        pytest.fail('nothing is begun')
    with pytest.raises(FileExistsError, match='b: there is such a file already'), \
            whole_file(tmp_path / 'b', overwrite=False):
        (tmp_path / 'b').write_text('came meanwhile')
    assert (tmp_path / 'a').read_text() == 'old'
    assert (tmp_path / 'b').read_text() == 'came meanwhile'
    assert names_in(tmp_path) == ['a', 'b']


def test_no_link_is_followed(tmp_path):
    (tmp_path / 'precious').write_text('old')
    (tmp_path / 'a.part').symlink_to(tmp_path / 'precious')
    (tmp_path / 'a').symlink_to(tmp_path / 'precious')
    with whole_file(tmp_path / 'a') as unfinished:
        unfinished.write_text('new')
    assert (tmp_path / 'precious').read_text() == 'old'
    assert (tmp_path / 'a').read_text() == 'new'


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    for path, text in ((tmp_path / 'pipe', 'pipe: a pipe, not a file'), (tmp_path, 'a folder, not a file'),
                       ('/dev/zero', 'a device or socket'), (tmp_path / 'missing', 'missing: no such file'),
                       ('a\0b', 'null')):
        for read in (check_regular, read_text):
            with pytest.raises(SourceError, match=text):
                read(path)
    (tmp_path / 'large').write_bytes(bytes(1000))
    with pytest.raises(SourceError, match='large: larger than 999 bytes'):
        read_text(tmp_path / 'large', 999)
    (tmp_path / 'latin').write_bytes(b'caf\xe9')
    assert read_text(tmp_path / 'latin') == 'caf\ufffd'
