"""Whatever is asked for, by slider, launch file or request: a detector comes of it, and it works on any image."""

import numpy as np
import pytest

hypothesis = pytest.importorskip('hypothesis')

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as some  # noqa: E402

from rvc_features import detectors, parameters  # noqa: E402
from rvc_features.brief import shown  # noqa: E402
from rvc_features.nodes import detector_config  # noqa: E402

ECONOMICAL = settings(max_examples=25, deadline=None, derandomize=True, database=None)

ANYTHING = some.one_of(
    some.none(), some.booleans(), some.integers(), some.integers(-5, 40), some.floats(), some.floats(0, 1),
    some.text(max_size=20), some.binary(max_size=20), some.lists(some.integers(), max_size=3),
    some.sampled_from(['harris', 'orb', 'gaussian', 'box', '9_16', 'True', '7', '1e-310', '1' * 400]),
    some.sampled_from([10 ** 400, 2 ** 64, -2 ** 31, 5e-324, 1e308, '\udcff', 'x' * 10_000]))
FIELDS = [(name, field) for name in detectors.names()
          for field in parameters.specifications(detectors.get(name))]
DEFAULTS = {'detector': 'harris', **{detector_config.key(name, field): parameters.defaults(detectors.get(name))[field]
                                     for name, field in FIELDS}}


@pytest.mark.parametrize(('name', 'field'), FIELDS, ids=[f'{name}.{field}' for name, field in FIELDS])
@given(value=ANYTHING)
@ECONOMICAL
def test_the_nearest_value_is_one_that_is_accepted(name, field, value):
    specification = parameters.specifications(detectors.get(name))[field]
    try:
        nearest = specification.nearest(value, parameters.defaults(detectors.get(name))[field])
    except ValueError:
        return   # there is none
    assert specification.checked(nearest) == nearest


@given(changes=some.dictionaries(some.sampled_from(sorted(DEFAULTS)), ANYTHING),
       detector=some.sampled_from(detectors.names()))
@ECONOMICAL
def test_any_request_settles_and_its_detector_can_be_made(changes, detector):
    config = {**DEFAULTS, 'detector': detector, **changes}
    problems = detector_config.settle(config, DEFAULTS)
    assert all(len(problem) < 400 for problem in problems)
    detector_config.create(config)
    assert detector_config.settle(dict(config), config) == []   # it has settled


SLIDERS = {   # as wide as cfg/FeatureDetectorConfig.cfg has them, where that is less than what a detector accepts
    'number_of_points': some.integers(0, 5000), 'anms_points': some.integers(0, 5000),
    'window_size': some.integers(1, 15).map(lambda half: 2 * half + 1), 'border': some.integers(0, 100),
    'minimum_response': some.floats(0, 1e6), 'orientation_sigma': some.floats(0.1, 10),
    'minimum_distance': some.floats(0, 50), 'block_size': some.integers(1, 31)}


def any_value(field, specification):
    if field in SLIDERS:
        return SLIDERS[field]
    if isinstance(specification, parameters.Flag):
        return some.booleans()
    if isinstance(specification, parameters.Choice):
        return some.sampled_from(specification.choices)
    if isinstance(specification, parameters.Integer):
        step = 2 if specification.odd else 1
        return some.sampled_from(range(specification.low, specification.high + 1, step))
    return some.floats(specification.low, min(specification.high, 1e6), exclude_min=specification.above_low)


@pytest.mark.slow
@pytest.mark.parametrize('name', detectors.names())
@given(data=some.data())
@ECONOMICAL
def test_any_setting_works_on_any_image(name, data):
    """What a detector returns is checked where it returns it, so that nothing but errors has to be looked for."""
    specifications = parameters.specifications(detectors.get(name))
    values = {field: data.draw(any_value(field, specification), label=field)
              for field, specification in specifications.items()}
    shape = data.draw(some.tuples(some.integers(1, 90), some.integers(1, 90)), label='shape')
    image = np.random.default_rng(data.draw(some.integers(0, 9))).integers(0, 256, shape, np.uint8)
    image = data.draw(some.sampled_from([image, image // 200 * 255, np.full(shape, 7, np.uint8)]))
    mask = data.draw(some.sampled_from([None, image > 100, np.zeros(shape, bool)]))
    detector = detectors.create(name, **values)
    found = detector.detect_arrays(image, mask)
    if mask is not None and len(found):
        assert mask.any()


@given(value=ANYTHING)
@ECONOMICAL
def test_whatever_is_shown_is_short(value):
    assert len(shown(value)) < 300
