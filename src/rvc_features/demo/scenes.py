"""What the demo plays, and under which settings: bags of real frames, each shared out among the settings."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rvc_features import key_points as kp
from rvc_features import presets
from rvc_features.recordings.bags import BagImages
from rvc_features.recordings.image_sources import ImageFiles, Video
from rvc_features.recordings.make_bag import make_bag


def _of_preset(name: str, **others: Any) -> dict[str, Any]:
    """What a preset changes, as the node spells it, and others."""
    return {**{f'ANMS{key[4:]}' if key.startswith('anms') else key: value
               for key, value in presets.get(name).values.items()}, **others}


# What is shown, in order; each setting starts from the node's defaults.
SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ('repeatable (default)', _of_preset('repeatable')),
    ('strongest 150', {'fixed_number_of_points': True, 'number_of_points': 150}),
    ('even, 150', _of_preset('even', ANMS_points=150)),
    ('matching, 150', _of_preset('matching', number_of_points=150)),
    ('course', _of_preset('course')),
    ('course, ANMS 150', _of_preset('course', ANMS=True, ANMS_points=150)),
)

_EXAMPLES = Path('/usr/share/doc/opencv-doc/examples/data')   # of the Debian package opencv-doc
_STREET_FRAMES = 60


class DemoError(RuntimeError):
    """The demo can't go on; the text says why."""


@dataclass
class Scene:
    """A bag to play, how many images it has on the topic, and the one of them that is shown under every setting."""

    name: str
    bag: Path
    frames: int
    shown: np.ndarray   # uint8, (H, W, 3)


@dataclass
class Phase:
    """What one setting gave on one scene."""

    scene: Scene
    setting: str
    changes: dict[str, Any]
    frames: int                                     # its share of the scene's
    frames_in: int = 0
    frames_out: int = 0
    points: list[int] = field(default_factory=list)            # in each of its frames
    shown_points: np.ndarray = field(default_factory=kp.empty)   # in the scene's shown frame
    milliseconds: list[float] = field(default_factory=list)    # of the shown frame, which is sent several times


def phases_of(scene: Scene) -> list[Phase]:
    """Every setting, with equal shares of the scene's frames."""
    ends = [scene.frames * (index + 1) // len(SETTINGS) for index in range(len(SETTINGS))]
    return [Phase(scene, name, changes, end - begin)
            for (name, changes), begin, end in zip(SETTINGS, [0, *ends], ends)]


def real_frames(output: Path) -> tuple[list[Scene], str]:
    """Two bags of real frames: a chessboard held by hand, and a street seen by a fixed camera."""
    chessboard, street = sorted(_EXAMPLES.glob('left[0-9][0-9].jpg')), _EXAMPLES / 'vtest.avi'
    if not chessboard or not street.is_file():
        raise DemoError(f'no frames in {_EXAMPLES}: install the package opencv-doc, or name a bag with --bag')
    start, topic = time.time(), '/camera/image_raw'
    scenes = []
    sources = ('chessboard', ImageFiles(chessboard), 2.0), ('street', Video(street, _STREET_FRAMES), 10.0)
    for name, source, rate in sources:
        bag = output / f'{name}.bag'
        frames = make_bag(bag, source, rate, topic, start=start, overwrite=True)
        start += frames / rate
        scenes.append(_scene(name, BagImages(bag, topic)))
    return scenes, topic


def own_bag(bag: str, topic: str | None) -> tuple[list[Scene], str]:
    """A bag of the user's, and its image topic; SourceError where there is none."""
    images = BagImages(bag, topic)
    return [_scene(images.path.stem[:12], images)], images.topic


def _scene(name: str, images: BagImages) -> Scene:
    """The frame that is shown is the one in the middle of those that can be decoded."""
    middle = None
    for frame in itertools.islice(images, len(images) // 2 + 1):
        middle = frame.image
    if middle is None:
        raise DemoError(f'{images.path}: its images on {images.topic} can not be decoded'
                        + (f'; the first: {images.skipped[0]}' if images.skipped else ''))
    return Scene(name, images.path, len(images), middle)
