"""What is handed to the decoders, what is kept from them, and what is seen of damage."""

import multiprocessing
import os
import struct
import threading
import zlib

import cv2
import hostile_images as hostile
import numpy as np
import pytest
from conftest import texture
from hostile_images import COLOUR, COLOUR_420, END, START, chunk, flat_jpeg, frame, png, progressive_jpeg, segment

from rvc_features import still_images
from rvc_features.still_images import StillImageError, TooLargeError, decoder_warnings

PICTURE = cv2.applyColorMap(texture((240, 320), smoothing=2), cv2.COLORMAP_JET)


def encoded(extension='.jpg', image=PICTURE, *parameters):
    return cv2.imencode(extension, image, parameters)[1].tobytes()


def read(data, **limit):
    return still_images.decode(still_images.check(data, **limit))


@pytest.mark.parametrize(('extension', 'parameters'), [
    ('.jpg', ()), ('.jpg', (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)), ('.jpg', (cv2.IMWRITE_JPEG_RST_INTERVAL, 4)),
    ('.jpg', (cv2.IMWRITE_JPEG_OPTIMIZE, 1)), ('.png', ()), ('.png', (cv2.IMWRITE_PNG_COMPRESSION, 0))])
@pytest.mark.parametrize('image', [PICTURE, PICTURE[..., 1], PICTURE[:1, :1], PICTURE[:7, :, 0]],
                         ids=['colour', 'grey', 'one pixel', 'low'])
