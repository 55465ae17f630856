"""Bags from anywhere: nothing in them is run, whatever is damaged is said."""

import io
import random
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

rosbag = pytest.importorskip('rosbag')

import genpy  # noqa: E402
import sensor_msgs.msg  # noqa: E402
from quadrant_images import quadrants  # noqa: E402

from rvc_features.image_transport.compressed import to_compressed_message  # noqa: E402
from rvc_features.image_transport.messages import to_image_message  # noqa: E402
from rvc_features.recordings import unmake_bag  # noqa: E402
from rvc_features.recordings.bags import BagImages, image_topics  # noqa: E402
from rvc_features.recordings.image_sources import SourceError  # noqa: E402

SOURCES = Path(__file__).resolve().parents[2] / 'src'


def write_bag(path, count=3, topic='/camera', make=to_image_message, **options):
    with rosbag.Bag(str(path), 'w', **options) as bag:
        for number in range(count):
            bag.write(topic, make(quadrants('bgr8'), 'bgr8'), genpy.Time(100 + number))
    return path


def write_with_definition(path, definition, kind='sensor_msgs/Image', checksum=None):
    """A bag whose messages are right, and whose definition of them is not."""
    image = sensor_msgs.msg.Image
    header = {'topic': '/camera', 'type': kind, 'md5sum': checksum or image._md5sum, 'message_definition': definition}
    data = io.BytesIO()
    to_image_message(quadrants('bgr8'), 'bgr8').serialize(data)
    with rosbag.Bag(str(path), 'w') as bag:
        bag.write('/camera', (kind, data.getvalue(), header['md5sum'], image), genpy.Time(100), raw=True,
                  connection_header=header)
    return path


@pytest.mark.parametrize('make', [to_image_message, to_compressed_message])
@pytest.mark.parametrize('compression', ['none', 'bz2', 'lz4'])
def test_frames(tmp_path, make, compression):
    images = BagImages(write_bag(tmp_path / 'a.bag', make=make, compression=compression))
    assert (images.topic, len(images)) == ('/camera', 3)
    for number, frame in enumerate(images):
        assert (frame.name, frame.time) == (f'a.bag /camera {number}', number)
        np.testing.assert_allclose(frame.image[3, 3].astype(int), quadrants('bgr8')[3, 3], atol=3)
    assert images.skipped == []


def test_code_in_a_definition_is_not_run(tmp_path):
    """In a process of its own: one that has read such a message before has its class already."""
    ran = tmp_path / 'ran'
    code = f"uint8 A;open('{ran}','w');B=1\n"
    bag = write_with_definition(tmp_path / 'a.bag', code + sensor_msgs.msg.Image._full_text)
    script = ("import sys; from rvc_features.recordings.bags import BagImages\n"
              "print([frame.image.shape for frame in BagImages(sys.argv[1])])")
    result = subprocess.run([sys.executable, '-c', script, str(bag)], cwd=SOURCES, capture_output=True, text=True,
                            check=False)
    assert (result.stdout, result.stderr) == ('[(64, 96, 3)]\n', '')
    assert not ran.exists()


@pytest.mark.parametrize(('kind', 'checksum'), [('sensor_msgs/Image', 32 * '0'),
                                                ('sensor_msgs/CompressedImage', sensor_msgs.msg.Image._md5sum)])
def test_another_checksum_is_refused(tmp_path, kind, checksum):
    bag = write_with_definition(tmp_path / 'a.bag', 'uint8 a\n', kind, checksum)
    with pytest.raises(SourceError, match=f'a.bag: messages on /camera are {kind} with checksum {checksum}; only'):
        BagImages(bag)


