"""The command line: `rosrun rvc_features compare_tracks`, or `python3 -m rvc_features.comparison.track_command`.

Detectors are compared by the tracks that begin at their points, beside a recipe of plain OpenCV.
"""

from __future__ import annotations

import argparse
import functools
import sys
import time
from typing import Any, Callable, Iterable, Iterator, Sequence

import cv2
import numpy as np

from rvc_features import detectors
from rvc_features.command_line import (
    BAD_INPUT,
    Interrupted,
    at_least,
    print_safely,
    quiet_opencv,
    signals_as_exceptions,
)
from rvc_features.comparison import contestants, track_measures, warps
from rvc_features.comparison.contestants import ContestantError
from rvc_features.feature_detector import FeatureDetector, as_grey
from rvc_features.odometry import tracks as followed
from rvc_features.recordings.image_sources import Frame, SourceError, open_source, read_image

MOTIONS = {     # of a photograph, for each frame: degrees, factor of size, pixels to the right
    'moved': (0.0, 1.0, 2.5), 'turned 1 degree': (1.0, 1.0, 0.0), 'enlarged 1 %': (0.0, 1.01, 0.0)}
_NOISE = 3.0    # grey values, of each frame of those
_RATE = 30.0    # frames per second where a source knows none
_SIDES = 640, 480


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    parser = argparse.ArgumentParser(
        prog='compare_tracks', description='Follow the points of detectors through videos and images, and through a '
        'photograph in known motion, and tell how long tracks last and how far they drift. See docs/odometry.md.')
    parser.add_argument('input', nargs='*', help='video, image file, or folder of images in the order of their names')
    parser.add_argument('-d', '--detector', action='append', default=[], metavar='[LABEL=]NAME[:PARAMETER=VALUE,...]',
                        help=f'of {", ".join(detectors.names())}; may be repeated (default: harris)')
    parser.add_argument('--tracks', type=at_least(1), default=150, metavar='N',
                        help='at the most (default: %(default)s)')
    parser.add_argument('--photograph', help='what is put in known motion (default: one that comes with OpenCV)')
    print_safely()
    given = parser.parse_args(arguments)
    quiet_opencv()
    try:
        with signals_as_exceptions():
            _compare(given)
    except (SourceError, ContestantError, ValueError) as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return BAD_INPUT
    except Interrupted as interruption:
        print(f'{parser.prog}: {interruption}', file=sys.stderr)
        return interruption.status
    return 0


def _compare(given: argparse.Namespace) -> None:
    group = contestants.with_distinct_labels([contestants.parse(text, 0) for text in given.detector or ['harris']])
    settings = followed.TrackerSettings(number_of_tracks=given.tracks)
    path = given.photograph or warps.default_photograph()
    photograph = read_image(path, grey=True) if path else warps.generated_photograph()
    # A name for each way to make frames; a homography from the first one where it is known.
    scenes: dict[str, Callable[[], Iterator[tuple[np.ndarray, np.ndarray | None]]]] = {
        f'photograph {name}': functools.partial(in_motion, photograph, *motion) for name, motion in MOTIONS.items()}
    for path in given.input:   # opened now: what can't be read is said before anything is measured
        scenes[path] = functools.partial(_frames, open_source([path]))
    print(f'{"":34}{"tracks":>8}{"median length":>15}{"survive":>9}{"drift px":>10}{"rigid":>7}{"ms":>7}'
          f'{"of flow":>9}')
    for name, frames in scenes.items():
        print(name)
        for contestant in group:
            tracker = followed.Tracker(settings)
            _row(contestant.label, frames(), functools.partial(_tracked, tracker, contestant.detector))
        _row('plain OpenCV', frames(), PlainRecipe(given.tracks).track)


