"""The measures: by hand on a few points, against brute force on many, and on what must come out."""

import itertools

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors, key_points
from rvc_features.comparison import intervals, measures
from rvc_features.comparison.contestants import thinned
from rvc_features.comparison.correspondences import CommonRegion, inside, mutual_nearest
from rvc_features.comparison.survival import Survival

IDENTITY = np.eye(3)
SHAPE = 100, 200


def shift(x, y):
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def rotation_about(centre, degrees):
    matrix = np.eye(3)
    matrix[:2] = cv2.getRotationMatrix2D(centre, -degrees, 1)   # OpenCV's turns against the clock
    return matrix


def test_repeatability_by_hand():
    first = np.array([[10, 10], [50, 50], [190, 50], [20, 80.0]])     # the third moves out of the second image
    second = np.array([[31, 10], [70, 52], [5, 5], [40, 90.0]])       # the third comes from outside the first
    region = CommonRegion(first, second, shift(20, 0), SHAPE, SHAPE)
    assert region.first.tolist() == [0, 1, 3]
    assert region.second.tolist() == [0, 1, 3]
    # Distances in the second image: 1, 2 and 10.
    assert measures.repeatability(region, [0.5, 1, 1.5, 2, 20]) == pytest.approx([0, 1 / 3, 1 / 3, 2 / 3, 1])
    i, j, distance = measures.found_again(region, 3)
    assert (i.tolist(), j.tolist(), distance.tolist()) == ([0, 1], [0, 1], [1, 2])


def test_distances_are_those_in_the_second_image():
    region = CommonRegion(np.array([[10, 10.0]]), np.array([[22, 20.0]]), np.diag([2, 2, 1.0]), SHAPE, SHAPE)
    assert measures.repeatability(region, [1.9, 2.0]) == [0, 1]


def test_the_region_ends_half_open():
    corners = np.array([[0, 0], [199.5, 99.5], [200, 50], [50, 100], [-0.1, 5], [np.nan, 1]])
    assert inside(corners, SHAPE).tolist() == [True, True, False, False, False, False]


def test_matches_are_one_to_one():
    first, second = np.array([[0, 0], [1, 0.0]]), np.array([[0.4, 0.0]])
    i, j, distance = mutual_nearest(first, second)
    assert (i.tolist(), j.tolist(), distance.tolist()) == ([0], [0], [0.4])


def test_mutual_nearest_against_brute_force():
    generator = np.random.default_rng(3)
    for n1, n2 in ((600, 250), (1, 5), (5, 1)):
        first, second = generator.random((n1, 2)) * 60, generator.random((n2, 2)) * 60
        distances = np.hypot(*(first[:, None] - second[None]).transpose(2, 0, 1))
        expected = [(i, j) for i, j in itertools.product(range(n1), range(n2))
                    if distances[i, j] == distances[i].min() == distances[:, j].min()]
        i, j, distance = mutual_nearest(first, second)
        assert sorted(zip(i.tolist(), j.tolist())) == expected
        np.testing.assert_allclose(distance, distances[i, j])


def test_nothing_matches_nothing():
    empty = np.empty((0, 2))
    for first, second in ((empty, empty), (empty, np.ones((2, 2))), (np.ones((2, 2)), empty)):
        assert [len(each) for each in mutual_nearest(first, second)] == [0, 0, 0]
        region = CommonRegion(first, second, IDENTITY, SHAPE, SHAPE)
        assert measures.repeatability(region, [1, 3]) == [None, None]


@pytest.mark.parametrize('name', ['harris', 'good_features_to_track', 'fast', 'orb'])
def test_a_detector_against_itself_under_the_identity(name):
    image = texture((240, 320), smoothing=1.0)
    points = detectors.create(name).detect_arrays(image)[:300]
    where = measures.positions(points)
    region = CommonRegion(where, where, IDENTITY, image.shape, image.shape)
    assert measures.repeatability(region, [0.5, 3]) == [1, 1]
    _, _, distance = measures.found_again(region, 3)
    assert distance.max() == 0
    assert len(distance) == len(points)
    np.testing.assert_allclose(measures.orientation_errors(points['angle'], points['angle'], IDENTITY, where), 0,
                               atol=1e-3)
    matches, right = measures.matching_accuracy(points, points, image, image, IDENTITY)
    assert right == matches > 100


def test_points_at_one_place_are_paired_off():
    # What octaves do: one corner found twice. It must not cost a detector its match with itself.
    twice = np.array([[10, 10], [10, 10], [30, 30.0]])
    assert measures.repeatability(CommonRegion(twice, twice, IDENTITY, SHAPE, SHAPE), [1]) == [1]
    i, j, _ = mutual_nearest(twice, np.array([[11, 10], [30, 30.0]]))
    assert (i.tolist(), j.tolist()) == ([0, 2], [0, 1])


@pytest.mark.parametrize('matrix', [IDENTITY, rotation_about((100, 50), 30), shift(-80, 10), np.diag([0.5, 0.5, 1])])
def test_random_points_sit_at_the_chance_level(matrix):
    generator = np.random.default_rng(8)
    epsilons, seen, expected = [1.5, 3], [], []
    for _ in range(30):
        first, second = (generator.random((150, 2)) * (SHAPE[1], SHAPE[0]) for _ in range(2))
        region = CommonRegion(first, second, matrix, SHAPE, SHAPE)
        seen.append(measures.repeatability(region, epsilons))
        expected.append(measures.chance_level((len(region.first), len(region.second)), matrix, SHAPE, SHAPE,
                                              epsilons, seed=1))
    np.testing.assert_allclose(np.mean(seen, axis=0), np.mean(expected, axis=0), atol=0.015)
    assert 0.02 < np.mean(expected) < 0.9