def test_two_types_on_one_topic(tmp_path):
    with rosbag.Bag(str(tmp_path / 'a.bag'), 'w') as bag:
        bag.write('/camera', to_image_message(quadrants('bgr8'), 'bgr8'), genpy.Time(100))
        bag.write('/camera', sensor_msgs.msg.CameraInfo(), genpy.Time(101), connection_header={
            'topic': '/camera', 'type': 'sensor_msgs/CameraInfo', 'md5sum': sensor_msgs.msg.CameraInfo._md5sum,
            'message_definition': sensor_msgs.msg.CameraInfo._full_text, 'callerid': '/another'})
    images = BagImages(tmp_path / 'a.bag')   # rosbag itself writes the second as if it were the first
    assert len(list(images)) == 1
    assert images.skipped


def test_other_topics_are_not_looked_into(tmp_path):
    with rosbag.Bag(str(tmp_path / 'a.bag'), 'w') as bag:
        bag.write('/camera', to_image_message(quadrants('bgr8'), 'bgr8'), genpy.Time(100))
        bag.write('/info', sensor_msgs.msg.CameraInfo(), genpy.Time(100))
    assert image_topics(tmp_path / 'a.bag') == {'/camera': 1}
    with pytest.raises(SourceError, match='no images on topic /info; its image topics: /camera'):
        BagImages(tmp_path / 'a.bag', '/info')


def test_a_message_that_can_not_be_read_is_skipped(tmp_path):
    with rosbag.Bag(str(tmp_path / 'a.bag'), 'w') as bag:
        for data in (b'', b'\xff' * 30, b'\0' * 30):
            bag.write('/camera', ('sensor_msgs/Image', data, sensor_msgs.msg.Image._md5sum, sensor_msgs.msg.Image),
                      genpy.Time(100), raw=True)
        bag.write('/camera', to_image_message(quadrants('bgr8'), 'bgr8'), genpy.Time(100))
    images = BagImages(tmp_path / 'a.bag')
    assert [frame.name for frame in images] == ['a.bag /camera 3']
    assert [text[:15] for text in images.skipped] == ['a.bag /camera 0', 'a.bag /camera 1', 'a.bag /camera 2']


def test_an_old_bag_is_named(tmp_path):
    (tmp_path / 'old.bag').write_bytes(b'#ROSRECORD V1.2\n' + b'\x45\0\0\0' + bytes(200))
    with pytest.raises(SourceError, match=r'old.bag: (a bag of format 1.2|not a bag|this bag has no index)'):
        BagImages(tmp_path / 'old.bag')


def test_damaged_bags_end_in_a_sentence(tmp_path, capfd):
    """A hundred and fifty: bytes changed, zeroed, cut out, cut off."""
    chance = random.Random(0)
    whole = write_bag(tmp_path / 'whole.bag', 2, make=to_compressed_message).read_bytes()
    path = tmp_path / 'a.bag'
    refused, read = [], 0
    for number in range(150):
        data = bytearray(whole)
        begin = chance.randrange(len(data))
        size = chance.choice([1, 4, 200])
        if number % 3 == 0:
            data[begin:begin + size] = bytes(chance.randrange(256) for _ in range(size))
        elif number % 3 == 1:
            del data[begin:begin + size]
        else:
            del data[begin:]
        path.write_bytes(data)
        try:
            list(BagImages(path))
            read += 1
        except SourceError as error:
            refused.append(str(error))
    assert len(refused) > 50
    assert read > 10
    assert all(text.startswith(f'{path}: ') and '\n' not in text for text in refused)
    assert capfd.readouterr() == ('', '')


def test_a_video_that_has_no_room_is_an_error_and_leaves_nothing(tmp_path, capfd):
    recording, video = tmp_path / 'recording.bag', tmp_path / 'video.avi'
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    with rosbag.Bag(str(recording), 'w') as bag:
        for second in range(1, 6):
            bag.write('/camera', to_image_message(noise, 'bgr8'), genpy.Time(second))
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, unlimited[1]))   # what a full disk looks like to a writer
    try:
        assert unmake_bag.main([str(recording), str(video)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert 'could not be written whole; is the disk full?' in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == [recording]
    assert unmake_bag.main([str(recording), str(video)]) == 0
