"""Each compiled kernel against the reference beside it; and that nothing needs them."""

import json
import multiprocessing
import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import drawing, feature_detector, filters, kernels, key_points, maxima, orientation
from rvc_features.harris_detector import HarrisDetector
from rvc_features.kernels import compiler, sorting, spread, suppression
from rvc_features.kernels import drawing as compiled_drawing
from rvc_features.kernels import grey as compiled_grey
from rvc_features.kernels import key_points as compiled_key_points
from rvc_features.kernels import maxima as compiled_maxima
from rvc_features.kernels import orientation as compiled_orientation
from rvc_features.kernels import response as compiled_response
from rvc_features.response import harris_response, reference_response, response_and_maximum

compiled = pytest.mark.skipif(not compiler.available(), reason='Numba is not installed')

OPENCV = tuple(int(number) for number in cv2.__version__.split('.')[:2])
random = np.random.default_rng(0)
ALL_WINDOWS = range(3, 33, 2)
SHAPES = [(1, 50), (2, 18), (5, 19), (33, 31), (40, 200)]


def images(shape):
    y, x = np.indices(shape)
    yield 'noise', random.integers(0, 256, shape, np.uint8)
    yield 'binary noise', random.integers(0, 2, shape, np.uint8) * np.uint8(255)
    yield 'low contrast', random.integers(200, 203, shape, np.uint8)
    yield 'pixel checkerboard', ((x + y) % 2 * 255).astype(np.uint8)
    yield 'stripes', ((x + y) // 2 % 2 * 255).astype(np.uint8)
    yield 'white', np.full(shape, 255, np.uint8)
    yield 'float', random.normal(100, 30, shape).astype(np.float32)
    yield 'float, far from zero', (1e4 + random.normal(0, 1, shape)).astype(np.float32)


def assert_equal_response(response, expected):
    assert np.abs(response - expected).max() <= 1e-5 * np.abs(expected).max()


@compiled
@pytest.mark.parametrize('derivative_sigma', [0.0, 0.7, 2.0])
@pytest.mark.parametrize('window', ['box', 'gaussian'])
@pytest.mark.parametrize('shape', SHAPES)
def test_response_kernel_equals_reference(shape, window, derivative_sigma):
    for _, image in images(shape):
        for window_size in ALL_WINDOWS if shape == (40, 200) else (3, 9, 31):
            expected = reference_response(image, window_size, window, 0.04, derivative_sigma)
            response, largest = compiled_response.response(image, window_size, window, 0.04, derivative_sigma)
            assert_equal_response(response, expected)
            assert largest == response.max()


@compiled
@pytest.mark.parametrize('shape', [(41, 64), (33, 128), (60, 33), (45, 255), (48, 90), (9, 500)])
def test_gaussian_in_blocks_equals_reference(shape):
    y, x = np.indices(shape)
    edges = [np.where(x > shape[1] // 2, 255, 0), np.where(y > shape[0] // 2, 255, 0), np.where(x > y, 255, 0),
             np.where(2 * y > x + 3, 255, 0), np.where((x > shape[1] // 2) & (y > shape[0] // 2), 200, 20)]
    for image in [*(edge.astype(np.uint8) for edge in edges), *(image for _, image in images(shape))]:
        for window_size in {5, 7, 9, min(31, *shape), min(compiled_response.LARGEST_BOX, *shape)}:
            window_size -= 1 - window_size % 2
            expected = reference_response(image, window_size, 'gaussian', 0.04, 0.0)
            response, largest = compiled_response.response(image, window_size, 'gaussian', 0.04)
            assert_equal_response(response, expected)
            assert largest == response.max()


@compiled
@pytest.mark.parametrize('window_size', [7, 31])
def test_gaussian_in_blocks_in_bands_of_rows_makes_no_difference(in_bands, window_size):
    image = texture((61, 350))
    response, largest = compiled_response.response(image, window_size, 'gaussian', 0.04)
    cv2.setNumThreads(1)
    whole, _ = compiled_response.response(image, window_size, 'gaussian', 0.04)
    assert np.array_equal(response, whole)
    assert largest == whole.max()


@pytest.fixture
def in_bands(monkeypatch):
    """Every image in three bands of rows, however small it is."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(3)
    monkeypatch.setattr(compiler, '_LEAST_BAND', 1)
    yield
    cv2.setNumThreads(threads)


@compiled
@pytest.mark.parametrize('derivative_sigma', [0.0, 1.0])
@pytest.mark.parametrize('window', ['box', 'gaussian'])
def test_bands_of_rows_make_no_difference(in_bands, window, derivative_sigma):
    for shape in SHAPES:
        for _, image in images(shape):
            for window_size in (3, 9, 31):
                expected = reference_response(image, window_size, window, 0.04, derivative_sigma)
                response, largest = compiled_response.response(image, window_size, window, 0.04, derivative_sigma)
                assert_equal_response(response, expected)
                assert largest == response.max()
                found = compiled_maxima.local_maxima(response, 0.0)
                assert np.array_equal(found, maxima.reference_local_maxima(response, 0.0))


@compiled
@pytest.mark.parametrize('shape', [(5, 511), (6, 512), (7, 513), (6, 527), (5, 528), (4, 529), (3, 1040)])
def test_smallest_box_goes_on_from_block_to_block(shape):
    """It takes 512 columns at a time, and needs one more on either side."""
    for _, image in images(shape):
        response, largest = compiled_response.response(image, 3, 'box', 0.04)
        assert_equal_response(response, reference_response(image, 3, 'box', 0.04, 0.0))
        assert largest == response.max()


@compiled
@pytest.mark.parametrize('shape', [(45, 45), (46, 64), (60, 97), (47, 130)])
def test_large_box_equals_reference_up_to_its_largest_window(shape):
    """Where gradients are steepest all over, the largest window's sums just fit."""
    steepest = np.tile(np.where(np.arange(shape[1]) // 2 % 2, 255, 0).astype(np.uint8), (shape[0], 1))
    for image in [steepest, *(image for _, image in images(shape) if image.dtype == np.uint8)]:
        for window_size in (5, 7, 13, 43, compiled_response.LARGEST_BOX):
            response, largest = compiled_response.response(image, window_size, 'box', 0.04)
            assert_equal_response(response, reference_response(image, window_size, 'box', 0.04, 0.0))
            assert largest == response.max()


@compiled
def test_too_narrow_for_the_kernel_is_an_error():
    with pytest.raises(ValueError, match='at least 18 pixels wide; got 17'):
        compiled_response.response(np.zeros((100, 17), np.uint8), 3, 'box', 0.04)


@compiled
@pytest.mark.skipif(not hasattr(os, 'fork'), reason='no fork on this system')
def test_a_forked_process_has_threads_of_its_own(in_bands):
    image = texture((90, 120))
    expected, _ = compiled_response.response(image, 5, 'gaussian', 0.04)
    with multiprocessing.get_context('fork').Pool(1) as pool:
        response, _ = pool.apply_async(compiled_response.response, (image, 5, 'gaussian', 0.04)).get(60)
    assert np.array_equal(response, expected)


@compiled
@pytest.mark.parametrize('window_size', [33, 45])
def test_widest_boxes_of_the_kernel_do_not_overflow(window_size):
    columns = np.indices((60, 80))[1] // 2 % 2 * 255   # the steepest gradients there are, everywhere
    response, _ = compiled_response.response(columns.astype(np.uint8), window_size, 'box', 0.04)
    assert_equal_response(response, reference_response(columns.astype(np.uint8), window_size, 'box', 0.04, 0.0))


@pytest.mark.parametrize('window', ['box', 'gaussian'])
@pytest.mark.parametrize(('shape', 'window_size'),
                         [((70, 90), 61), ((17, 93), 63), ((17, 93), 31), ((400, 15), 17), ((400, 17), 5)])
def test_windows_beyond_the_kernel(shape, window_size, window):
    ramp = (np.indices(shape) * [[[2]], [[3]]]).sum(axis=0).astype(np.uint8)   # H nearly cancels in most of it
    for image in (texture(shape), ramp):
        expected = reference_response(image, window_size, window, 0.04, 0.0)
        assert_equal_response(harris_response(image, window_size, window), expected)


@compiled
def test_edge_without_trace_term_has_no_response_inside():
    """A C - B^2 cancels on a straight edge: in single precision something would be left over."""
    image = np.tril(np.full((64, 64), 255, np.uint8))
    response, _ = compiled_response.response(image, 5, 'box', 0.0)
    assert not response[20:44, 20:44].any()


def test_response_writes_where_it_is_told():
    image, out = texture((60, 80)), np.empty((60, 80), np.float32)
    response, largest = response_and_maximum(image, 5, 'gaussian', 0.04, 0.0, out)
    assert np.array_equal(response, harris_response(image, 5))
    assert largest == response.max()


@compiled
@pytest.mark.parametrize('threads', [1, 2])
@pytest.mark.parametrize(('window', 'window_size'), [('box', 3), ('box', 31), ('gaussian', 3), ('gaussian', 7)])
def test_large_maps_are_the_same_past_the_caches(window, window_size, threads):
    """What is large and new is written there, where rows begin at cache lines; 992: blocks of the Gaussian overlap."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    try:
        for shape in ((1058, 992), (1058, 1000)):
            image, out = texture(shape), np.full(shape, np.nan, np.float32)
            response, largest = compiled_response.way(image.dtype, shape, window_size, window, 0.04, 0.0)(image, None)
            assert response.flags.c_contiguous
            assert response.ctypes.data % 64 == 0
            assert_equal_response(response, reference_response(image, window_size, window, 0.04, 0.0))
            response_and_maximum(image, window_size, window, 0.04, 0.0, out)
            assert np.array_equal(response, out)
            assert largest == out.max()
    finally:
        cv2.setNumThreads(before)


def test_responses_handed_out_are_not_overwritten():
    detector = HarrisDetector()
    image, other = texture((60, 80)), texture((60, 80), seed=9)
    response, found = detector.response_map(image), detector.detect_arrays(image)
    kept = response.copy(), found.copy()
    detector.response_map(other)
    detector.detect_arrays(other)
    assert np.array_equal(response, kept[0])
    assert np.array_equal(found, kept[1])


@compiled
@pytest.mark.parametrize('shape', [*SHAPES, (8, 8), (17, 16), (120, 161)])
def test_maxima_kernels_equal_reference(shape):
    for response in (random.normal(0, 1, shape), random.integers(0, 4, shape), np.ones(shape)):
        response = response.astype(np.float32)
        for minimum in (-5.0, 0.5, 2.0):
            found = compiled_maxima.local_maxima(response, minimum)
            assert np.array_equal(found, maxima.reference_local_maxima(response, minimum))
            assert np.array_equal(compiled_maxima.local_maxima(np.asfortranarray(response), minimum), found)
            assert np.array_equal(compiled_maxima.refine(response, *found), maxima.reference_refine(response, *found))


@compiled
@pytest.mark.parametrize('sigma', [0.3, 0.6, 1.0, 1.6, 2.5, 20.0])
def test_orientation_kernel_equals_reference(sigma):
    image = texture((50, 60))
    x, y = random.uniform(0, 59, 200), random.uniform(0, 49, 200)
    taps = orientation.gaussian_and_slope(sigma)
    gradients = np.array(compiled_orientation.smoothed_gradients(image, x, y, *taps))
    expected = np.array(orientation.reference_gradients(image, x, y, sigma))
    assert np.abs(gradients - expected).max() <= 1e-5 * np.abs(expected).max()


@compiled
@pytest.mark.parametrize('shape', [(16, 18), (40, 64), (61, 75)])
def test_products_kernel_equals_reference(shape):
    image = random.integers(0, 256, shape).astype(np.uint8)
    for side in (8, 16):
        cells = compiled_orientation.products_of_cells(image, side)
        assert cells.shape == (shape[0] // side, shape[1] // side, 3)
        assert np.array_equal(cells, orientation.reference_products_of_cells(image, side))
    with pytest.raises(ValueError, match='must be uint8, at least 18 pixels wide; got float32'):
        compiled_orientation.products_of_cells(image.astype(np.float32), 8)


@compiled
@pytest.mark.parametrize('radius', [2.0, 2.5, 9.3])
def test_drawing_kernel_equals_reference(radius):
    x, y = random.uniform(-9, 69, (2, 90)).astype(np.float32)
    angle = random.uniform(0, 360, 90).astype(np.float32)
    x[:4], angle[5:9] = (np.nan, np.inf, -1e30, 1e30), -1
    x[-1], y[-1] = 30, 20
    ring_x, ring_y = random.integers(-9, 10, (2, 20))
    for count in (90, 1):
        pictures = np.zeros((2, 40, 60, 3), np.uint8)
        for picture, stamp in zip(pictures, (drawing.reference_stamp, compiled_drawing.stamp)):
            stamp(picture, x[-count:], y[-count:], angle[-count:], ring_x, ring_y, radius, (1, 2, 3))
        assert pictures[0].any()
        assert np.array_equal(pictures[0], pictures[1])


@compiled
@pytest.mark.parametrize('shape', [(1, 1), (1, 33), (2, 17), (3, 17), (1, 66), (40, 333), (900, 700)])
def test_grey_kernel_equals_reference(shape):
    image = random.integers(0, 256, (*shape, 3), np.uint8)
    for picture in (image, image[::-1, ::-1], np.full_like(image, 255)):
        grey, expected = compiled_grey.grey_of_colour(picture), feature_detector.grey_of_colour(picture)
        most = 0 if OPENCV >= (4, 6) else 1   # before, OpenCV's weights had one bit less
        assert np.abs(grey.astype(int) - expected).max() <= most


def test_flat_image_has_no_gradient_anywhere():
    image = np.full((20, 20), 97, np.uint8)
    assert not orientation.gradient_orientation(image, np.array([0.3, 10.2]), np.array([4.7, 19.0]), 2.5).any()


def point_sets(count):
    yield 'uniform', random.uniform(0, 640, (count, 2))
    yield 'whole pixels', random.integers(0, 20, (count, 2)).astype(float)
    yield 'line', np.column_stack((np.arange(count) * 1.0, np.zeros(count)))
    yield 'one place', np.full((count, 2), 3.0)
    yield 'clusters', np.concatenate([random.normal(random.uniform(0, 2000, 2), 10.0 ** -scale, (count // 5 + 1, 2))
                                      for scale in range(5)])[:count]
    yield 'clusters far too fine', np.concatenate(([[1e6, -1e6]], random.normal(0, 1e-9, (count // 2, 2)),
                                                   random.normal(5, 1e-3, (count, 2))))[:count]
    yield 'duplicates', np.repeat(random.uniform(0, 99, (count // 5 + 1, 2)), 5, axis=0)[:count]
    yield 'beyond any scale', random.uniform(-1, 1, (count, 2)) * 1e200


@compiled
@pytest.mark.parametrize('robustness', [0.9, 1.0, 0.2])
@pytest.mark.parametrize('count', [1, 2, 8, 9, 17, 100, 900])
@pytest.mark.filterwarnings('ignore:overflow')
def test_suppression_kernel_equals_reference(count, robustness):
    for name, points in point_sets(count):
        for responses in (random.exponential(100, count), random.integers(1, 9, count) * 1.0, np.ones(count),
                          np.geomspace(1e6, 1, count), -random.exponential(1, count)):
            order = np.argsort(-responses, kind='stable')
            assert np.array_equal(sorting.strongest_first(responses), order)
            single = responses.astype(np.float32)
            assert np.array_equal(sorting.strongest_first(single), np.argsort(-single, kind='stable'))
            for few in (0, 1, count // 3, count + 5):
                assert np.array_equal(sorting.strongest_first(single, few), filters.reference_order(single, few))
                assert np.array_equal(sorting.strongest_first(responses, few), order[:few])
            falling = responses[order]
            stronger = filters.reference_stronger(falling, robustness)
            assert np.array_equal(suppression.significantly_stronger(falling, robustness), stronger)
            radii = filters.reference_radii(points[order], stronger)
            assert np.array_equal(suppression.suppression_radii(points[order], stronger, count), radii), name
            for chosen in (1, 5, count // 2, count // 5):
                expected = order[np.argsort(-radii, kind='stable')[:chosen]]
                found = filters.adaptive_non_maximal_suppression(points, responses, chosen, robustness)
                assert np.array_equal(found, expected), name


@compiled
@pytest.mark.parametrize('robustness', [0.9, 1.0, 0.3])
@pytest.mark.parametrize('count', [1, 10, 100, 700])
def test_spread_kernel_equals_reference(count, robustness):
    """Where it says anything it has at least as many as wanted, none missing that is as far from stronger ones."""
    size, answers = 1500, 0
    for name, points in point_sets(size):
        for responses in (random.exponential(100, size), random.integers(1, 9, size) * 1.0, random.normal(0, 1, size),
                          points.sum(axis=1), np.ones(size), 1e6 + random.integers(0, 9, size) * 0.01):
            found = spread.reach_largest_radius(points, responses, robustness, count)
            if found is None:
                continue
            answers += 1
            order = np.argsort(-responses, kind='stable')
            radii = np.empty(size)
            radii[order] = filters.reference_radii(points[order], filters.reference_stronger(responses[order],
                                                                                            robustness))
            chosen, their_radii = found
            assert len(chosen) >= count
            assert (np.diff(chosen) > 0).all()
            assert np.array_equal(their_radii, radii[chosen]), name
            assert np.delete(radii, chosen).max(initial=-1) < their_radii.min(), name
    assert answers >= 5


@compiled
def test_spread_kernel_gives_up_where_there_is_no_grid_to_it():
    for name, points in point_sets(900):
        if name in ('line', 'one place', 'beyond any scale'):
            assert spread.reach_largest_radius(points, random.exponential(1, 900), 0.9, 50) is None, name


@compiled
def test_sorting_kernel_takes_any_double():
    values = np.array([0.0, -0.0, 5e-324, -5e-324, 1.7e308, -1.7e308, 1.0, 1.0, -1.0, np.inf, -np.inf] * 20)
    assert np.array_equal(sorting.strongest_first(values), filters.reference_order(values))


@compiled
@pytest.mark.parametrize('kind', [np.float32, np.float64])
@pytest.mark.parametrize('size', [70, 900, 9000])
def test_sorting_kernel_finds_the_first_few(size, kind):
    for values in (random.exponential(1, size), random.normal(0, 1e-3, size) + 1, random.integers(0, 4, size),
                   np.sort(random.normal(0, 1, size))[::-1], np.sort(random.normal(0, 1, size)), np.full(size, -2)):
        values = values.astype(kind)
        before = values.copy()
        for count in (0, 1, size // 10, size - 1, size, 2 * size):
            assert np.array_equal(sorting.strongest_first(values, count), filters.reference_order(values, count))
        assert np.array_equal(values, before)


@compiled
def test_key_point_kernels_equal_their_references():
    x, y = random.integers(0, 40, (2, 50))
    for octave in (0, 3):
        for responses in (random.exponential(1, 50), random.exponential(1, 50).astype(np.float32)[::-1]):
            found = compiled_key_points.of_corners(x[::-1], y, responses, 5, octave).view(key_points.DTYPE)
            assert np.array_equal(found, key_points.reference_of_corners(x[::-1], y, responses, 5, octave))
    sound = key_points.reference_of_corners(x, y, np.arange(50) % 7, 5, 0)
    for name, value, expected in (('x', 39.5, True), ('x', 39.51, False), ('y', -0.5, True), ('y', -0.6, False),
                                  ('size', 0, True), ('size', -1, False), ('angle', -1, True), ('angle', np.nan, False),
                                  ('x', np.nan, False), ('size', np.inf, False), ('response', -np.inf, False),
                                  ('response', -1e30, True), ('octave', -1, True)):
        points = sound.copy()
        points[name][17] = value
        for some in (points, points[1::2], np.asfortranarray(points)):
            reference = key_points.reference_sound_and_strongest_first(some, 40, 40)
            found = compiled_key_points.sound_and_strongest_first(some, 40, 40)
            assert (reference is not None) == (found is not None) == expected
            assert not expected or np.array_equal(found, reference)
    assert len(compiled_key_points.sound_and_strongest_first(sound[:0], 40, 40)) == 0


@compiled
def test_strongest_key_points_are_those_of_the_reference():
    x, y = random.integers(0, 40, (2, 700))
    for responses in (random.normal(0, 1, 700), random.integers(0, 3, 700), np.geomspace(9, 1, 700)):
        points = key_points.reference_of_corners(x, y, responses, 5, 2)
        for some in (points, points[::3], points[:0]):
            for count in (0, 1, 100, 699, 700, 900):
                assert np.array_equal(compiled_key_points.strongest(some, count),
                                      key_points.reference_strongest(some, count))


@compiled
def test_orienting_kernel_equals_reference():
    image = texture((50, 60))
    points = key_points.reference_of_corners(*random.integers(0, 24, (2, 90)), np.ones(90), 5, 1)
    points['x'] += random.uniform(0, 1, 90)
    points['octave'][40:] = 0
    for octave, its_image in enumerate((image, image[::2, ::2])):
        for sigma in (1.6, 2.5):
            found, expected = points.copy(), points.copy()
            compiled_orientation.orient_along_gradient(found, its_image, octave, *orientation.gaussian_and_slope(sigma))
            orientation.reference_orient_along_gradient(expected, its_image, octave, sigma)
            assert np.abs((found['angle'] - expected['angle'] + 180) % 360 - 180).max() < 0.01
            assert (found['angle'] >= 0).sum() == (40 if octave == 1 else 50)


@compiled
def test_directions_kernel_equals_reference():
    special = [[0, 0, 1, 1, -1, 0], [0, 1, 0, -1e-12, -1, -0.0]]
    gradients = np.concatenate((random.normal(0, 9, (2, 99)), special), axis=1)
    angles, expected = compiled_orientation.directions(*gradients), orientation.reference_directions(*gradients)
    assert np.abs(angles - expected).max() < 1e-4
    assert (angles < 360).all()


def test_one_detector_in_many_threads():
    """Images of two sizes, so that a map shared between threads would be noticed."""
    detector = HarrisDetector(octaves=2, fixed_number_of_points=True)
    frames = [texture((90, 120), seed=1), texture((120, 90), seed=2), texture((90, 120), seed=3)]
    expected = [detector.detect_arrays(frame) for frame in frames]
    wrong = []

    def work(which):
        for _ in range(20):
            if not np.array_equal(detector.detect_arrays(frames[which]), expected[which]):
                wrong.append(which)

    threads = [threading.Thread(target=work, args=(i % 3,)) for i in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


DETECT = '''
    import logging, sys
    logging.basicConfig(format='%(name)s %(levelname)s %(message)s', stream=sys.stdout)
    import numpy as np
    from rvc_features.kernels import compiler, warm_up
    from rvc_features.harris_detector import HarrisDetector
    image = np.kron(np.random.default_rng(0).integers(0, 256, (12, 16)), np.ones((8, 8))).astype(np.uint8)
    for options in ({}, {'strength': 'harris', 'evenness': 0.0},
                    {'anms': True, 'anms_points': 40}, {'octaves': 2, 'fixed_number_of_points': True}):
        found = HarrisDetector(**options).detect_arrays(image)
        print(np.column_stack((found['x'], found['y'], found['angle'])).tolist())
    print('available', compiler.available(), warm_up.compile_all() >= 0)
'''


def run(code, **environment):
    source = str(Path(kernels.__file__).parents[2])
    result = subprocess.run([sys.executable, '-c', textwrap.dedent(code)], stdout=subprocess.PIPE,
                            env={**os.environ, 'PYTHONPATH': source, **environment}, check=True)
    return result.stdout.decode().splitlines()


@pytest.mark.slow
def test_without_numba_the_same_points_and_one_line_in_the_log():
    without = run("import sys; sys.modules['numba'] = None\n" + textwrap.dedent(DETECT))
    assert without[0].startswith('rvc_features WARNING Without Numba')
    assert sum('Numba' in line for line in without) == 1
    assert without[-1] == 'available False True'
    if compiler.available():
        for line, expected in zip(run(DETECT)[:-1], without[1:-1]):
            assert np.allclose(json.loads(line), json.loads(expected), atol=0.01)


@pytest.mark.slow
def test_disabled_compiler_counts_as_no_numba():
    tell = DETECT + "    print(compiler.description())\n"
    *_, available, description = run(tell, NUMBA_DISABLE_JIT='1')
    assert available == 'available False True'
    assert description == (f'without Numba (NUMBA_DISABLE_JIT is set), NumPy {np.__version__}, '
                           f'OpenCV {cv2.__version__}')


@pytest.mark.parametrize('local_maxima', [True, False])
@pytest.mark.parametrize('masked', [False, True])
@pytest.mark.parametrize('number', [0, 1, 30, 200, 100000])
def test_candidates_left_out_early_change_nothing(number, masked, local_maxima):
    """The strongest out of all octaves are those of all candidates, however the search is cut short."""
    image = texture((120, 160))
    image[:40, :40] //= 16   # weak corners beside strong ones
    mask = None
    if masked:
        mask = np.zeros(image.shape, np.uint8)
        mask[:60, :90] = 255
    detector = HarrisDetector(octaves=3, fixed_number_of_points=True, number_of_points=number, subpixel=False,
                              local_maxima=local_maxima, strength='harris', evenness=0.0)
    every, octave_image, octave_mask = [], image, mask
    for octave in range(3):
        every.append(detector.harris_corners(octave_image, octave, octave_mask))
        octave_image = cv2.pyrDown(octave_image)
        octave_mask = None if mask is None else octave_mask[::2, ::2]
    expected = np.concatenate(every)
    expected = expected[np.argsort(-expected['response'], kind='stable')][:number]
    found = detector.detect_arrays(image, mask)
    for name in ('x', 'y', 'response', 'octave'):
        assert np.array_equal(found[name], expected[name])
