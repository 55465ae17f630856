"""Damaged files of every kind through the offline tools: a result, or one sentence and status 2; never a traceback.

RVC_FEATURES_DAMAGED says how many files of each kind are tried (default: few).
"""

import os
import signal

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features.command_line import quiet_opencv
from rvc_features.comparison import command

EACH = int(os.environ.get('RVC_FEATURES_DAMAGED', 4))
IMAGES = 'png', 'jpg', 'ppm', 'bmp', 'tif', 'webp'
HOMOGRAPHY = '1.01 0.02 3\n-0.01 0.99 2\n1e-5 2e-5 1\n'
XML = ('<?xml version="1.0"?>\n<opencv_storage><H13 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>\n'
       '<data>1.01 0.02 3 -0.01 0.99 2 1e-5 2e-5 1</data></H13></opencv_storage>\n')
DETECTORS = ('detectors:\n- orb\n- detector: harris\n  label: Harris\n  parameters:\n    octaves: 2\n    anms: true\n'
             '  thinned: 2\n')
CALIBRATION = ('image_width: 64\nimage_height: 48\ndistortion_model: plumb_bob\n'
               'distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n'
               'camera_matrix: {rows: 3, cols: 3, data: [30, 0, 32, 0, 30, 24, 0, 0, 1]}\n'
               'rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n'
               'projection_matrix: {rows: 3, cols: 4, data: [30, 0, 32, 0, 0, 30, 24, 0, 0, 0, 1, 0]}\n')
TIMES = '2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.697\n2011-09-26 13:02:26\n'
QUICK = '-d', 'fast', '--points', 20, '--repeats', 1


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A folder with a sound file of every kind."""
    quiet_opencv()      # before the video here is written
    folder = tmp_path_factory.mktemp('whole')
    for suffix in IMAGES:
        cv2.imwrite(str(folder / f'image.{suffix}'), cv2.merge([texture((48, 64))] * 3))
    cv2.imwrite(str(folder / 'other.png'), texture((48, 64), seed=2))
    writer = cv2.VideoWriter(str(folder / 'video.avi'), cv2.VideoWriter.fourcc(*'MJPG'), 10, (64, 48))
    for number in range(4):
        writer.write(cv2.merge([texture((48, 64), seed=number)] * 3))
    writer.release()
    for name, text in (('H.txt', HOMOGRAPHY), ('H.xml', XML), ('detectors.yaml', DETECTORS),
                       ('camera.yaml', CALIBRATION), ('times.txt', TIMES)):
        (folder / name).write_text(text)
    return folder


def damaged(data, generator):
    """The same bytes after one of the things that happen to files."""
    data = bytearray(data)
    kind = generator.integers(9)
    place, length = generator.integers(len(data)), int(generator.integers(1, 40))
    if kind == 0:                      # cut short
        del data[place:]
    elif kind == 1:                    # a block of zeros, as after a power cut
        data[place:] = bytes(len(data) - place)
    elif kind == 2:                    # bits
        for index in generator.integers(len(data), size=length):
            data[index] ^= 1 << generator.integers(8)
    elif kind == 3:                    # something else in its place
        data[place:place + length] = generator.bytes(length)
    elif kind == 4:                    # in its head, where sizes are
        index = int(generator.integers(min(len(data), 64)))
        data[index:index + 4] = generator.choice([b'\xff\xff\xff\x7f', b'\xff\xff\xff\xff', bytes(4), b'99999'])
    elif kind == 5:                    # a part is missing
        del data[place:place + length]
    elif kind == 6:                    # twice
        data[place:place] = data[:length]
    elif kind == 7:                    # another kind of file altogether
        data[:] = generator.choice([b'', b'\n', b'[' * 5000, b'{' * 500, b'\x00' * 100, b'\xff\xd8\xff', b'1e999 ' * 9,
                                    b'GIF89a', b'\x89PNG\r\n\x1a\n', b'#ROSBAG V2.0\n', b'RIFF\x00\x00\x00\x00AVI ',
                                    b'&a [*a]', b'- !!python/object/apply:os.system [false]', b'<a/>', b'9' * 5000])
    else:                              # everything after the head
        data[min(32, len(data)):] = generator.bytes(max(len(data) - 32, 0))
    return bytes(data)


@pytest.fixture
def told(capfd):
    """Runs a tool's function: status and what was said on stderr, by libraries in C too."""
    def run(main, *arguments):
        capfd.readouterr()
        status = main([str(argument) for argument in arguments])
        # OpenCV 4.2 (Noetic) prints what it meets whatever its log level.
        lines = capfd.readouterr().err.splitlines(keepends=True)
        return status, ''.join(line for line in lines if line.strip() and not line.startswith('imdecode_('))
    return run


