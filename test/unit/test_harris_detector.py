"""The sheet's HarrisDetector by geometry: corners are found where they are; what is done to the image happens to them.

test_repeatable.py has what differs by default.
"""

import dataclasses

import cv2
import numpy as np
import pytest
from conftest import draw_polygon, draw_square, positions, texture

from rvc_features import key_points, response
from rvc_features.harris_detector import HarrisDetector

SQUARE_CORNERS = [(20, 20), (20, 39), (39, 20), (39, 39)]


def sheet_detector(**values):
    """What the sheet has, with positions between the pixels."""
    sheet = {'strength': 'harris', 'evenness': 0.0, 'threshold': 0.01, 'border': 0, 'anms_pool': 0.0,
             'orientation_sigma': 2.5}
    return HarrisDetector(**{**sheet, **values})


def whole_pixels(points):
    return sorted((float(x), float(y)) for x, y in positions(points))


def nearest(points, targets):
    """Distance from each target to the nearest key point."""
    difference = positions(points)[None] - np.asarray(targets)[:, None]
    return np.hypot(difference[..., 0], difference[..., 1]).min(axis=1)


@pytest.mark.parametrize('window', ['gaussian', 'box'])
@pytest.mark.parametrize('window_size', [3, 5])
def test_a_square_has_four_corners(square, window_size, window):
    points = sheet_detector(window_size=window_size, window=window, threshold=0.1).detect_arrays(square)
    assert len(points) == 4
    assert nearest(points, SQUARE_CORNERS).max() <= 1.5


def test_a_triangle_has_three_corners():
    vertices = [(60, 50), (250, 90), (120, 200)]
    points = sheet_detector(window_size=5, threshold=0.1).detect_arrays(draw_polygon(vertices))
    assert len(points) == 3
    assert nearest(points, vertices).max() < 3


@pytest.mark.parametrize('value', [0, 128, 255])
def test_flat_image_has_no_points(value):
    image = np.full((50, 60), value, np.uint8)
    for parameters in ({}, {'fixed_number_of_points': True}, {'anms': True}, {'octaves': 4}):
        assert sheet_detector(**parameters).detect(image) == []


@pytest.mark.parametrize('shape', [(1, 1), (1, 50), (50, 1), (2, 3), (7, 7), (16, 15)])
@pytest.mark.parametrize('parameters', [{}, {'octaves': 5, 'anms': True}, {'window_size': 31, 'octaves': 3}])
def test_tiny_images(shape, parameters):
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    points = sheet_detector(**parameters).detect_arrays(image)
    assert (points['x'] >= 0).all()
    assert (points['x'] <= shape[1] - 1).all()
    assert (points['y'] <= shape[0] - 1).all()


@pytest.mark.parametrize('parameters', [
    {}, {'fixed_number_of_points': True, 'number_of_points': 40}, {'anms': True, 'anms_points': 40},
    {'window': 'box', 'subpixel': False}])
def test_points_move_with_the_image(parameters):
    image = texture((160, 200))
    dx, dy = 23, 14
    detector = sheet_detector(**{'border': 20, 'threshold': 0.05, **parameters})
    first = detector.detect_arrays(image[:-dy, :-dx])
    moved = detector.detect_arrays(image[dy:, dx:])
    if parameters.get('anms') or parameters.get('fixed_number_of_points'):
        return_rate = np.mean([nearest(moved, [p]) < 1e-3 for p in positions(first) - (dx, dy)
                               if (p >= 20).all() and p[0] < 157 and p[1] < 126])
        assert return_rate > 0.7   # those near the rim compete with others
    else:
        inside = [p for p in positions(first) - (dx, dy) if (p >= 20).all()]
        threshold = detector.threshold * max(first['response'].max(), moved['response'].max())
        strong = [p for p, r in zip(positions(first) - (dx, dy), first['response'])
                  if (p >= 20).all() and r > threshold]
        assert len(inside) > 20
        assert nearest(moved, strong).max() < 1e-3


def test_quarter_turn_turns_the_points():
    image = texture((120, 160))
    detector = sheet_detector(threshold=0.02)
    points, turned = detector.detect_arrays(image), detector.detect_arrays(np.rot90(image).copy())
    expected = np.column_stack((points['y'], 159 - points['x']))
    assert len(points) == len(turned) > 30
    assert nearest(turned, expected).max() < 0.01
    order = [np.argmin(np.hypot(*(positions(turned) - p).T)) for p in expected]
    difference = (turned['angle'][order] - points['angle'] + 90 + 180) % 360 - 180
    # Half way between two pixels the orientation's kernel has its middle on either of them, and ends at three sigma.
    is_halfway = (positions(points) % 1 == 0.5).any(axis=1)
    assert np.abs(difference[~is_halfway]).max() < 1
    assert np.abs(difference[is_halfway]).max() < 2