def test_pixels_are_those_of_the_decoder_alone(extension, parameters, image):
    data = encoded(extension, image, *parameters)
    still = still_images.check(data)
    array = still_images.decode(still)
    np.testing.assert_array_equal(array, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
    assert (still.kind, still.bits) == ({'.jpg': 'jpeg', '.png': 'png'}[extension], 8)
    assert (still.height, still.width, still.channels) == (*image.shape, 1)[:3]
    assert still_images.kind(data) == still_images.kind(still.data) == still.kind


@pytest.mark.parametrize('transparent', [False, True])
@pytest.mark.parametrize(('colour', 'bits'), [(0, 1), (0, 2), (0, 4), (0, 8), (0, 16), (2, 8), (2, 16), (3, 1), (3, 8),
                                              (4, 8), (4, 16), (6, 8), (6, 16)])
def test_every_kind_of_png(colour, bits, transparent):
    if transparent and colour > 3:
        pytest.skip('has an alpha channel already')
    transparency = chunk(b'tRNS', {0: bytes(2), 2: bytes(6), 3: bytes(1)}[colour]) if transparent else b''
    data = png(13, 9, bits, colour, (chunk(b'PLTE', bytes(3 << bits)) if colour == 3 else b'') + transparency)
    still = still_images.check(data)
    array = still_images.decode(still)
    assert (*array.shape, 1)[:3] == (9, 13, still.channels)
    assert 8 * array.itemsize == still.bits == max(8, bits)
    np.testing.assert_array_equal(array, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


def test_interlaced_png():
    rows = b''.join(bytes([0, *range(1, columns + 1)]) * lines
                    for columns, lines in ((1, 1), (1, 1), (2, 1), (2, 2), (4, 1), (3, 3), (7, 2)))   # 7 x 5 pixels
    data = (hostile.PNG_SIGNATURE + chunk(b'IHDR', struct.pack('>IIBBBBB', 7, 5, 8, 0, 0, 0, 1))
            + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND'))
    np.testing.assert_array_equal(read(data), cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


# ---- What is kept from the decoder ----

def test_an_animation_is_its_first_image():
    still = still_images.check(hostile.animated_png())   # OpenCV 4.11 crashes on it as it is
    for name in (b'acTL', b'fcTL', b'fdAT'):
        assert name not in still.data
    assert still_images.decode(still).shape == (4, 4, 4)


def test_text_profiles_and_times_are_dropped():
    before = b''.join(chunk(name, b'x' * 20) for name in (b'tEXt', b'iCCP', b'eXIf', b'tIME', b'gAMA', b'prVt'))
    still = still_images.check(png(5, 4, before=before) + b'and something after the end')
    assert still.data == still_images.check(png(5, 4)).data
    data, plain = encoded(), still_images.check(encoded()).data
    for marker, body in ((0xE1, b'Exif\0\0' + bytes(50)), (0xFE, b'a comment \xff\xc0\xff\xd9'),
                         (0xE2, b'ICC_PROFILE\0'), (0xE0, b'AVI1' + bytes(10)), (0xED, bytes(300))):
        with_more = data[:2] + segment(marker, body) + data[2:]
        assert still_images.check(with_more).data == plain
    assert still_images.check(data + b'a second image, as cameras append' + data).data == plain


def test_orientation_is_that_of_the_sensor():
    exif = b'Exif\0\0MM\0*\0\0\0\x08' + struct.pack('>HHHIHHI', 1, 0x112, 3, 1, 6, 0, 0)
    still = still_images.check(START + segment(0xE1, exif) + encoded()[2:])
    for flags in (cv2.IMREAD_UNCHANGED, cv2.IMREAD_GRAYSCALE, cv2.IMREAD_COLOR):
        assert still_images.decode(still, flags).shape[:2] == PICTURE.shape[:2]


def test_what_decides_the_colours_is_kept():
    data = encoded()
    jfif = data.index(b'\xff\xe0')
    without = data[:jfif] + data[jfif + 18:]
    adobe = {transform: START + segment(0xEE, b'Adobe\0\x64\0\0\0\0' + bytes([transform]) + b'more') + without[2:]
             for transform in (0, 1)}
    for variant in (data, without, *adobe.values()):
        np.testing.assert_array_equal(read(variant), cv2.imdecode(np.frombuffer(variant, np.uint8), -1))
    assert (read(adobe[0]) != read(adobe[1])).any(), 'RGB or YCbCr'


def test_fill_bytes_and_restart_markers_between_segments_mean_nothing():
    data = encoded()
    assert still_images.check(data[:2] + b'\xff\xd0\xff\xff\xff\x01' + data[2:]).data == still_images.check(data).data


# ---- Budget ----

def second_frame_behind(small):
    """A large image that a reader finds who takes what comes first for the frame header."""
    return flat_jpeg(30000, 30000, before=small)


@pytest.mark.parametrize(('data', 'error', 'text'), [
    (second_frame_behind(b''), TooLargeError, '30000 x 30000 pixels: more than 25 megapixels'),
    (second_frame_behind(frame(8, 8)), StillImageError, 'two frame headers'),
    (second_frame_behind(b'\xff\xd0'), TooLargeError, '30000 x 30000'),
    (second_frame_behind(b'\xff\xd0\0\x20' + bytes(9)), StillImageError, 'no segment at byte 4'),
    (second_frame_behind(segment(0xFE, frame(8, 8))), TooLargeError, '30000 x 30000'),
    (flat_jpeg(8, 8, before=frame(8, 8)), StillImageError, 'two frame headers'),
    (flat_jpeg(8, 8)[:-2] + frame(30000, 30000) + END, StillImageError, 'two frame headers'),
    (flat_jpeg(8, 8)[:-2] + flat_jpeg(8, 8)[2:], StillImageError, 'two frame headers'),
    (progressive_jpeg(64, 64, 101), TooLargeError, 'JPEG of 101 scans over 64 x 64 pixels'),
    (progressive_jpeg(4000, 4000, 30), TooLargeError, 'JPEG of 26 scans over 4000 x 4000 pixels'),
    (progressive_jpeg(5000, 5000, 3, COLOUR), TooLargeError, '5000 x 5000 pixels of 9 bytes'),
    (png(5000, 5000, 16, 2), TooLargeError, '5000 x 5000 pixels of 6 bytes: more than 25 megapixels of 4 bytes'),
    (png(1, 150_000), TooLargeError, '1 x 150000 pixels'),
    (png(8, 8, pixels=zlib.compress(bytes(1 << 26))), StillImageError, 'more than 72 bytes of pixels'),
    (png(8, 8, before=chunk(b'IDAT') * 70_000), TooLargeError, '65536 chunks'),
    (flat_jpeg(8, 8, before=segment(0xFE, b'') * 2000), TooLargeError, '1000 segments')])
def test_what_is_too_large_or_claims_two_sizes(data, error, text):
    with pytest.raises(error, match=text):
        still_images.check(data)


def test_cameras_pass():
    for data, shape in ((flat_jpeg(6016, 4016, COLOUR_420), (4016, 6016, 3)), (flat_jpeg(8192, 2), (2, 8192)),
                        (progressive_jpeg(3840, 2160, 12, COLOUR_420), (2160, 3840, 3)),
                        (png(3840, 2160, 16), (2160, 3840))):
        assert read(data).shape == shape


def test_the_limit_may_be_another():
    data = flat_jpeg(1100, 1000)
    assert read(data, megapixels=1.1).shape == (1000, 1100)
    with pytest.raises(TooLargeError, match='1100 x 1000 pixels: more than 1 megapixels'):
        read(data, megapixels=1.0)


# ---- Damage ----

def without(data, begin, count):
    return data[:begin] + data[begin + count:]


@pytest.mark.parametrize(('data', 'text'), [
    (b'', 'neither JPEG nor PNG: 0 bytes that begin with nothing'),
    (b'GIF89a', '474946383961'),
    (START + b'\xff', 'truncated JPEG'),
    (encoded()[:-2], 'truncated JPEG'),
    (encoded()[:300], 'truncated JPEG: segment'),
    (START + b'\xff\xc0\0\1', 'segment c0 of 1 bytes'),
    (START + END, 'neither|ends before any pixels'),
    (START + segment(0xFE, b'') + END, 'ends before any pixels'),
    (START + hostile.tables() + hostile.scan([1]) + END, 'without a frame header'),
    (START + hostile.tables() + frame(8, 8) + END, 'ends before any pixels'),
    (START + segment(0xC0, b'\x08') + END, 'frame header of 1 bytes'),
    (START + frame(0, 8) + END, '0 x 8 pixels'),
    (START + frame(8, 8, (0x11, 0x11)) + END, '2 components'),
    (START + frame(8, 8, (0x51,)) + END, r'1 components sampled \(\(5, 1\),\)'),
    (START + frame(8, 8, bits=12) + END, 'JPEG of 12 bits; only 8 can be read, PNG has 16'),
    (START + frame(8, 8, marker=0xC9) + END, r'of a kind \(SOF9\) that is not read'),
    (START + segment(0x4F, b'') + END, 'unknown segment 4f'),
    (encoded('.png')[:-13], 'truncated PNG'),
    (hostile.PNG_SIGNATURE + chunk(b'IEND'), "begins with 0 bytes of b'IEND'"),
    (png(8, 8, 5), '8 x 8 pixels of type 0 with 5 bits'),
    (png(8, 8, pixels=zlib.compress(bytes(71))), '71 bytes of pixels instead of 72'),
    (png(8, 8, pixels=zlib.compress(bytes(72))[:-4]), 'instead of 72'),
    (png(8, 8, pixels=b'no stream'), 'corrupt PNG: Error -3'),
    (png(8, 8, before=chunk(b'ABCD')), "chunk b'ABCD', unknown"),
    (png(8, 8, before=chunk(b'PLTE', bytes(3)) * 2), "chunk b'PLTE', .* once too often"),
    (png(8, 8).replace(b'IDAT', b'IDAS'), 'checksum'),
    (without(png(8, 8), 40, 1), 'PNG')])
def test_what_is_no_image(data, text, capfd):
    with pytest.raises(StillImageError, match=text):
        read(data)
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('parameters', [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 8)],
                         ids=['baseline', 'progressive', 'with restarts'])
def test_a_damaged_jpeg_is_refused_and_nothing_is_written_to_the_terminal(parameters, capfd):
    """The decoder fills up with grey what it can't read, and warns of it on stderr only."""
    data = encoded('.jpg', PICTURE, *parameters)
    pixels = data.index(b'\xff\xda') + 14
    for begin in range(pixels, len(data) - 3000, (len(data) - pixels) // 12):
        with pytest.raises(StillImageError, match='JPEG: '):
            read(without(data, begin, 2000))
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('padding', [b'\0', bytes(16), b'\x55' * 5])
def test_a_few_bytes_before_the_end_as_many_cameras_write_them(padding, capfd):
    np.testing.assert_array_equal(read(encoded()[:-2] + padding + END), read(encoded()))
    assert capfd.readouterr().err == ''


def test_a_camera_that_leaves_out_the_selection_of_a_scan():
    data = bytearray(encoded())
    scan = data.index(b'\xff\xda')
    data[scan + 11:scan + 14] = bytes(3)
    np.testing.assert_array_equal(read(bytes(data)), read(encoded()))


def test_warnings_are_those_of_the_image_at_hand():
    """Whichever threads decode at the same time, and in a process that was forked."""
    good, bad = encoded(), without(encoded(), 2000, 2000)
    outcomes = {True: [], False: []}

    def read_often(data):
        for _ in range(30):
            try:
                read(data)
                outcomes[data is good].append('read')
            except StillImageError:
                outcomes[data is good].append('refused')

    threads = [threading.Thread(target=read_often, args=[data]) for data in (good, bad, good, bad)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes == {True: ['read'] * 60, False: ['refused'] * 60}
    with multiprocessing.get_context('fork').Pool(1) as pool:
        assert pool.apply(_refuses, [bad])
        assert not pool.apply(_refuses, [good])


def _refuses(data):
    try:
        read(data)
    except StillImageError:
        return True
    return False


def test_what_others_write_meanwhile_reaches_the_terminal(capfd):
    import ctypes
    library = ctypes.CDLL(None)
    with decoder_warnings.heard() as heard:
        library.fputs.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
        library.fputs(b'libpng error: mine\nnone of the decoders\n', ctypes.c_void_p.in_dll(library, 'stderr'))
        os.write(2, b'straight to the descriptor\n')
    assert heard.lines == ['libpng error: mine']
    assert heard.damage() == 'mine'
    assert capfd.readouterr().err == 'straight to the descriptor\nnone of the decoders\n'
