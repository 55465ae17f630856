"""The three filters; ANMS against the definition, computed by brute force."""

import numpy as np
import pytest

from rvc_features import filters
from rvc_features.filters import adaptive_non_maximal_suppression


def brute_force(points, responses, count, robustness=0.9):
    """Radius of every point by its definition; sorted by radius, response, index."""
    radii = []
    for i, point in enumerate(points):
        distances = [np.sqrt((point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2)
                     for j, other in enumerate(points) if responses[i] < robustness * responses[j]]
        radii.append(min(distances, default=np.inf))
    order = sorted(range(len(points)), key=lambda i: (-radii[i], -responses[i], i))
    return order[:count]


def cases():
    random = np.random.default_rng(0)
    uniform = random.uniform(0, 640, (200, 2))
    yield 'uniform', uniform, random.uniform(10, 1000, 200)
    yield 'whole pixels with ties', random.integers(0, 20, (200, 2)).astype(float), random.integers(1, 8, 200) * 1.0
    yield 'duplicates', np.repeat(uniform[:40], 5, axis=0), random.uniform(10, 1000, 200)
    yield 'all in one place', np.full((60, 2), 7.0), random.uniform(10, 1000, 60)
    yield 'equal responses', uniform[:80], np.full(80, 5.0)
    yield 'line', np.column_stack((np.arange(150.0), np.zeros(150))), random.uniform(1, 100, 150)
    yield 'falling line', np.column_stack((np.arange(150.0), np.arange(150.0))), np.geomspace(1e6, 1, 150)
    yield 'grid', np.argwhere(np.ones((14, 14))).astype(float), random.integers(1, 40, 196).astype(float)
    clusters = np.concatenate([random.normal(centre, 0.5, (50, 2)) for centre in ((0, 0), (900, 5), (30, 700))])
    yield 'clusters', clusters, random.exponential(100, 150)
    yield 'float32', uniform.astype(np.float32), random.exponential(1e9, 200).astype(np.float32)
    yield 'one', np.array([[3.0, 4.0]]), np.array([1.0])
    yield 'none', np.zeros((0, 2)), np.zeros(0)


CASES = {name: (points, responses) for name, points, responses in cases()}


@pytest.mark.parametrize('robustness', [0.9, 1.0, 0.3])
@pytest.mark.parametrize('case', CASES)
def test_anms_equals_brute_force_in_order(case, robustness):
    points, responses = CASES[case]
    expected = brute_force(points.astype(float), responses.astype(float), len(points), robustness)
    assert adaptive_non_maximal_suppression(points, responses, len(points), robustness).tolist() == expected


@pytest.mark.parametrize('count', [0, 1, 2, 7, 199, 200, 201, 1000])
def test_anms_count(count):
    points, responses = CASES['whole pixels with ties']
    expected = brute_force(points, responses, count)
    assert adaptive_non_maximal_suppression(points, responses, count).tolist() == expected


def test_anms_input_order_does_not_matter():
    points, responses = CASES['clusters']
    order = np.random.default_rng(5).permutation(len(points))
    chosen = adaptive_non_maximal_suppression(points, responses, 40)
    shuffled = adaptive_non_maximal_suppression(points[order], responses[order], 40)
    assert np.array_equal(points[order][shuffled], points[chosen])


def test_anms_keeps_the_strongest_even_in_a_crowd():
    points = np.array([[0.0, 0], [0, 0], [500, 500]])
    assert adaptive_non_maximal_suppression(points, [9.0, 10, 1], 1).tolist() == [1]


def test_anms_negative_responses_keep_the_strongest():
    assert adaptive_non_maximal_suppression([[0, 0], [1, 0], [5, 0]], [-3.0, -1.0, -2.0], 1).tolist() == [1]


def test_anms_spreads_points():
    """A dense strong cluster and a sparse weak rest: the strongest N stay in the cluster, ANMS leaves it."""
    random = np.random.default_rng(3)
    points = np.concatenate((random.uniform(0, 10, (100, 2)), random.uniform(0, 640, (100, 2))))
    responses = np.concatenate((random.uniform(500, 1000, 100), random.uniform(10, 100, 100)))
    strongest = filters.strongest(responses, 50)
    spread = adaptive_non_maximal_suppression(points, responses, 50)
    assert (points[strongest] < 10).all()
    assert (points[spread] > 10).any(axis=1).sum() > 30


@pytest.mark.parametrize(('points', 'responses', 'count', 'robustness', 'error', 'text'), [
    ([[0, 0]], [1, 2], 1, 0.9, ValueError, r'got \(1, 2\) and \(2,\)'),
    ([0, 0], [1, 2], 1, 0.9, ValueError, 'points must have shape'),
    ([[0, np.nan]], [1], 1, 0.9, ValueError, 'finite'),
    ([[0, 0]], [np.nan], 1, 0.9, ValueError, 'finite'),
    ([[0, 'x']], [1], 1, 0.9, TypeError, 'numbers'),
    ([[0, 0]], [1], -1, 0.9, ValueError, 'count must be an integer of at least 0; got -1'),
    ([[0, 0]], [1], 1.5, 0.9, TypeError, 'count must be an integer'),
    ([[0, 0]], [1], 1, 0.0, ValueError, 'robustness must be a finite number above 0, at most 1; got 0.0'),
    ([[0, 0]], [1], 1, 1.1, ValueError, 'robustness must be'),
])
def test_anms_bad_arguments_are_named(points, responses, count, robustness, error, text):
    with pytest.raises(error, match=text):
        adaptive_non_maximal_suppression(points, responses, count, robustness)


def test_strongest_takes_the_lower_index_of_equals():
    assert filters.strongest(np.array([5.0, 9, 5, 9, 1]), 3).tolist() == [1, 3, 0]
    assert filters.strongest(np.array([5.0, 9]), 7).tolist() == [1, 0]
    assert filters.strongest(np.array([5.0, 9]), 0).tolist() == []


def test_above_threshold_is_strictly_above():
    assert filters.above_threshold(np.array([1.0, 10, 5, 7]), 0.5, 10.0).tolist() == [1, 3]
    assert filters.above_threshold(np.zeros(0), 0.5, 0.0).tolist() == []