def test_enlarged_image_enlarges_positions():
    corners = np.array([(50, 40), (110, 40), (110, 80), (50, 80)])
    detector = sheet_detector(threshold=0.2, window_size=5)
    small, large = (detector.detect_arrays(draw_polygon(corners * scale)) for scale in (1, 2))
    assert len(small) == len(large) == 4
    inset_small = np.abs(positions(small) - [80, 60]).mean(axis=0) - [30, 20]
    inset_large = np.abs(positions(large) - [160, 120]).mean(axis=0) - [60, 40]
    assert np.allclose(inset_small, inset_large, atol=0.2)


@pytest.mark.parametrize('octave', [0, 1, 2, 3])
@pytest.mark.parametrize('centre', [(80, 72), (83, 75), (86.5, 77.5), (81.3, 70.8)])
def test_octaves_see_a_spot_in_the_same_place(octave, centre):
    """A round spot about as large as the window is one corner, in its middle, in the octave of its size."""
    y, x = np.indices((160, 176))
    distance = (x - centre[0]) ** 2 + (y - centre[1]) ** 2
    image = np.rint(40 + 180 * np.exp(-distance / (2 * (1.5 * 2 ** octave) ** 2))).astype(np.uint8)
    points = sheet_detector(octaves=4, window_size=7, fixed_number_of_points=True).detect_arrays(image)
    here = points[points['octave'] == octave]
    assert nearest(here, [centre]) < 0.5
    assert np.unique(here['size']).tolist() == [7 * 2 ** octave]


def test_octaves_are_filtered_together():
    image = texture((240, 320), smoothing=4)
    every = sheet_detector(octaves=3, fixed_number_of_points=True, number_of_points=100000).detect_arrays(image)
    assert set(every['octave']) == {0, 1, 2}
    few = sheet_detector(octaves=3, fixed_number_of_points=True, number_of_points=25).detect_arrays(image)
    assert np.array_equal(few, every[:25])
    threshold = sheet_detector(octaves=3, threshold=0.3).detect_arrays(image)
    assert np.array_equal(threshold, every[every['response'] > np.float64(0.3) * every['response'].max()])
    anms = sheet_detector(octaves=3, anms=True, anms_points=60).detect_arrays(image)
    assert len(anms) == 60
    assert len(set(anms['octave'])) > 1


def test_threshold_is_relative_and_the_minimum_absolute():
    image = np.zeros((60, 120), np.uint8)
    image[20:40, 20:40] = 200
    image[20:40, 80:100] = 20
    assert len(sheet_detector(threshold=0.1).detect(image)) == 4
    assert len(sheet_detector(threshold=0.0).detect(image)) == 8
    weak = sheet_detector(threshold=0.0).detect_arrays(image)['response'].min()
    assert len(sheet_detector(threshold=0.0, minimum_response=float(weak) * 1.01).detect(image)) < 8
    faint = np.where(image == 200, 1, 0).astype(np.uint8)
    assert sheet_detector(threshold=0.0, minimum_response=1000.0).detect(faint) == []
    assert len(sheet_detector(threshold=0.0, minimum_response=0.0, window_size=3).detect(faint)) >= 4


def test_points_are_local_maxima_strongest_first():
    image = texture()
    detector = sheet_detector(subpixel=False, threshold=0.02)
    h = response.harris_response(image, 5)
    above = np.argwhere((h == cv2.dilate(h, np.ones((3, 3)))) & (h > 0.02 * h.max()) & (h > 10))
    points = detector.detect_arrays(image)
    assert whole_pixels(points) == sorted((float(x), float(y)) for y, x in above)
    assert (np.diff(points['response']) <= 0).all()
    assert np.array_equal(points['response'], h[points['y'].astype(int), points['x'].astype(int)])


def test_a_plateau_gives_one_point():
    points = sheet_detector(subpixel=False, threshold=0.1, window_size=3).detect_arrays(
        np.kron(draw_square(32, 10, 19), np.ones((2, 2), np.uint8)))
    assert len(points) == 4


def test_without_local_maxima_every_pixel_that_passes_is_a_point(square):
    h = response.harris_response(square, 5)
    points = sheet_detector(local_maxima=False, threshold=0.1).detect_arrays(square)
    assert len(points) == ((h > 0.1 * h.max()) & (h > 10)).sum() > 20


def test_subpixel_finds_a_shift_of_part_of_a_pixel():
    errors = {True: [], False: []}
    for shift in np.arange(0, 1, 0.125):
        image = draw_polygon(np.array([(50, 40), (110, 40), (110, 80), (50, 80)]) + shift)
        for subpixel, found in errors.items():
            points = sheet_detector(threshold=0.2, subpixel=subpixel, derivative_sigma=0.7).detect_arrays(image)
            assert len(points) == 4
            found.append(points['x'].mean() - shift)
    assert np.ptp(errors[True]) < 0.1
    assert np.ptp(errors[False]) > 0.4


