"""What HarrisDetector does by default, and its presets: points that come back, in every light, and not out of noise."""

import cv2
import numpy as np
import pytest
from conftest import draw_polygon, positions, texture

from rvc_features import contrast, key_points, parameters, presets
from rvc_features.comparison import warps
from rvc_features.harris_detector import HarrisDetector
from rvc_features.octaves import number_for_extractors

random = np.random.default_rng(0)


def distances(points, others):
    """Distance of each point to the nearest of the others."""
    difference = positions(points)[:, None].astype(np.float64) - positions(others)[None]
    return np.hypot(difference[..., 0], difference[..., 1]).min(axis=1)


def smooth_texture(shape=(240, 320), seed=0, contrast=60.0, middle=120.0):
    """Grey values as floats, none of which saturates under what the tests do to them."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=shape), (0, 0), 2.0)
    return middle + contrast * np.clip(noise / noise.std() / 3, -1, 1)


@pytest.mark.parametrize(('vertices', 'corners'), [
    ([(80, 60), (240, 60), (240, 180), (80, 180)], 4), ([(60, 50), (250, 90), (120, 200)], 3),
    ([(160, 30), (280, 120), (160, 210), (40, 120)], 4)])
def test_a_polygon_has_its_corners(vertices, corners):
    points = HarrisDetector(threshold=0.2).detect_arrays(draw_polygon(vertices))
    assert len(points) == corners
    true = np.zeros(len(vertices), [('x', float), ('y', float)])
    true['x'], true['y'] = np.transpose(vertices)
    assert distances(points, true).max() < 3
    # The gradient points into the bright polygon.
    middle = np.mean(vertices, axis=0)
    inwards = np.degrees(np.arctan2(middle[1] - points['y'], middle[0] - points['x']))
    assert np.abs((points['angle'] - inwards + 180) % 360 - 180).max() < 45


@pytest.mark.parametrize('values', [{}, {'octaves': 3}, {'anms': True}])
@pytest.mark.parametrize('degrees', [10, 23])
def test_the_steps_of_slanted_edges_are_no_corners(degrees, values):
    angles = np.radians(degrees + np.arange(0, 360, 90))
    vertices = np.zeros(4, [('x', float), ('y', float)])
    vertices['x'], vertices['y'] = 160 + 80 * np.cos(angles), 120 + 80 * np.sin(angles)
    image = draw_polygon(np.column_stack((vertices['x'], vertices['y'])))
    points = HarrisDetector(**{'fixed_number_of_points': True, **values}).detect_arrays(image)
    assert len(points) == 4
    assert distances(points, vertices).max() < 2


@pytest.mark.parametrize('values', [{}, {'fixed_number_of_points': True, 'number_of_points': 100},
                                    {'anms': True, 'anms_points': 100}, {'octaves': 3},
                                    {'octaves': 4, 'merge_octaves': False, 'octave_layers': 2}])
@pytest.mark.parametrize(('gain', 'offset'), [(0.25, 0), (0.5, 30), (1.5, -30), (1.6, 0), (1.0, 30), (1.0, -30)])
def test_gain_and_offset_change_nothing(gain, offset, values):
    """Of an image that is exact under them: grey values in steps of four, or of twenty."""
    step = 20 if gain > 1 and gain != 1.5 else 4
    image = np.rint(smooth_texture() / step) * step
    image = np.clip(image, 60 if offset < 0 else 0, 140)
    changed = gain * image + offset
    assert np.array_equal(changed, np.rint(changed))
    assert 0 <= changed.min() <= changed.max() <= 255
    detector = HarrisDetector(**values)
    points, others = (detector.detect_arrays(each.astype(np.uint8)) for each in (image, changed))
    assert len(points) == len(others) > 50
    assert distances(points, others).max() < 1e-3
    assert distances(others, points).max() < 1e-3


@pytest.mark.parametrize('sigma', [1, 2, 3])
@pytest.mark.parametrize('octaves', [1, 3])
def test_noise_on_a_flat_image_is_kept_out(octaves, sigma):
    image = np.clip(np.rint(128 + random.normal(0, sigma, (480, 640))), 0, 255).astype(np.uint8)
    assert len(HarrisDetector(octaves=octaves).detect(image)) <= 5


def demosaiced(image):
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BayerBG2BGR), cv2.COLOR_BGR2GRAY)


def through_jpeg(image, quality=90):
    return cv2.imdecode(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize('sigma', [1, 2, 3])
@pytest.mark.parametrize('smoothing', [demosaiced, through_jpeg, lambda image: through_jpeg(image, 75),
                                       lambda image: through_jpeg(image, 95),
                                       lambda image: through_jpeg(demosaiced(image)),
                                       lambda image: cv2.GaussianBlur(image, (0, 0), 0.7),
                                       lambda image: cv2.GaussianBlur(image, (0, 0), 1.5),
                                       lambda image: cv2.GaussianBlur(image, (0, 0), 3)],
                         ids=['demosaiced', 'jpeg', 'coarse jpeg', 'good jpeg', 'both', 'slightly blurred', 'blurred',
                              'smooth'])
def test_noise_whose_neighbours_are_alike_is_kept_out(smoothing, sigma):
    """Hundreds to thousands of points before the strongest corner was compared with the mean."""
    noise = np.random.default_rng(sigma).normal(0, sigma, (480, 640))
    image = smoothing(np.clip(np.rint(128 + noise), 0, 255).astype(np.uint8))
    for octaves in (1, 3):
        assert len(HarrisDetector(octaves=octaves).detect(image)) <= 5


def test_fine_texture_is_not_taken_for_noise():
    """It looks like smoothed noise, and is stronger; the darker it is the harder to tell."""
    grass = np.clip(128 + 20 * cv2.GaussianBlur(random.normal(size=(480, 640)), (0, 0), 0.7) / 0.4, 0, 255)
    for gain in (1, 0.5):
        image = np.rint(gain * grass).astype(np.uint8)
        assert len(HarrisDetector(fixed_number_of_points=True).detect(image)) == 500


@pytest.mark.parametrize('interpolation', [cv2.INTER_LINEAR, cv2.INTER_CUBIC])
def test_rotation_finds_points_again_within_a_seventh_of_a_pixel(interpolation):
    image = warps.reference(warps.generated_photograph())
    middle = (np.array(image.shape[::-1]) - 1) / 2
    detector = HarrisDetector(fixed_number_of_points=True)
    radius = middle.min() - 20
    first, apart = detector.detect_arrays(image), []
    first = first[np.hypot(first['x'] - middle[0], first['y'] - middle[1]) < radius]
    for degrees in range(15, 90, 15):
        turn = cv2.getRotationMatrix2D(tuple(map(float, middle)), degrees, 1)
        turned = detector.detect_arrays(cv2.warpAffine(image, turn, image.shape[::-1], flags=interpolation,
                                                       borderMode=cv2.BORDER_REFLECT_101))
        back = cv2.invertAffineTransform(turn)
        positions_back = positions(turned) @ back[:, :2].T + back[:, 2]
        turned['x'], turned['y'] = positions_back.T
        apart.append(distances(first, turned))
    found = np.concatenate(apart) < 1.5
    assert found.mean() >= 0.96
    assert np.concatenate(apart)[found].mean() < 0.15


def test_corners_of_a_dark_picture_are_found():
    image = draw_polygon([(80, 60), (240, 60), (240, 180), (80, 180)])
    dark = np.rint(2 + (image - 40) / 16 + random.normal(0, 0.7, image.shape)).clip(0, 255).astype(np.uint8)
    points = HarrisDetector(fixed_number_of_points=True, number_of_points=4).detect_arrays(dark)
    bright = HarrisDetector(threshold=0.2).detect_arrays(image)
    assert distances(bright, points).max() < 2


def test_minimum_contrast_is_the_step_at_a_corner():
    image = np.full((120, 240), 40, np.uint8)
    for i, step in enumerate((5, 10, 20, 40)):
        image[40:80, 20 + 55 * i:50 + 55 * i] += step
    for least, squares in ((3, 4), (7.5, 3), (15, 2), (30, 1), (60, 0)):
        points = HarrisDetector(threshold=0.0, minimum_contrast=float(least), evenness=0.0).detect_arrays(image)
        assert len(points) == 4 * squares, least


def test_points_move_with_the_image_by_even_shifts_exactly_and_by_odd_ones_nearly():
    image = texture((200, 260))
    detector = HarrisDetector(border=24, evenness=0.0, threshold=0.2)
    for dx, dy, most, share in ((20, 14, 1e-3, 1.0), (23, 15, 0.5, 0.9)):
        first, moved = detector.detect_arrays(image[:-dy, :-dx]), detector.detect_arrays(image[dy:, dx:])
        first['x'] -= dx
        first['y'] -= dy
        inside = (first['x'] > 40) & (first['y'] > 40) & (first['response'] > 0.25 * first['response'].max())
        assert np.count_nonzero(inside) > 15
        assert np.mean(distances(first[inside], moved) < most) >= share


def test_odd_shifts_move_points_by_a_fortieth_of_a_pixel():
    """A cubic between the pixels of the coarse scale moved them three times as far."""
    image = warps.reference(warps.generated_photograph())
    detector = HarrisDetector(fixed_number_of_points=True)
    first, moved = detector.detect_arrays(image), detector.detect_arrays(image[23:, 37:])
    moved['x'] += 37
    moved['y'] += 23
    apart = distances(first, moved)
    assert np.mean(apart < 1.5) > 0.85
    assert apart[apart < 1.5].mean() < 0.04


def test_evenness_spreads_the_points():
    image = smooth_texture(contrast=60)
    image[:, :160] += 0.6 * (image[:, :160] - image[:, :160].mean())   # strong texture on the left
    image = np.clip(image, 0, 255).astype(np.uint8)
    right = {}
    for evenness in (0.0, 0.35, 1.0):
        detector = HarrisDetector(evenness=evenness, fixed_number_of_points=True, number_of_points=120)
        points = detector.detect_arrays(image)
        right[evenness] = np.count_nonzero(points['x'] > 165)
    assert right[0.0] < right[0.35] < right[1.0], right
    assert right[1.0] >= 40


def test_octaves_share_the_points_and_a_corner_is_one_point():
    image = texture((400, 500), smoothing=2.5)
    several = HarrisDetector(octaves=3, fixed_number_of_points=True, number_of_points=300).detect_arrays(image)
    assert np.mean(several['octave'] > 0) >= 0.1
    assert set(several['size']) <= {9.0, 18.0, 36.0}
    assert (several['size'] == 9 * 2.0 ** several['octave']).all()
    apart = np.hypot(*(positions(several)[:, None] - positions(several)[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > 1.4
    one = HarrisDetector(fixed_number_of_points=True, number_of_points=300).detect_arrays(image)
    assert np.mean(distances(several, one) < 0.01) > 0.8   # they lie where one octave has them
    kept = HarrisDetector(octaves=3, merge_octaves=False, fixed_number_of_points=True,
                          number_of_points=300).detect_arrays(image)
    apart = np.hypot(*(positions(kept)[:, None] - positions(kept)[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    assert np.mean(apart.min(axis=1) < 4) > 0.2   # a corner in two octaves is two points


def test_layers_are_each_corner_again_at_sizes_up_to_the_next_octave():
    image = texture((300, 400), smoothing=2.0)
    apart = {'octaves': 2, 'merge_octaves': False, 'fixed_number_of_points': True}
    corners = HarrisDetector(**apart, number_of_points=40).detect_arrays(image)
    points = HarrisDetector(**apart, octave_layers=2, number_of_points=79).detect_arrays(image)
    once, again = points[::2], points[1::2]
    np.testing.assert_allclose(again['size'], corners['size'][:-1] * 2 ** 0.5, rtol=1e-6)
    for name in ('x', 'y', 'angle', 'response'):
        assert once[name].tolist() == corners[name].tolist()
        assert again[name].tolist() == corners[name][:-1].tolist()
    assert once['size'].tolist() == corners['size'].tolist()
    assert set(corners['octave']) == {0, 1}
    assert once['octave'].tolist() == (2 * corners['octave']).tolist()   # sqrt(2) is nearly two of ORB's steps of 1.2
    assert again['octave'].tolist() == (2 * corners['octave'][:-1] + 2).tolist()
    spread = HarrisDetector(octave_layers=3, anms=True, anms_points=60).detect_arrays(image)
    assert len(spread) == 60
    assert len(set(zip(spread['x'], spread['y']))) == 20


def test_anms_has_weak_corners_to_choose_from_that_are_none_otherwise():
    image = texture((300, 400), smoothing=2.0)
    usual = HarrisDetector(fixed_number_of_points=True, number_of_points=10_000).detect_arrays(image)
    spread = HarrisDetector(anms=True, anms_points=10_000).detect_arrays(image)
    strength = HarrisDetector().response_map(image)
    assert len(spread) > len(usual)
    for points, least in ((usual, 0.05), (spread, 0.025)):
        x, y = (np.rint(points[name]).astype(int) for name in 'xy')
        largest = np.max([strength[y + v, x + u] for u in (-1, 0, 1) for v in (-1, 0, 1)], axis=0)
        share = largest / contrast.local_energy(image, x, y)
        assert least < share.min() < 1.3 * least


@pytest.mark.parametrize('extractor', [cv2.ORB_create(), cv2.SIFT_create()], ids=['orb', 'sift'])
@pytest.mark.parametrize('side', [40, 90, 300])
def test_extractors_describe_the_points_of_matching_in_images_of_any_size(extractor, side):
    image = texture((side, side + 20), smoothing=2.0)
    found = presets.create('matching', number_of_points=200, border=2).detect(image)
    assert {point.octave for point in found} >= ({0, 2, 4} if side > 80 else {0, 2, 3})
    described, descriptors = extractor.compute(image, found)
    assert descriptors is None or len(descriptors) == len(described)


def test_octaves_of_layers_leave_sift_the_pixels_that_it_needs():
    shape = (100, 130)
    points = key_points.empty(12)
    points['octave'] = np.repeat(np.arange(6), 2)
    for size in (5, 9):
        numbered = points.copy()
        numbered['size'] = size * 2 ** (np.arange(12) / 2)
        number_for_extractors(numbered, size, shape)
        expected = [0, 2, 2, 3, 4, 4, 4, 4, 4, 4, 4, 4] if size == 5 else [0, 2, 2, 4, 4, 4, 4, 4, 4, 4, 4, 4]
        assert numbered['octave'].tolist() == expected   # size / 2^octave of at least 1.04, and a level of six rows


@pytest.mark.parametrize('name', presets.names())
def test_presets_give_the_number_asked_for(name):
    image = texture((400, 500))
    for count in (20, 150):
        detector = presets.create(name, number_of_points=count)
        assert len(detector.detect(image)) == count
    assert presets.create(name).window_size == 5
    assert presets.create(name, window_size=7).window_size == 7
    assert set(presets.values(name)) == set(parameters.specifications(HarrisDetector))
    text = presets.get(name)
    assert text.purpose.endswith('.')
    assert text.cost.endswith('.')


def test_presets_are_what_they_say():
    assert presets.names() == ['course', 'even', 'matching', 'repeatable']
    assert presets.create('repeatable') == HarrisDetector()
    course = presets.create('course')
    image = texture((160, 200))
    found = course.detect_arrays(image)
    from rvc_features.response import harris_response
    h = harris_response(image, course.window_size, course.window)
    x, y = found['x'].astype(int), found['y'].astype(int)
    assert np.array_equal(found['response'], h[y, x])
    assert np.array_equal(found['x'], x)
    peaks = (h == cv2.dilate(h, np.ones((3, 3)))) & (h > 0.01 * h.max()) & (h > 10)
    assert len(found) == np.count_nonzero(peaks)


@pytest.mark.parametrize(('arguments', 'values', 'error', 'text'), [
    (('sharp',), {}, ValueError, "unknown preset 'sharp'; there are course, even, matching, repeatable"),
    (('even', -1), {}, ValueError, 'number_of_points must be an integer of at least 0; got -1'),
    (('even',), {'windowsize': 5}, TypeError, "has no parameter 'windowsize'; it has window_size"),
    (('even',), {'evenness': 2.0}, ValueError, 'evenness must be a finite number of at least 0, at most 1; got 2.0'),
])
def test_bad_presets_are_named(arguments, values, error, text):
    with pytest.raises(error, match=text):
        presets.create(*arguments, **values)
