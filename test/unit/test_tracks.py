"""Tracks: where points go, whose identity is whose, and what ends one or begins anew."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors
from rvc_features.odometry.tracks import DTYPE, Tracker, TrackerSettings, _epipolar_inliers
from rvc_features.odometry.trails import Trails

HARRIS = detectors.create('harris')
SHAPE = 240, 320
SCENE = texture((480, 640), 5)


def view(homography, noise=2, seed=0):
    """A picture of the scene; the homography takes positions of the scene into it."""
    image = cv2.warpPerspective(SCENE, homography, SHAPE[::-1], flags=cv2.INTER_LINEAR)
    noisy = image + np.random.default_rng(seed).normal(0, noise, SHAPE)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def motion(step, turn=0.0, zoom=1.0, across=0.0):
    """The scene's middle turned and scaled about the picture's middle, and moved."""
    angle, scale = np.radians(turn * step), zoom ** step
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * scale
    offset = np.array([160 + across * step, 120]) - matrix @ (320, 240)
    return np.vstack((np.column_stack((matrix, offset)), (0, 0, 1)))


def positions(tracks):
    return np.column_stack((tracks['x'], tracks['y'])).astype(np.float64)


@pytest.mark.parametrize('how', [{'across': 2.3}, {'turn': 1.0}, {'zoom': 1.01}, {'zoom': 0.99, 'turn': -0.5}])
def test_drift_over_thirty_frames_of_known_motion(how):
    tracker = Tracker(TrackerSettings(number_of_tracks=150))
    for step in range(31):
        tracks = tracker.track(view(motion(step, **how), seed=step), step / 30, HARRIS)
    old = tracks[tracks['age'] == 30]
    assert len(old) >= 25
    start = np.column_stack((old['start_x'], old['start_y'])).astype(np.float64)
    there = cv2.perspectiveTransform(start[None], motion(30, **how) @ np.linalg.inv(motion(0, **how)))[0]
    assert np.median(np.hypot(*(positions(old) - there).T)) <= 0.5


def test_ages_starts_and_velocities():
    tracker = Tracker()
    first = tracker.track(view(motion(0)), 10.0, HARRIS)
    assert first.dtype == DTYPE
    assert not first['age'].any()
    assert not first['velocity_x'].any()
    np.testing.assert_array_equal(first['x'], first['start_x'])
    second = tracker.track(view(motion(1, across=3.0)), 10.5, HARRIS)
    followed = second[second['age'] == 1]
    assert len(followed) > 0.6 * len(first)
    before = first[np.searchsorted(first['id'], followed['id'])]
    np.testing.assert_array_equal(before['x'], followed['start_x'])
    np.testing.assert_array_equal(followed['start_time'], 10.0)
    assert abs(np.median(followed['velocity_x']) - 6.0) < 0.1
    assert abs(np.median(followed['velocity_y'])) < 0.1
    assert tracker.interval == 0.5


def test_the_budget_and_the_least_distance_hold():
    tracker = Tracker(TrackerSettings(number_of_tracks=60, least_distance=15))
    for step in range(10):
        tracks = tracker.track(view(motion(step, across=3.0)), float(step), HARRIS)
        assert 50 <= len(tracks) <= 60
        new = positions(tracks[tracks['age'] == 0])
        for point in new:
            distances = np.sort(np.hypot(*(positions(tracks) - point).T))
            assert distances[1] >= 15 - 1e-3
    tracker.settings = TrackerSettings(number_of_tracks=0)
    assert len(tracker.track(view(motion(10)), 10.0, HARRIS)) == 0


class CountingDetector:
    """Harris, counting what it is asked."""

    def __init__(self):
        self.calls = 0

    def detect_arrays(self, image, mask=None):
        self.calls += 1
        return HARRIS.detect_arrays(image, mask)


def test_the_detector_is_asked_where_many_are_lost_or_few_for_long():
    tracker, detector = Tracker(TrackerSettings(number_of_tracks=60, least_distance=15)), CountingDetector()
    for step in range(30):
        tracks = tracker.track(view(motion(step, across=1.0), seed=step), float(step), detector)
        assert len(tracks) >= 50
    assert 2 <= detector.calls <= 10   # the scene moves out by one pixel a frame
    before = detector.calls
    tracks = tracker.track(texture(SHAPE, 99), 30.0, detector)
    assert detector.calls == before + 1
    assert np.count_nonzero(tracks['age'] == 0) > 40


def test_key_points_that_are_known_are_taken_before_the_detector_is_asked():
    image, detector = view(motion(0)), CountingDetector()
    found = HARRIS.detect_arrays(image)
    tracks = Tracker(TrackerSettings(number_of_tracks=50)).track(image, 0.0, detector, found=found)
    assert detector.calls == 0
    assert len(tracks) == 50
    assert np.isin(tracks['x'], found['x']).all()
    tracks = Tracker(TrackerSettings(number_of_tracks=50)).track(image, 0.0, detector, found=found[:5])
    assert detector.calls == 1
    assert len(tracks) == 50
    np.testing.assert_array_equal(tracks['x'][:2], found['x'][:2])


def test_tracks_never_lie_under_the_mask():
    """With any detector, new or followed: the pixel that a track lies in is allowed."""
    generator = np.random.default_rng(0)
    for name in detectors.names():
        tracker, detector = Tracker(TrackerSettings(number_of_tracks=100, least_distance=5)), detectors.create(name)
        for step in range(12):
            mask = np.kron(generator.random((12, 16)) < 0.6, np.ones((20, 20))).astype(np.uint8)
            tracks = tracker.track(view(motion(step, across=4.0, turn=0.5)), step / 30, detector, mask)
            column, row = np.rint(positions(tracks)).astype(int).T
            assert mask[row, column].all()
        assert len(tracks) > 10


def test_ids_are_never_used_again_whatever_the_camera_does():
    """Drops, loops of a bag, restarts, other sizes, blank images: a track of some id has one life without a gap."""
    generator = np.random.default_rng(0)
    scenes = [texture((60, 80), seed) for seed in range(4)]
    tracker = Tracker(TrackerSettings(number_of_tracks=12, least_distance=6, window_size=9, levels=2))
    last_seen, seen, stamp = {}, set(), 0.0
    for step in range(1500):
        event = generator.random()
        stamp = 0.0 if event < 0.01 else stamp + (3.0 if event < 0.02 else 0.1)
        image = np.roll(scenes[int(generator.integers(4)) if event < 0.03 else step // 100 % 4], step % 7, axis=1)
        if 0.03 < event < 0.035:
            image = np.zeros((70, 80), np.uint8)
        if 0.035 < event < 0.04:
            tracker.reset()
        tracks = tracker.track(image, stamp, HARRIS)
        ids = tracks['id'].tolist()
        assert len(set(ids)) == len(ids)
        for identity, age in zip(ids, tracks['age'].tolist()):
            if age == 0:
                assert identity not in seen
                seen.add(identity)
            else:
                assert last_seen[identity] == step - 1
            last_seen[identity] = step
    assert len(seen) > 500


def test_a_clock_that_jumps_back_starts_anew():
    tracker = Tracker()
    first = tracker.track(view(motion(0)), 5.0, HARRIS)
    again = tracker.track(view(motion(0)), 4.9, HARRIS)
    assert not again['age'].any()
    assert again['id'].min() > first['id'].max()
    assert tracker.interval == 0
    same_stamp = tracker.track(view(motion(0)), 4.9, HARRIS)
    assert same_stamp['age'].max() == 1
    assert not same_stamp['velocity_x'].any()


def test_what_does_not_come_back_ends():
    tracker = Tracker()
    first = tracker.track(view(motion(0)), 0.0, HARRIS)
    second = tracker.track(texture(SHAPE, 99), 0.1, HARRIS)
    assert np.isin(second['id'], first['id']).sum() < 0.2 * len(first)


def test_the_epipolar_test_tells_what_moves_otherwise_than_the_scene():
    generator = np.random.default_rng(0)
    points = np.column_stack((generator.uniform(-2, 2, (200, 2)), generator.uniform(4, 8, 200)))
    start = 500 * points[:, :2] / points[:, 2:] + (320, 240)
    points -= (0.3, -0.1, 0.4)
    there = 500 * points[:, :2] / points[:, 2:] + (320, 240) + generator.normal(0, 0.1, (200, 2))
    there[:30] += generator.uniform(8, 15, (30, 2)) * (1, -1)   # these move by themselves
    for undistort, scale in ((None, 1.0), (lambda pixels: pixels * 4, 0.25)):
        fits = _epipolar_inliers(start * scale, there * scale, 1.0, undistort)
        assert fits[30:].mean() > 0.95
        assert fits[:30].mean() < 0.3


def test_with_the_epipolar_test_what_moves_with_the_scene_goes_on():
    tracker = Tracker(TrackerSettings(epipolar=True))
    for step in range(3):
        tracks = tracker.track(view(motion(step, across=2.0, turn=0.5)), step / 10, HARRIS)
    assert np.count_nonzero(tracks['age'] == 2) > 50


@pytest.mark.parametrize('image', [np.zeros(SHAPE, np.uint8), np.zeros((1, 1), np.uint8), np.zeros((3, 500), np.uint8)])
def test_images_with_nothing_to_follow(image):
    tracker = Tracker()
    for step in range(3):
        assert len(tracker.track(image, float(step), HARRIS)) == 0


def test_the_callers_image_may_change_afterwards():
    tracker, image = Tracker(), view(motion(0))
    tracker.track(image, 0.0, HARRIS)
    image[:] = 0
    assert np.count_nonzero(tracker.track(view(motion(1, across=2.0)), 0.1, HARRIS)['age']) > 50


def test_a_time_that_is_none_is_refused():
    with pytest.raises(ValueError, match='time must be a finite number of seconds; got nan'):
        Tracker().track(view(motion(0)), float('nan'), HARRIS)


def test_trails_are_drawn_where_the_tracks_came_from():
    tracks = np.zeros(2, DTYPE)
    tracks['id'] = 7, 3
    trails = Trails(5)
    for step in range(4):
        tracks['x'], tracks['y'] = (10 + 10 * step, 50), (20, 40)
        trails.add(tracks)
    picture = trails.draw(np.zeros((60, 80, 3), np.uint8))
    assert picture[20, 10:41].any(axis=1).all()
    assert not picture[20, 46:].any()
    assert picture[40, 50].any()
    trails.add(tracks[1:])
    assert not trails.draw(np.zeros((60, 80, 3), np.uint8))[20].any()
