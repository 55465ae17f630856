"""Times of image files as data sets keep them."""

from pathlib import Path

import pytest

from rvc_features.recordings.file_times import file_times, name_of
from rvc_features.recordings.regular_files import SourceError


def paths(*names, folder='frames'):
    return [Path(folder) / name for name in names]


@pytest.mark.parametrize(('names', 'nanoseconds'), [
    (['1305031102.175304.png', '1305031102.2.png'], [1305031102_175304000, 1305031102_200000000]),        # TUM
    (['1403636579763555584.png', '1403636579813555456.png'], [1403636579763555584, 1403636579813555456]),   # EuRoC
    (['1403636579763555.jpg'], [1403636579763555000]),
    (['1403636579763.jpg'], [1403636579763000000]),
])
def test_times_in_names(names, nanoseconds):
    assert file_times(paths(*names)) == (nanoseconds, True)


@pytest.mark.parametrize('names', [['img1.png'], ['0000000001.png'], ['1305031102.175304.png', 'other.png'],
                                   ['9999999999999999999.png'], ['0000000000000000001.png'], ['1.5.png'], []])
def test_names_that_are_no_times(names):
    assert file_times(paths(*names)) is None


def test_what_name_of_writes_is_understood():
    for time in (1305031102_000000001, 1305031102_999999999):
        assert file_times(paths(f'{name_of(time)}.png')) == ([time], True)


def test_kitti(tmp_path):
    data = tmp_path / 'image_02' / 'data'
    data.mkdir(parents=True)
    (tmp_path / 'image_02' / 'timestamps.txt').write_text('2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.697\n'
                                                          '2011-09-26 13:02:26\n')
    files = paths('0000000000.png', '0000000002.png', folder=data)      # one is missing, as in some drives
    assert file_times(files) == ([1317042145594360375, 1317042146000000000], True)
    with pytest.raises(SourceError, match=r'timestamps.txt: it has 3 times, and none for image 3; .* or give a rate'):
        file_times(paths('0000000003.png', folder=data))

    odometry = tmp_path / '00' / 'image_0'
    odometry.mkdir(parents=True)
    (tmp_path / '00' / 'times.txt').write_text('0.000000e+00\n1.036224e-01\n')
    assert file_times(paths('000000.png', '000001.png', folder=odometry)) == ([0, 103622400], False)


def test_another_list_beside_numbered_files(tmp_path):
    (tmp_path / 'times.txt').write_text('the times they are a-changing\n')
    assert file_times(paths('1.png', folder=tmp_path)) is None
