"""Levels and sentences of /diagnostics, from plain numbers."""

import dataclasses

import numpy as np
import pytest

from rvc_features import key_points
from rvc_features.nodes import statistics
from rvc_features.nodes.diagnostics import ERROR, OK, WARN, Finding, Input, Situation, judge
from rvc_features.nodes.statistics import NodeStatistics, Report, Totals

CAMERA = '/camera/image_raw'
SECOND = Totals(1.0, 30, 30, 0, 0, 0.1)
WELL = Situation(
    'harris',
    Report(SECOND, Totals(5.0, 150, 150, 0, 0, 0.5), 0.005, 0.01, 0.03, 0.033, 0.02, (100, 120, 99), (0.8, 0.9)),
    Input(CAMERA, 'raw', 'sensor_msgs/Image', listeners=1, subscribed=True, connections=1, publishers=('/camera',),
          published_before=True, published_type='sensor_msgs/Image'),
    least_points=10, output_topic='/feature_detector/image')


def changed(report=None, images=None, **changes):
    """The same with changes: to the report, to the input, and to the situation itself."""
    return dataclasses.replace(WELL, report=WELL.report._replace(**report or {}),
                               input=dataclasses.replace(WELL.input, **images or {}), **changes)


def test_all_is_well():
    assert judge(WELL) == (OK, '30.0 images per second')


NONE = Totals(5.0, 0, 0, 0, 0, 0.0)
IDLE = {'listeners': 0, 'subscribed': False, 'connections': 0}


@pytest.mark.parametrize(('level', 'texts', 'situation'), [
    (OK, ['idle: nobody listens'], changed(images=IDLE)),
    (OK, ['idle: nobody listens'], changed(images={**IDLE, 'publishers': (), 'published_before': False})),
    (WARN, ['idle', 'nobody publishes /camera/image_raw (raw)'], changed(images={**IDLE, 'publishers': ()})),
    (WARN, ['idle', '/camera, which published /camera/image_raw, does not answer'],
     changed(images={**IDLE, 'silent': ('/camera',)})),
    (WARN, ['no images on /camera/image_raw/compressed (compressed) for 6 s'],
     changed({'silence': 6.0, 'usual_gap': 0.0},
             {'topic': CAMERA + '/compressed', 'transport': 'compressed'})),
    (OK, ['images per second'], changed({'silence': 4.0, 'usual_gap': 0.0})),   # has only just begun to listen
    (OK, ['images per second'], changed({'silence': 9.0, 'usual_gap': 4.0})),   # a slow camera
    (WARN, ['for 13 s'], changed({'silence': 13.0, 'usual_gap': 4.0})),
    (WARN, ['no images', 'for 3 s'], changed({'silence': 3.0})),
    (OK, ['images per second'], changed(images={'publishers': ()})),   # a new master does not know the camera
    (WARN, ['nobody publishes', 'set ~image_transport to compressed, which is there'],
     changed({'silence': 9.0}, {'publishers': (), 'connections': 0, 'other_transports': ('compressed',)})),
    (WARN, ['nobody publishes', '`in` is not remapped'],
     changed(images={**IDLE, 'publishers': (), 'remapped': False, 'published_before': False})),
    (ERROR, ['/camera/image_raw is of type sensor_msgs/PointCloud2; sensor_msgs/Image is wanted'],
     changed(images={'published_type': 'sensor_msgs/PointCloud2', 'connections': 0})),
    (ERROR, ['can not subscribe: no master'], changed(images={'problem': 'can not subscribe: no master'})),
    (ERROR, ['subscribing to /camera/image_raw has been taking 8 s'], changed(images={'subscribing': 8.0})),
    (WARN, ['overload: 100 of 150 images dropped in 5 s'],
     changed({'window': Totals(5.0, 150, 50, 100, 0, 5.0)})),
    (OK, ['images per second'], changed({'window': Totals(5.0, 150, 140, 10, 0, 5.0)})),
    (WARN, ['results come up to 2.5 s after their image'], changed({'age_worst': 2.5})),
    (WARN, ['images come 3.0 s after their stamp'], changed({'stamp_delay': 3.0})),
    (OK, ['images per second'], changed({'stamp_delay': 1e8})),    # a bag from another year
    (OK, ['images per second'], changed({'stamp_delay': None})),
    (WARN, ['too few key points: 3, where 10 are the least'], changed({'points': (5, 9, 3)})),
    (OK, ['images per second'], changed({'points': (5, 50, 3)})),
    (OK, ['images per second'], changed({'points': (0, 0, 0)}, least_points=0)),
    (WARN, ['nearly all key points lie within 10% x 20% of the image'], changed({'spread': (0.1, 0.2)})),
    (OK, ['images per second'], changed({'spread': (0.1, 0.9)})),
    (WARN, ['harris has been at work on one image for 4 s'], changed(busy=4.0)),
    (ERROR, ['harris has been at work on one image for 44 s'], changed(busy=44.0)),
    (WARN, ['2 calls of detectors that were given up still hang'], changed(abandoned=2)),
    (WARN, ['images rejected: data has 100 bytes (1 of 150 in 5 s)'],
     changed({'interval': Totals(1.0, 30, 29, 0, 1, 0.1), 'window': Totals(5.0, 150, 149, 0, 1, 0.5)},
             last_problem='data has 100 bytes')),
    (ERROR, ['images rejected: no such encoding (150 of 150 in 5 s)'],
     changed({'interval': Totals(1.0, 30, 0, 0, 30, 0), 'window': Totals(5.0, 150, 0, 0, 150, 0)},
             last_problem='no such encoding')),
    (WARN, ['/feature_detector/image is published by /camera, too'], changed(other_publishers=('/camera',))),
    (WARN, ['/a, /b, /c and 2 more'], changed(other_publishers=('/a', '/b', '/c', '/d', '/e'))),
    (WARN, ["starting: importing 'slow_module'"], changed(starting="importing 'slow_module'", images=IDLE)),
    (WARN, ['the master does not answer'], changed(master='the master does not answer')),
    (WARN, ['only the strongest'], changed(passing=('only the strongest 250,000',))),
    (ERROR, ["got 'theora'"], changed(lasting=(Finding(ERROR, "~image_transport must be raw; got 'theora'"),))),
])
def test_level_and_text(level, texts, situation):
    found = judge(situation)
    assert found.level == level, found
    for text in texts:
        assert text in found.text


