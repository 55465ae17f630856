"""Frames from files, folders and videos; errors that name the file."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features.recordings.image_sources import SourceError, Video, open_source, read_image


def write(path, image):
    assert cv2.imwrite(str(path), image)
    return path


def test_a_folder_comes_in_natural_order(tmp_path):
    for number in (1, 2, 10):
        write(tmp_path / f'img{number}.png', np.full((4, 5), number, np.uint8))
    (tmp_path / 'notes.txt').write_text('not an image')
    frames = list(open_source([tmp_path]))
    assert [frame.name for frame in frames] == ['img1.png', 'img2.png', 'img10.png']
    assert [int(frame.image[0, 0]) for frame in frames] == [1, 2, 10]
    assert len(open_source([tmp_path, tmp_path / 'img2.png'])) == 4


def test_grey_colour_alpha_and_sixteen_bits(tmp_path):
    assert read_image(write(tmp_path / 'a.png', np.zeros((4, 5), np.uint8))).shape == (4, 5)
    assert read_image(write(tmp_path / 'b.png', np.zeros((4, 5, 3), np.uint8))).shape == (4, 5, 3)
    assert read_image(write(tmp_path / 'c.png', np.zeros((4, 5, 4), np.uint8))).shape == (4, 5, 3)
    deep = read_image(write(tmp_path / 'd.png', np.array([[0, 1000], [2000, 4000]], np.uint16)))
    assert deep.dtype == np.uint8
    assert deep.tolist() == [[0, 64], [128, 255]]


def test_a_video(tmp_path):
    path = tmp_path / 'video.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 25, (160, 120))
    for number in range(7):
        writer.write(np.full((120, 160, 3), 30 * number, np.uint8))
    writer.release()
    video = open_source([path])
    assert isinstance(video, Video)
    assert video.rate == 25
    for _ in range(2):
        frames = list(video)
        assert len(frames) == len(video) == 7
        assert [round(frame.image.mean() / 30) for frame in frames] == list(range(7))
        assert frames[3].time == pytest.approx(0.12)


@pytest.mark.parametrize('name', ['a.jpg', 'a.png'])
def test_a_file_cut_short_is_refused(tmp_path, name):
    path = write(tmp_path / name, texture())
    data = path.read_bytes()
    for length in (len(data) // 2, len(data) - 30, 10, 0):
        path.write_bytes(data[:length])
        with pytest.raises(SourceError, match=rf'{name}: not an image that OpenCV can read, or cut short'):
            read_image(path)


def test_bad_paths_are_named(tmp_path):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.txt').write_text('hello')
    (tmp_path / 'false.png').write_text('hello')
    for names, text in ((['missing'], 'missing: no such file or folder'),
                        (['empty'], 'empty: no images in this folder'),
                        (['text.txt'], 'text.txt: not a video that OpenCV can read'),
                        (['text.txt', 'false.png'], 'text.txt: not an image'),
                        (['false.png'], 'false.png: not an image that OpenCV can read')):
        with pytest.raises(SourceError, match=text):
            list(open_source([tmp_path / name for name in names]))
    with pytest.raises(SourceError, match='no such file'):
        Video(tmp_path / 'missing.avi')