@pytest.fixture
def check(told):
    def run(tool, main, *arguments):
        status, errors = told(main, *arguments)
        assert status in (0, 2)
        if status == 2:
            assert errors.startswith(f'{tool}: ')
            assert errors.count('\n') == 1
            assert len(errors) < 1500
        return status
    return run


def compare(folder, name):
    """The arguments that have `compare_detectors` read a damaged file."""
    if name.endswith(('.txt', '.xml')):
        return '--pair', folder / 'image.png', folder / 'other.png', folder / name, *QUICK
    if name.endswith('.yaml'):
        return '--pair', folder / 'image.png', folder / 'other.png', folder / 'H.txt', \
            '--detectors-from', folder / name, '--points', 20, '--repeats', 1
    return folder / name, folder / 'other.png', *QUICK


@pytest.mark.parametrize('name', [*(f'image.{suffix}' for suffix in IMAGES), 'video.avi', 'H.txt', 'H.xml',
                                  'detectors.yaml'])
def test_compare_detectors(whole, tmp_path, check, name):
    assert check('compare_detectors', command.main, *compare(whole, name), '--output', tmp_path / 'sound') == 0
    for path in whole.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for seed in range(EACH):
        generator = np.random.default_rng([seed, *name.encode()])
        (tmp_path / name).write_bytes(damaged((whole / name).read_bytes(), generator))
        check('compare_detectors', command.main, *compare(tmp_path, name), '--output', tmp_path / 'out')


@pytest.mark.parametrize('name', [*(f'image.{suffix}' for suffix in IMAGES), 'video.avi', 'camera.yaml',
                                  'times.txt', 'recording.bag'])
def test_make_bag_and_unmake_bag(whole, tmp_path, check, name):
    pytest.importorskip('rosbag', reason='ROS is not installed')
    from rvc_features.recordings import make_bag, unmake_bag
    (tmp_path / 'frames').mkdir()
    for number in range(3):
        cv2.imwrite(str(tmp_path / 'frames' / f'{number:010}.png'), texture((48, 64), seed=number))
    sound = tmp_path / 'sound.bag'
    assert check('make_bag', make_bag.main, sound, tmp_path / 'frames', '--rate', 10) == 0

    for seed in range(EACH):
        generator = np.random.default_rng([seed, *name.encode()])
        path, bag = tmp_path / name, tmp_path / 'made.bag'
        path.write_bytes(damaged((sound if name.endswith('.bag') else whole / name).read_bytes(), generator))
        if name.endswith('.bag'):
            check('unmake_bag', unmake_bag.main, path, tmp_path / f'images{seed}')
            check('compare_detectors', command.main, path, *QUICK, '--output', tmp_path / 'out')
        elif name.endswith('.yaml'):
            check('make_bag', make_bag.main, bag, tmp_path / 'frames', '--camera-info', path, '--force')
        elif name.endswith('.txt'):
            check('make_bag', make_bag.main, bag, tmp_path / 'frames', '--force')
        else:
            check('make_bag', make_bag.main, bag, path, '--force')


@pytest.fixture
def no_waiting():
    """A tool that waits for a pipe fails the test, and doesn't hold up the others."""
    def stop(number, frame):
        raise TimeoutError('it waits')

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures('no_waiting')
@pytest.mark.parametrize('name', ['image.png', 'video.avi', 'recording.bag', 'H.txt', 'detectors.yaml', 'camera.yaml'])
def test_a_pipe_is_not_waited_for(whole, tmp_path, told, name):
    if name.endswith('.bag'):
        pytest.importorskip('rosbag', reason='ROS is not installed')
    os.mkfifo(tmp_path / name)
    for other in ('image.png', 'other.png', 'H.txt'):
        if not (tmp_path / other).exists():
            (tmp_path / other).write_bytes((whole / other).read_bytes())
    if name != 'camera.yaml':
        status, errors = told(command.main, *compare(tmp_path, name), '--output', tmp_path / 'out')
        assert (status, errors.count('\n')) == (2, 1)
        assert f'{name}: a pipe, not a file' in errors
    pytest.importorskip('rosbag', reason='ROS is not installed')
    from rvc_features.recordings import make_bag, unmake_bag
    for main, arguments in {
            'camera.yaml': [(make_bag.main, ('a.bag', whole / 'image.png', '--camera-info', tmp_path / name))],
            'recording.bag': [(unmake_bag.main, (tmp_path / name, tmp_path / 'images'))],
            }.get(name, [(make_bag.main, ('a.bag', tmp_path / name))] if name.startswith(('image', 'video')) else []):
        status, errors = told(main, *arguments)
        assert (status, errors.count('\n')) == (2, 1)
        assert 'a pipe, not a file' in errors
