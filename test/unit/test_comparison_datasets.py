"""What inputs are taken for, the pairs that come out, and the errors for what can't be used."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features.comparison import datasets, inputs, warps
from rvc_features.comparison.datasets import FRAMES, SEQUENCE, Options
from rvc_features.comparison.homographies import HomographyError, project
from rvc_features.comparison.inputs import open_inputs
from rvc_features.recordings.image_sources import SourceError

SHIFT = '1 0 4\n0 1 -3\n0 0 1\n'


def write_sequence(folder, count=3, image='img{}.png', homography='H1to{}p', text=SHIFT):
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, count + 1):
        grey = texture(seed=number)
        path = folder / image.format(number)
        # OpenCV writes no grey PPM; three equal colours are read as the same grey.
        assert cv2.imwrite(str(path), cv2.merge([grey] * 3) if path.suffix == '.ppm' else grey)
        if number > 1:
            (folder / homography.format(number)).write_text(text)
    return str(folder)


def pairs_of(path, **options):
    opened = open_inputs([str(path)], Options(**options))
    return opened, [pair for dataset in opened for pair in dataset.pairs()]


@pytest.mark.parametrize(('image', 'homography'), [
    ('img{}.png', 'H1to{}p'), ('img{}.ppm', 'H1to{}p'), ('img{}.pgm', 'H1to{}p'), ('img{}.png', 'H1to{}p.txt'),
    ('{}.ppm', 'H_1_{}'), ('{}.png', 'H_1_{}')])
def test_sequences_of_both_layouts(tmp_path, image, homography):
    folder = write_sequence(tmp_path / 'wall', 3, image, homography)
    (dataset,), pairs = pairs_of(folder)
    assert (dataset.name, dataset.kind, dataset.count) == ('wall', SEQUENCE, 2)
    assert [(pair.group, pair.name, pair.change) for pair in pairs] == [('wall', '1 to 2', 2), ('wall', '1 to 3', 3)]
    assert (pairs[1].first == texture(seed=1)).all()
    assert (pairs[1].second == texture(seed=3)).all()
    np.testing.assert_allclose(pairs[0].homography, [[1, 0, 4], [0, 1, -3], [0, 0, 1]])


def test_jpeg_and_xml(tmp_path):
    xml = ('<opencv_storage><H type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'
           '<data>1 0 4 0 1 -3 0 0 1</data></H></opencv_storage>')
    folder = write_sequence(tmp_path / 'wall', 2, 'img{}.jpg', 'H1to{}p.xml', xml)
    _, (pair,) = pairs_of(folder)
    assert pair.homography[0].tolist() == [1, 0, 4]


def test_a_folder_of_sequences(tmp_path):
    write_sequence(tmp_path / 'all' / 'boat')
    write_sequence(tmp_path / 'all' / 'graf', 2, '{}.ppm', 'H_1_{}')
    (tmp_path / 'all' / 'notes').mkdir()
    opened, pairs = pairs_of(tmp_path / 'all')
    assert [dataset.name for dataset in opened] == ['boat', 'graf']
    assert len(pairs) == 3


def test_under_the_identity_the_second_image_is_cropped(tmp_path):
    folder = write_sequence(tmp_path / 'light', 2, text='2 0 0\n0 2 0\n0 0 2\n')
    _, (pair,) = pairs_of(folder)
    assert pair.second.shape == (120 - 23, 160 - 37)
    assert (pair.second == texture(seed=2)[23:, 37:]).all()
    np.testing.assert_allclose(project(pair.homography, np.array([[50, 60.0]])), [[13, 37]])
    assert 'cropped by 37 pixels on the left and 23 at the top' in pair.note

    _, (whole,) = pairs_of(folder, crop_identity=False)
    assert whole.second.shape == (120, 160)
    assert not whole.note


def test_an_image_and_itself_are_not_cropped(tmp_path):
    folder = write_sequence(tmp_path / 'same', 2, text='1 0 0\n0 1 0\n0 0 1\n')
    cv2.imwrite(f'{folder}/img2.png', texture(seed=1))
    _, (pair,) = pairs_of(folder)
    assert (pair.second == pair.first).all()


def test_a_missing_homography_is_named(tmp_path):
    folder = write_sequence(tmp_path / 'boat')
    (tmp_path / 'boat' / 'H1to3p').unlink()
    with pytest.raises(SourceError, match=r'boat/H1to3p: the homography from image 1 to image 3 is missing; .*three '
                                          r'lines of three numbers.*--kind images'):
        pairs_of(folder)
    (tmp_path / 'boat' / 'H1to2p').unlink()     # with none at all it still looks like a sequence
    with pytest.raises(SourceError, match='boat/H1to2p: the homography from image 1 to image 2 is missing'):
        pairs_of(folder)
    (dataset,), _ = pairs_of(folder, kind='images')
    assert dataset.kind == FRAMES


def test_a_missing_image_of_a_sequence_is_named(tmp_path):
    folder = write_sequence(tmp_path / 'boat')
    (tmp_path / 'boat' / 'img3.png').unlink()
    with pytest.raises(SourceError, match=r'boat/img3\.\*: image 3 of the sequence is missing'):
        pairs_of(folder)


def test_a_bad_homography_is_named_before_any_work(tmp_path):
    folder = write_sequence(tmp_path / 'boat')
    (tmp_path / 'boat' / 'H1to3p').write_text('1 1 0\n1 1 0\n0 0 1\n')
    with pytest.raises(HomographyError, match='boat/H1to3p: the matrix is singular'):
        open_inputs([folder], Options())


def test_a_homography_that_leads_nowhere_is_named(tmp_path):
    folder = write_sequence(tmp_path / 'boat', 2, text='1 0 5000\n0 1 0\n0 0 1\n')
    with pytest.raises(HomographyError, match='boat/H1to2p: under this homography the two images share no region'):
        pairs_of(folder)


@pytest.mark.parametrize('extension', ['png', 'jpg', 'ppm'])
def test_a_truncated_image_is_named(tmp_path, extension):
    folder = write_sequence(tmp_path / 'boat', 2, 'img{}.' + extension)
    path = tmp_path / 'boat' / f'img2.{extension}'
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(SourceError, match=rf'boat/img2\.{extension}: .*cut short.*accepted'):
        pairs_of(folder)


def test_images_make_frames_in_natural_order(tmp_path):
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f'frame{number}.png'), texture(seed=number))
    (dataset,), pairs = pairs_of(tmp_path)
    assert (dataset.kind, dataset.count) == (FRAMES, 3)
    assert [pair.name for pair in pairs] == ['frame1.png', 'frame2.png', 'frame10.png']
    assert (pairs[0].second == pairs[1].first).all()
    assert pairs[2].second is None
    assert all(pair.homography is None for pair in pairs)

    files = [str(tmp_path / f'frame{number}.png') for number in (10, 1)]
    (dataset,) = open_inputs(files, Options())
    assert [pair.name for pair in dataset.pairs()] == ['frame10.png', 'frame1.png']


def test_every_and_maximum_frames(tmp_path):
    for number in range(7):
        cv2.imwrite(str(tmp_path / f'{number}.png'), texture(seed=number))
    (dataset,), pairs = pairs_of(tmp_path, every=2)
    assert [pair.name for pair in pairs] == ['0.png', '2.png', '4.png', '6.png']
    assert dataset.count == 4
    (dataset,), pairs = pairs_of(tmp_path, every=3, maximum_frames=2)
    assert [pair.name for pair in pairs] == ['0.png', '3.png']
    assert dataset.count == 2


def test_images_of_different_sizes_are_not_tracked(tmp_path):
    cv2.imwrite(str(tmp_path / 'a.png'), texture())
    cv2.imwrite(str(tmp_path / 'b.png'), texture((90, 100)))
    _, pairs = pairs_of(tmp_path)
    assert [pair.second is None for pair in pairs] == [True, True]


def test_a_video(tmp_path):
    path = tmp_path / 'drive.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 25, (160, 120))
    for number in range(4):
        writer.write(cv2.cvtColor(texture(seed=number), cv2.COLOR_GRAY2BGR))
    writer.release()
    (dataset,), pairs = pairs_of(path)
    assert (dataset.name, dataset.kind, dataset.count, len(pairs)) == ('drive.avi', FRAMES, 4, 4)
    assert pairs[0].first.shape == (120, 160)


def test_a_bag_with_a_bad_frame(tmp_path):
    rosbag = pytest.importorskip('rosbag', reason='reading bags needs ROS, which is not here')
    from sensor_msgs.msg import CompressedImage, Image
    path = tmp_path / 'drive.bag'
    with rosbag.Bag(str(path), 'w') as bag:
        for number in range(4):
            data = cv2.imencode('.jpg', texture(seed=number))[1].tobytes()
            bag.write('/camera/image/compressed',
                      CompressedImage(format='jpeg', data=data[:100] if number == 1 else data))
        image = texture()
        bag.write('/depth', Image(height=120, width=160, step=160, encoding='mono8', data=image.tobytes()))
    (dataset,), pairs = pairs_of(path, topic='/camera/image/compressed')
    assert [pair.name[-1] for pair in pairs] == ['0', '2', '3']
    assert len(dataset.skipped) == 1
    assert '/camera/image/compressed 1: ' in dataset.skipped[0]
    _, (raw,) = pairs_of(path, topic='/depth')
    assert (raw.first == image).all()
    for topic in ('', '/camera'):
        with pytest.raises(SourceError, match=r'drive.bag: .*image topics: /camera/image/compressed, /depth'):
            pairs_of(path, topic=topic)


def test_bad_paths_are_named_with_what_is_accepted(tmp_path):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.txt').write_text('hello')
    (tmp_path / 'some').mkdir()
    cv2.imwrite(str(tmp_path / 'some' / 'a.png'), texture())
    for name, kind, text in (('missing', 'auto', 'missing: no such file or folder'),
                             ('empty', 'auto', r'empty: there are no images in this folder \(it is empty\)'),
                             ('empty', 'images', 'empty: there are no images'),
                             ('some', 'sequence', 'some: there are no sequence with ground truth'),
                             ('some', 'video', 'some: a folder, not a video'),
                             ('text.txt', 'images', 'text.txt: can not be taken as images'),
                             ('text.txt', 'auto', 'text.txt: not a video that OpenCV can read')):
        with pytest.raises(SourceError, match=text) as error:
            pairs_of(tmp_path / name, kind=kind)
        assert datasets.ACCEPTED in str(error.value)


def test_names_of_data_sets_differ(tmp_path):
    paths = [write_sequence(tmp_path / parent / 'boat', 2) for parent in ('a', 'b')]
    assert [dataset.name for dataset in open_inputs(paths, Options())] == ['boat', 'boat (2)']


# One photograph under known changes ---------------------------------------------------------------------------------

def test_all_changes_are_made_and_known(tmp_path):
    path = tmp_path / 'photo.png'
    cv2.imwrite(str(path), texture((240, 330), smoothing=2.5))
    dataset = inputs.synthetic(str(path), Options())
    pairs = list(dataset.pairs())
    assert len(pairs) == dataset.count > 30
    assert {pair.group for pair in pairs} == set(warps.KINDS)
    assert all(pair.first.shape == (160, 220) for pair in pairs)
    assert pairs[0].name == 'photo, 5 degrees'
    again = list(inputs.synthetic(str(path), Options()).pairs())
    assert all((a.second == b.second).all() for a, b in zip(pairs, again))


@pytest.mark.parametrize(('kind', 'amount'), [('rotation', 30), ('zoom', 0.8), ('zoom', 1.25), ('tilt', 30),
                                              ('jpeg', 90), ('light', 0.75), ('noise', 2)])
def test_the_homography_is_what_was_drawn(kind, amount):
    photograph = texture((300, 360), smoothing=6.0)
    first = warps.reference(photograph)
    second, homography = warps.warped(photograph, kind, amount)
    back = cv2.warpPerspective(second, homography, first.shape[::-1],
                               flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderValue=0)
    seen = cv2.erode(cv2.warpPerspective(np.full(second.shape, 255, np.uint8), homography, first.shape[::-1],
                                         flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP), np.ones((9, 9))) > 0
    if kind == 'light':
        back = back / amount
    assert seen.mean() > 0.3
    assert np.abs(back[seen].astype(float) - first[seen]).mean() < 2.5


def test_neither_image_is_smoother_than_the_other():
    # A warped copy of the first image would lose fine detail, and gain those detectors that smooth.
    photograph = texture((450, 450), smoothing=1.0)
    sharpness = [cv2.Laplacian(image[60:-60, 60:-60], cv2.CV_64F).std()
                 for image in (warps.reference(photograph), warps.warped(photograph, 'rotation', 30)[0])]
    assert sharpness[1] == pytest.approx(sharpness[0], rel=0.05)


def test_a_fixed_grid_of_points_is_not_repeatable_where_nothing_moves():
    second, homography = warps.warped(texture((300, 360)), 'noise', 5)
    assert second.shape == (200 - 23, 240 - 37)
    assert homography.tolist() == [[1, 0, -37], [0, 1, -23], [0, 0, 1]]


def test_a_photograph_that_is_too_small(tmp_path):
    cv2.imwrite(str(tmp_path / 'small.png'), texture((50, 60)))
    with pytest.raises(SourceError, match=r'small.png: the photograph is 60x50 pixels; it must be at least 96'):
        inputs.synthetic(str(tmp_path / 'small.png'), Options())


def test_the_generated_photograph_has_corners():
    picture = warps.generated_photograph()
    assert (picture == warps.generated_photograph()).all()
    assert picture.std() > 30
    assert len(cv2.goodFeaturesToTrack(picture, 2000, 0.01, 3)) > 500