def test_chance_is_the_same_for_the_same_seed():
    arguments = ((40, 50), IDENTITY, SHAPE, SHAPE, [1.5])
    assert measures.chance_level(*arguments, seed=4) == measures.chance_level(*arguments, seed=4)
    assert measures.chance_level((0, 50), IDENTITY, SHAPE, SHAPE, [1.5], 1) == [None]


def test_coverage_and_spacing_by_hand():
    # Cells of 25 x 12.5 pixels.
    points = np.array([[0, 0], [24.9, 12.4], [25, 0], [199.9, 99.9]])
    assert measures.covered_cells(points, SHAPE) == 3 / 64
    assert measures.covered_cells(np.empty((0, 2)), SHAPE) == 0
    assert measures.spacing(np.array([[0, 0], [3, 4], [3, 14.0]])) == pytest.approx((5 + 5 + 10) / 3)
    assert measures.spacing(np.array([[1, 1.0]])) is None


def test_orientation_errors_by_hand():
    matrix = rotation_about((50, 50), 20)
    errors = measures.orientation_errors(np.array([350, 10, -1, 90.0]), np.array([10, 35, 5, -1.0]), matrix,
                                         np.full((4, 2), 50.0))
    np.testing.assert_allclose(errors, [0, 5], atol=1e-9)


def test_orientation_of_harris_follows_a_rotation():
    image = texture((300, 300), smoothing=3.0)
    matrix = rotation_about((150, 150), 40)
    turned = cv2.warpPerspective(image, matrix, (300, 300), flags=cv2.INTER_CUBIC)
    first, second = (detectors.create('harris', border=8).detect_arrays(each) for each in (image, turned))
    region = CommonRegion(measures.positions(first), measures.positions(second), matrix, image.shape, image.shape)
    i, j, _ = measures.found_again(region, 1.5)
    errors = measures.orientation_errors(first['angle'][i], second['angle'][j], matrix, measures.positions(first)[i])
    assert len(errors) > 50
    assert np.median(errors) < 4


def test_matching_accuracy_knows_right_from_wrong():
    image = texture((240, 320), smoothing=2.0)
    moved = np.roll(image, (6, 9), axis=(0, 1))
    points = detectors.create('good_features_to_track').detect_arrays(image)[:200]
    there = points.copy()
    there['x'] += 9
    there['y'] += 6
    matches, right = measures.matching_accuracy(points, there, image, moved, shift(9, 6))
    assert matches > 50
    assert right / matches > 0.95
    _, right_under_wrong_truth = measures.matching_accuracy(points, there, image, moved, shift(9, 12))
    assert right_under_wrong_truth < 0.1 * matches
    assert measures.matching_accuracy(points[:0], there, image, moved, IDENTITY) == (0, 0)


def test_points_are_described_at_their_scale():
    # A pyramid's points: without their scale the descriptors of a picture and its double don't match.
    image = texture((200, 260), smoothing=2.0)
    double = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    matrix = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    first = detectors.create('good_features_to_track', minimum_distance=6.0).detect_arrays(image)[:150]
    second = first.copy()
    second['x'], second['y'] = 2 * first['x'] + 0.5, 2 * first['y'] + 0.5
    second['size'] = 2 * first['size']
    matches, right = measures.matching_accuracy(first, second, image, double, matrix)
    assert right / matches > 0.8


def test_survival_of_points_that_move():
    image = texture((200, 260), smoothing=2.0)
    moved = np.roll(image, 5, axis=1)
    points = measures.positions(detectors.create('harris', border=20).detect_arrays(image)[:100])
    survival = Survival(points, points + np.array([5, 0]), image, moved, [0.5, 1.5])
    assert survival.tracked > 0.95
    assert survival.found_again[1] > 0.95
    assert survival.motion == pytest.approx(5, abs=0.1)
    assert Survival(points, points + np.array([25, 0]), image, moved, [0.5]).found_again[0] < 0.2


def test_survival_without_points_or_without_likeness():
    image = texture((100, 130))
    none = Survival(np.empty((0, 2)), np.ones((1, 2)), image, image, [1])
    assert (none.tracked, none.found_again, none.motion) == (None, [None], None)
    points = measures.positions(detectors.create('harris').detect_arrays(image)[:60])
    assert Survival(points, points, image, texture((100, 130), seed=5), [1]).tracked < 0.4


def test_bootstrap_intervals_hold_the_mean_and_keep_pairs_together():
    generator = np.random.default_rng(0)
    easy = generator.random(40)
    values = np.column_stack((easy, easy + 0.05))   # the second is always better by the same
    means = intervals.bootstrap_means(values, seed=2)
    low, high = intervals.interval(means[:, 0])
    assert low < easy.mean() < high
    assert high - low == pytest.approx(2 * 1.96 * easy.std() / np.sqrt(40), rel=0.15)
    np.testing.assert_allclose(means[:, 1] - means[:, 0], 0.05)
    assert (means == intervals.bootstrap_means(values, seed=2)).all()


def test_bootstrap_leaves_out_what_is_not_known():
    means = intervals.bootstrap_means(np.array([[1, np.nan], [1, 3], [1, np.nan]]), seed=1)
    assert (means[:, 0] == 1).all()
    assert set(means[~np.isnan(means[:, 1]), 1]) == {3}


def test_thinned_keeps_the_stronger_of_near_points():
    points = key_points.empty(4)
    points['x'], points['y'] = [10, 11, 13, 10], [10, 10, 10, 30]
    assert thinned(points, 3)['x'].tolist() == [10, 13, 10]
    assert len(thinned(points, 0.5)) == 4
