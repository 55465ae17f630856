"""From any value to the nearest accepted one: what sliders, launch files and hostile requests give."""

import math

import pytest

from rvc_features.parameters import Choice, Flag, Integer, Real

ODD = Integer('', 3, 31, odd=True)


@pytest.mark.parametrize(('specification', 'value', 'previous', 'expected'), [
    (ODD, 7, 5, 7),
    (ODD, 12, 13, 11),          # a slider going down
    (ODD, 14, 13, 15),          # and up
    (ODD, 100, 13, 31),
    (ODD, 2, 5, 3),
    (ODD, -5, 5, 3),
    (ODD, 9.5, 5, 9),
    (ODD, 9.7, 5, 9),
    (ODD, 10.1, 5, 11),
    (ODD, '9', 5, 9),
    (ODD, True, 5, 3),
    (Integer('', 0), 1e9, 5, 1000000000),
    (Real('', 0, 1), 1, 0.5, 1.0),
    (Real('', 0, 1), 7, 0.5, 1.0),
    (Real('', 0, 1), '0.25', 0.5, 0.25),
    (Flag(''), 'True', False, True),
    (Flag(''), 0, True, False),
    (Flag(''), 1.0, False, True),
    (Choice('', ('gaussian', 'box')), ' Box', 'gaussian', 'box'),
])
def test_nearest(specification, value, previous, expected):
    nearest = specification.nearest(value, previous)
    assert nearest == expected
    assert type(nearest) is type(expected)
    assert specification.checked(nearest) == nearest


@pytest.mark.parametrize(('specification', 'value'), [
    (ODD, math.nan), (ODD, math.inf), (ODD, 10 ** 400), (ODD, 'abc'), (ODD, None), (ODD, [5]),
    (Real('', 0, 1), math.nan), (Real('', 0, 1), -math.inf), (Real('', 0, 1), 'abc'), (Real('', 0, 1), {}),
    (Real('', 0, 1, above_low=True), 0), (Real('', 0, 1, above_low=True), -3),
    (Flag(''), 'abc'), (Flag(''), 2), (Flag(''), math.nan), (Choice('', ('a', 'b')), 'c'), (Choice('', ('a', 'b')), 1),
])
def test_nothing_is_near(specification, value):
    with pytest.raises(ValueError):   # noqa: PT011, the text is another test's
        specification.nearest(value, None)


def test_a_slider_reaches_every_odd_value_both_ways():
    for values in (range(3, 32), range(31, 2, -1)):
        here, reached = values[0], set()
        for value in values:
            here = ODD.nearest(value, here)
            reached.add(here)
        assert reached == set(range(3, 32, 2))
