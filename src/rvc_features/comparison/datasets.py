"""What detectors are compared on: data sets of pairs of images, with or without a homography between them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Callable, Iterator, Sequence

if TYPE_CHECKING:   # quick to import, for the command line needs it
    import numpy as np

SEQUENCE, SYNTHETIC, FRAMES = 'sequence', 'synthetic', 'frames'
KINDS = 'auto', 'sequence', 'images', 'video', 'bag'

ACCEPTED = ('accepted are: a sequence with ground truth (folder with img1.png, img2.png, ... and H1to2p, ..., or with '
            '1.ppm, 2.ppm, ... and H_1_2, ...), a folder of such sequences, a folder of images, image files, a video, '
            'or a bag with --topic')


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two grey images and what is known of them; for frames the second may be missing, and the homography is."""

    group: str                       # what it is averaged with: a sequence, a kind of change, a recording
    name: str                        # within the group
    change: float | None             # how large the change is, for the curve of the group
    first: np.ndarray
    second: np.ndarray | None
    homography: np.ndarray | None
    note: str = ''
    sweep: bool = False              # whether time against the number of points is measured on it


@dataclasses.dataclass
class Dataset:
    """A source of pairs; `skipped` says, after a pass over `pairs()`, what could not be decoded and why."""

    name: str
    kind: str                        # SEQUENCE, SYNTHETIC or FRAMES
    description: str
    count: int | None                # of pairs; None where only reading tells
    make_pairs: Callable[[Dataset], Iterator[Pair]]
    change_unit: dict[str, str] = dataclasses.field(default_factory=dict)   # by group
    skipped: list[str] = dataclasses.field(default_factory=list)

    def pairs(self) -> Iterator[Pair]:
        self.skipped = []
        return self.make_pairs(self)


@dataclasses.dataclass(frozen=True)
class Options:
    """How inputs are read; see the command's help for each."""

    kind: str = 'auto'
    topic: str = ''
    every: int = 1
    maximum_frames: int | None = None
    crop_identity: bool = True
    seed: int = 1


def with_distinct_names(datasets: Sequence[Dataset]) -> list[Dataset]:
    """The same; those with a name that is taken get a number."""
    taken: set[str] = set()
    for dataset in datasets:
        base, number = dataset.name, 1
        while dataset.name in taken:
            number += 1
            dataset.name = f'{base} ({number})'
        taken.add(dataset.name)
    return list(datasets)