def test_the_worst_comes_first_and_nothing_is_left_out():
    found = judge(changed({'age_worst': 2.5}, {'problem': 'can not subscribe'}, master='no master'))
    assert found == (ERROR, 'can not subscribe; no master; results come up to 2.5 s after their image')


def test_messages_stay_short():
    found = judge(changed(passing=('x' * 3000,), last_problem='y' * 3000))
    assert len(found.text) <= 400


# ---- What the numbers come from ----

class Clock:
    now = 1000.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(statistics, 'time', clock)
    return clock


def points(*positions):
    found = key_points.empty(len(positions))
    found['x'], found['y'] = np.transpose(positions) if positions else ((), ())
    return found


def test_totals_over_the_interval_and_the_window(clock):
    counts = [0, 0]
    counters = NodeStatistics(lambda: tuple(counts))
    for _ in range(10):
        clock.now += 1
        counts[0] += 3
        counts[1] += 1
        counters.frame_processed(points((1, 1)), (10, 10), 0.25, 0.5)
        counters.frame_rejected('no')
        report = counters.report()
    assert report.interval == (1, 3, 1, 1, 1, 0.25)
    assert report.window == (5, 15, 5, 5, 5, 1.25)


def test_ages_of_the_interval(clock):
    counters = NodeStatistics()
    for age in (0.1, 0.3, 0.2):
        counters.frame_processed(points(), (10, 10), 0.1, age)
    report = counters.report()
    assert (report.age_median, report.age_worst) == (0.2, 0.3)
    assert counters.report().age_worst == 0.0


def test_silence_and_the_usual_gap(clock):
    counters = NodeStatistics()
    clock.now += 2
    assert counters.report().silence == 2
    counters.waiting()
    assert counters.report().silence == 0
    for _ in range(4):
        clock.now += 3
        counters.frame_arrived()
    clock.now += 1
    report = counters.report()
    assert (report.silence, report.usual_gap) == (1, 3)


def test_causes_are_told_apart_without_what_differs_from_case_to_case():
    counters = NodeStatistics()
    for size in range(1000):
        counters.frame_rejected(f'data has {size} bytes')
        counters.frame_rejected(f"unknown encoding '{'x' * size}'")
        counters.frame_rejected(f'neither JPEG nor PNG: {size} bytes that begin with {size * 12345 + 10 ** 9:x}')
    counters.frame_rejected('without pixels')
    assert counters.causes == {'data has # bytes': 1000, "unknown encoding '...'": 1000, 'without pixels': 1,
                               'neither JPEG nor PNG: # bytes that begin with #': 1000}
    assert counters.causes_in_words().endswith('1 times without pixels')
    for kind in 'abcdefghijklmnopqrstuvwxyz':
        counters.frame_rejected(f'{kind} is wrong ' * 1000)
    assert len(counters.causes) == 13
    assert counters.causes['other causes'] == 26 - 8
    assert len(counters.causes_in_words()) < 2000
    assert len(counters.last_problem) <= 200


def test_the_spread_leaves_out_the_outer_tenth():
    counters = NodeStatistics()
    corner = [(i / 10, i / 5) for i in range(100)]
    counters.frame_processed(points(*corner, (99, 0), (0, 49), (90, 40)), (50, 100), 0.1, 0.1)
    width, height = counters.report().spread
    assert width == pytest.approx(0.1, abs=0.02)
    assert height == pytest.approx(0.4, abs=0.05)
    counters.frame_processed(points(), (50, 100), 0.1, 0.1)
    assert counters.report().spread == (0.0, 0.0)