@pytest.mark.parametrize('angle', range(0, 360, 30))
def test_orientation_follows_the_pattern(angle):
    """The corner of a bright wedge: the gradient points into it, along the wedge's axis."""
    direction = np.radians(angle + np.array([-45, 45]))
    tip = np.array([100.0, 90.0])
    far = tip + 300 * np.column_stack((np.cos(direction), np.sin(direction)))
    image = draw_polygon([tip, *far], (180, 200))
    points = sheet_detector(number_of_points=1, fixed_number_of_points=True, border=20).detect_arrays(image)
    assert nearest(points, [tip]) < 3
    assert abs((points['angle'][0] - angle + 180) % 360 - 180) < 3
    assert 0 <= points['angle'][0] < 360


def test_mask_leaves_out_and_what_is_outside_does_not_matter():
    image = texture((120, 160))
    mask = np.zeros(image.shape, np.uint8)
    mask[30:90, 40:120] = 255
    for parameters in ({}, {'octaves': 3}, {'anms': True, 'anms_points': 30}, {'fixed_number_of_points': True}):
        detector = sheet_detector(subpixel=False, **parameters)
        points = detector.detect_arrays(image, mask)
        x, y = points['x'].astype(int), points['y'].astype(int)
        assert len(points) > 10
        assert mask[y, x].all()
        assert np.array_equal(detector.detect_arrays(image, mask != 0), points)
    brighter = image.copy()
    brighter[:8, :8] = np.indices((8, 8)).sum(axis=0) % 2 * 255
    detector = sheet_detector(threshold=0.05)
    assert np.array_equal(detector.detect_arrays(brighter, mask), detector.detect_arrays(image, mask))
    assert detector.detect(image, np.zeros_like(mask)) == []


def test_border_leaves_out_the_rim():
    points = sheet_detector(border=25, threshold=0.0).detect_arrays(texture((120, 160)))
    assert len(points) > 20
    assert points['x'].min() > 24
    assert points['x'].max() < 160 - 24
    assert points['y'].min() > 24


def test_number_of_points():
    image = texture((240, 320))
    for count in (0, 1, 50):
        assert len(sheet_detector(fixed_number_of_points=True, number_of_points=count).detect(image)) == count
        assert len(sheet_detector(anms=True, anms_points=count).detect(image)) == count
    both = sheet_detector(anms=True, anms_points=20, fixed_number_of_points=True, number_of_points=30)
    assert len(both.detect(image)) == 20


def test_number_of_points_is_that_of_all_layers_of_one_octave():
    layered = sheet_detector(octave_layers=3, fixed_number_of_points=True, number_of_points=40)
    assert len(layered.detect(texture((240, 320)))) == 40


def test_anms_always_has_the_strongest():
    image = texture((240, 320))
    strongest = sheet_detector(fixed_number_of_points=True, number_of_points=1).detect_arrays(image)
    assert np.array_equal(sheet_detector(anms=True, anms_points=5).detect_arrays(image)[:1], strongest)


def test_objects_equal_arrays():
    image = texture()
    detector = sheet_detector(octaves=2)
    points = detector.detect(image)
    assert isinstance(points[0], cv2.KeyPoint)
    assert np.array_equal(key_points.from_objects(points), detector.detect_arrays(image))


def test_harris_corners_are_the_candidates_of_an_octave():
    image = texture()
    detector = sheet_detector(window_size=7)
    full, half = detector.harris_corners(image, 0), detector.harris_corners(image, 1)
    assert np.allclose(half['x'], 2 * full['x'])
    assert set(half['size']) == {14.0}
    assert (full['response'] > detector.minimum_response).all()


def test_detector_is_immutable():
    detector = HarrisDetector()
    with pytest.raises(dataclasses.FrozenInstanceError):
        detector.threshold = 0.5


@pytest.mark.parametrize(('name', 'value', 'error', 'text'), [
    ('window_size', 4, ValueError, 'window_size must be an odd integer of at least 3; got 4'),
    ('window_size', True, TypeError, 'window_size must be .*got True .bool'),
    ('window_size', '5', TypeError, "got '5' .str"),
    ('threshold', float('nan'), ValueError, 'threshold must be a finite number .*; got nan'),
    ('threshold', -0.1, ValueError, 'got -0.1'),
    ('threshold', None, TypeError, 'got None'),
    ('minimum_response', float('inf'), ValueError, 'got inf'),
    ('octaves', 0, ValueError, 'octaves must be an integer from 1 to 10; got 0'),
    ('anms', 1, TypeError, 'anms must be True or False; got 1'),
    ('number_of_points', -1, ValueError, 'got -1'),
    ('window', 'Gaussian', ValueError, "window must be one of 'gaussian', 'box'; got 'Gaussian'"),
    ('anms_robustness', 0, ValueError, 'above 0, at most 1; got 0'),
])
def test_bad_parameters_are_named(name, value, error, text):
    with pytest.raises(error, match=text):
        HarrisDetector(**{name: value})


def test_numpy_numbers_are_accepted():
    detector = HarrisDetector(window_size=np.int64(7), threshold=np.float32(0.5), anms=np.bool_(True))
    assert (type(detector.window_size), type(detector.threshold), type(detector.anms)) == (int, float, bool)