def in_motion(photograph: np.ndarray, degrees: float, zoom: float, right: float,
              frames: int = track_measures.FRAMES + 1) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frames of a photograph that moves, with noise, and the homography from the first one to each."""
    width, height = _SIDES
    scale = 1.5 * max(width / photograph.shape[1], height / photograph.shape[0])
    middle = (photograph.shape[1] - 1) / 2, (photograph.shape[0] - 1) / 2
    first = None
    for number in range(frames):
        motion = np.vstack((cv2.getRotationMatrix2D(middle, degrees * number, scale * zoom ** number), (0, 0, 1)))
        shift = warps.shift(width / 2 - middle[0] + right * (number - frames / 2), height / 2 - middle[1])
        homography = shift @ motion
        first = homography if first is None else first
        image = cv2.warpPerspective(photograph, homography, _SIDES, flags=cv2.INTER_CUBIC)
        noise = np.random.default_rng(number).normal(0, _NOISE, image.shape)
        yield np.clip(np.rint(image + noise), 0, 255).astype(np.uint8), homography @ np.linalg.inv(first)


class PlainRecipe:
    """How many visual odometries begin, VINS-Mono for one: what a tracker is to be better than.

    Good features to track (quality 0.01, 30 pixels apart), flow in a window of 21 x 21 with 3 levels above the image,
    RANSAC of the fundamental matrix (1 pixel, 0.99), and of tracks nearer than 30 pixels only the oldest.
    """

    distance = 30

    def __init__(self, count: int) -> None:
        self._count, self._next_id = count, 0
        self._tracks: np.ndarray = np.zeros(0, followed.DTYPE)
        self._image: np.ndarray | None = None

    def track(self, image: np.ndarray, seconds: float) -> np.ndarray:
        """The tracks in the next frame; without velocities."""
        if self._image is None or self._image.shape != image.shape:
            self._tracks = np.zeros(0, followed.DTYPE)
        tracks = self._tracks
        if len(tracks):
            start = np.column_stack((tracks['x'], tracks['y']))
            there, found, _ = cv2.calcOpticalFlowPyrLK(   # type: ignore[call-overload]
                self._image, image, start, None, winSize=(21, 21), maxLevel=3)
            nearest = np.rint(there)
            kept = (found.ravel() != 0) & (nearest >= 1).all(axis=1) \
                & (nearest < (image.shape[1] - 1, image.shape[0] - 1)).all(axis=1)
            tracks, start, there = tracks[kept].copy(), start[kept], there[kept]
            tracks['x'], tracks['y'] = there.T
            tracks['age'] += 1
            if len(tracks) >= 8:
                _, inliers = cv2.findFundamentalMat(start, there, cv2.FM_RANSAC, 1.0, 0.99)
                tracks = tracks if inliers is None else tracks[inliers.ravel() != 0]
        mask = np.full(image.shape, 255, np.uint8)
        kept_ones = []
        for index in np.argsort(-tracks['age'].astype(int), kind='stable'):
            x, y = round(float(tracks['x'][index])), round(float(tracks['y'][index]))
            if mask[y, x]:
                kept_ones.append(index)
                cv2.circle(mask, (x, y), self.distance, (0,), cv2.FILLED)
        tracks = tracks[kept_ones]
        corners: Any = None
        if len(tracks) < self._count:
            corners = cv2.goodFeaturesToTrack(image, self._count - len(tracks), 0.01, self.distance, mask=mask)
        if corners is not None:
            new = np.zeros(len(corners), followed.DTYPE)
            new['id'] = self._next_id + np.arange(len(new))
            new['x'], new['y'] = new['start_x'], new['start_y'] = corners[:, 0].T
            self._next_id += len(new)
            tracks = np.concatenate((tracks, new))
        self._tracks, self._image = tracks, image
        return tracks


def _frames(source: Iterable[Frame]) -> Iterator[tuple[np.ndarray, None]]:
    return ((as_grey(frame.image), None) for frame in source)


def _tracked(tracker: followed.Tracker, detector: FeatureDetector, image: np.ndarray, seconds: float) -> np.ndarray:
    return tracker.track(image, seconds, detector)


def _row(label: str, frames: Iterator[tuple[np.ndarray, np.ndarray | None]],
         track: Callable[[np.ndarray, float], np.ndarray]) -> None:
    history: list[np.ndarray] = []
    homographies, busy, flow, before = [], 0.0, 0.0, np.zeros((0, 0), np.uint8)
    for number, (image, homography) in enumerate(frames):
        start = time.process_time()
        history.append(track(image, number / _RATE))
        busy += time.process_time() - start
        if number and before.shape == image.shape and len(history[-2]):
            flow += _plain_flow_seconds(before, image, history[-2])
        homographies.append(homography)
        before = image
    last = homographies[track_measures.FRAMES] if len(homographies) > track_measures.FRAMES else None
    missed = track_measures.drift(history[track_measures.FRAMES], last) if last is not None else np.zeros(0)
    numbers = (f'{np.mean([len(tracks) for tracks in history]):.0f}', f'{np.median(track_measures.lengths(history)):g}',
               _shown(track_measures.survival(history)), _shown(float(np.median(missed)) if len(missed) else None),
               _shown(track_measures.rigid_share(history)), f'{1000 * busy / len(history):.1f}',
               _shown(busy / flow if flow else None))
    print(f'  {label:32}' + ''.join(f'{number:>{width}}' for number, width in zip(numbers, (8, 15, 9, 10, 7, 7, 9))),
          flush=True)


def _plain_flow_seconds(before: np.ndarray, image: np.ndarray, tracks: np.ndarray) -> float:
    """Processor time that OpenCV's flow takes alone, there and not back, with its own defaults."""
    positions = np.column_stack((tracks['x'], tracks['y']))
    start = time.process_time()
    cv2.calcOpticalFlowPyrLK(before, image, positions, None)   # type: ignore[call-overload]
    return time.process_time() - start


def _shown(value: float | None) -> str:
    return '' if value is None else f'{value:.2f}'


if __name__ == '__main__':
    sys.exit(main())
