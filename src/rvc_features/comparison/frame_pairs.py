"""Pairs without ground truth: each frame of a recording (images, video, bag) and the next."""

from __future__ import annotations

import itertools
import os
from typing import TYPE_CHECKING, Iterator, Sequence

import numpy as np

from rvc_features.comparison.datasets import ACCEPTED, FRAMES, Dataset, Options, Pair
from rvc_features.feature_detector import as_grey
from rvc_features.recordings.image_sources import Frame, ImageFiles, SourceError, Video, read_image

if TYPE_CHECKING:
    from rvc_features.recordings.bags import BagImages


def of_images(name: str, paths: Sequence[str], options: Options) -> Dataset:
    source = ImageFiles(paths)
    return _frames(name, f'{len(source)} image{"s" * (len(source) != 1)}', source, options)


def of_video(path: str, options: Options) -> Dataset:
    try:
        source = Video(path)
    except SourceError as error:
        raise SourceError(f'{error}; {ACCEPTED}') from None
    return _frames(os.path.basename(path), f'video of {len(source) or "an unknown number of"} frames', source, options)


def of_bag(path: str, options: Options) -> Dataset:
    try:
        from rvc_features.recordings.bags import BagImages  # here, for all other inputs work without ROS
    except ImportError as error:
        raise SourceError(f'{path}: reading bags needs ROS ({error}); {ACCEPTED}') from None
    source = BagImages(path, options.topic or None)
    return _frames(f'{os.path.basename(path)} {source.topic}', f'{len(source)} images on {source.topic}', source,
                   options)


def _frames(name: str, description: str, source: ImageFiles | Video | BagImages, options: Options) -> Dataset:
    def make_pairs(dataset: Dataset) -> Iterator[Pair]:
        previous: tuple[str, np.ndarray] | None = None
        for frame in _thinned(_grey_files(source) if isinstance(source, ImageFiles) else iter(source), options):
            image = as_grey(frame.image)
            if previous is not None:
                fits = previous[1].shape == image.shape
                note = '' if fits else 'the next image has another size, so nothing is tracked to it'
                yield Pair(name, previous[0], None, previous[1], image if fits else None, None, note)
            previous = frame.name, image
        if previous is not None:
            # Each frame is measured as the first of a pair; the last has none to go with it.
            yield Pair(name, previous[0], None, previous[1], None, None)
        dataset.skipped = list(getattr(source, 'skipped', ()))

    count = -(-len(source) // options.every)
    if options.maximum_frames is not None:
        count = min(count, options.maximum_frames)
    if 0 < count < len(source):
        description += f', {count} of them taken'
    return Dataset(name, FRAMES, description, count or None, make_pairs)


def _thinned(frames: Iterator[Frame], options: Options) -> Iterator[Frame]:
    return itertools.islice(frames, 0, None, options.every) if options.maximum_frames is None \
        else itertools.islice(frames, 0, options.every * options.maximum_frames, options.every)


def _grey_files(source: ImageFiles) -> Iterator[Frame]:
    for path in source.paths:
        yield Frame(path.name, read_image(path, grey=True), None)
