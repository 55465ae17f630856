"""Dynamic parameters of the odometry's front end, from the flat table to what its stages want. (No ROS here.)"""

from __future__ import annotations

from typing import Any

from rvc_features import parameters
from rvc_features.nodes import detector_config
from rvc_features.odometry.descriptors import SIZES
from rvc_features.odometry.masks import Border
from rvc_features.odometry.tracks import TrackerSettings
from rvc_features.parameters import Choice, Flag, Real

_BORDER = {f'border_{side}': side for side in ('left', 'right', 'top', 'bottom')}
_TRACKER = {'number_of_tracks': 'number_of_tracks', 'track_distance': 'least_distance',
            'track_window_size': 'window_size', 'track_levels': 'levels', 'track_forward_backward': 'forward_backward',
            'track_epipolar': 'epipolar', 'track_epipolar_distance': 'epipolar_distance'}

# Every parameter that is no detector's, with what it may be.
SPECIFICATIONS: dict[str, parameters.Specification] = {
    **{entry: parameters.specifications(Border)[field] for entry, field in _BORDER.items()},
    **{entry: parameters.specifications(TrackerSettings)[field] for entry, field in _TRACKER.items()},
    'trails': Flag('Draw the tracks into the image, as trails.'),
    'descriptor': Choice('Which descriptors are published.', tuple(SIZES)),
    'covariance': Flag('Publish a covariance with each key point.'),
    'covariance_noise': Real('Standard deviation of the noise in grey values; 0: as estimated from the image.', 0),
}
DEFAULTS: dict[str, Any] = {
    **{entry: parameters.defaults(Border)[field] for entry, field in _BORDER.items()},
    **{entry: parameters.defaults(TrackerSettings)[field] for entry, field in _TRACKER.items()},
    'trails': False, 'descriptor': 'orb', 'covariance': False, 'covariance_noise': 0.0}


def settle(config: dict[str, Any], previous: dict[str, Any]) -> list[str]:
    """As `detector_config.settle`, for the detectors' parameters and these."""
    return detector_config.settle(config, previous) + [
        problem for entry, specification in SPECIFICATIONS.items() if entry in config
        for problem in detector_config.settle_one(config, previous, entry, specification)]


def border(config: dict[str, Any]) -> Border:
    return Border(**{field: config[entry] for entry, field in _BORDER.items() if entry in config})


def tracker(config: dict[str, Any]) -> TrackerSettings:
    return TrackerSettings(**{field: config[entry] for entry, field in _TRACKER.items() if entry in config})
