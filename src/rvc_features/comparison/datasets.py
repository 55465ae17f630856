"""What detectors are compared on: pairs of images, one after the other, with or without a homography between them.

`open_inputs` tells from the paths what they are: sequences with ground truth in the layout of Oxford/VGG
(img1.png, img2.png, H1to2p) or HPatches (1.ppm, 2.ppm, H_1_2), folders and lists of images, videos, bags.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Callable, Iterator, Sequence

import numpy as np

from rvc_features.comparison import homographies, warps
from rvc_features.feature_detector import as_grey
from rvc_features.recordings.image_sources import (
    Frame,
    ImageFiles,
    SourceError,
    Video,
    is_image,
    natural_order,
    read_image,
)

if TYPE_CHECKING:
    from rvc_features.recordings.bags import BagImages

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


def open_inputs(paths: Sequence[str], options: Options) -> list[Dataset]:
    """One data set for each path, and one for all image files among them together."""
    datasets, image_files = [], []
    for path in paths:
        if not os.path.exists(path):
            raise SourceError(f'{path}: no such file or folder; {ACCEPTED}')
        if os.path.isdir(path):
            datasets += _open_folder(path, options)
        elif options.kind == 'bag' or (options.kind == 'auto' and path.lower().endswith('.bag')):
            datasets.append(_bag(path, options))
        elif options.kind in ('auto', 'images') and is_image(Path(path)):
            image_files.append(path)
        elif options.kind in ('auto', 'video'):
            datasets.append(_video(path, options))
        else:
            raise SourceError(f'{path}: can not be taken as {options.kind}; {ACCEPTED}')
    if image_files:
        folders = sorted({os.path.basename(os.path.dirname(os.path.abspath(path))) for path in image_files})
        datasets.append(_images(' + '.join(folders), image_files, options))
    return with_distinct_names(datasets)


def single_pair(first: str, second: str, homography: str, options: Options) -> Dataset:
    """One pair of image files and the file with their homography."""
    name = f'{_stem(first)}, {_stem(second)}'
    return _sequence(name, [(f'{_stem(first)} to {_stem(second)}', None, first, second, homography)],
                     f'{os.path.basename(first)} and {os.path.basename(second)}, '
                     f'homography {os.path.basename(homography)}', options)


def synthetic(photograph: str | None, options: Options) -> Dataset:
    """A photograph under known changes; None takes one that is installed with OpenCV, or draws a picture."""
    path = photograph or warps.default_photograph()
    image = read_image(path, grey=True) if path else warps.generated_photograph(options.seed)
    if min(image.shape) < _SMALLEST_PHOTOGRAPH:
        raise SourceError(f'{path}: the photograph is {image.shape[1]}x{image.shape[0]} pixels; it must be at least '
                         f'{_SMALLEST_PHOTOGRAPH} to each side')
    name = _stem(path) if path else 'generated picture'

    def make_pairs(dataset: Dataset) -> Iterator[Pair]:
        first = warps.reference(image)
        for kind, amount in warps.all_changes():
            second, homography = warps.warped(image, kind, amount, options.seed)
            yield Pair(kind, f'{name}, {amount:g} {warps.KINDS[kind][0]}', amount, first, second, homography)

    height, width = (int(side / warps.SHRINK) for side in image.shape)
    return Dataset(f'{name}, warped', SYNTHETIC,
                   f'{os.path.basename(path or "a generated picture")} at {width}x{height} pixels under known '
                   'rotations, zooms, tilts, blur, noise, JPEG compression and light changes',
                   sum(1 for _ in warps.all_changes()), make_pairs,
                   {kind: unit for kind, (unit, _) in warps.KINDS.items()})


def examples(options: Options) -> list[Dataset]:
    """A real pair with ground truth, photographs and a video, all of OpenCV's own examples.

    Raises
    ------
    SourceError
        Where they are not installed.
    """
    names = ('graf1.png', 'graf3.png', 'H1to3p.xml', *_EXAMPLE_PHOTOGRAPHS, _EXAMPLE_VIDEO)
    paths = {name: warps.opencv_example(name) for name in names}
    missing = [name for name, path in paths.items() if path is None]
    if missing:
        raise SourceError(f'{", ".join(missing)}: not found in {warps.OPENCV_EXAMPLES[0]}; they come with the package '
                          'opencv-doc (sudo apt-get install opencv-doc)')
    found = {name: path for name, path in paths.items() if path is not None}
    few_frames = dataclasses.replace(options, maximum_frames=options.maximum_frames or _EXAMPLE_FRAMES)
    return [single_pair(found['graf1.png'], found['graf3.png'], found['H1to3p.xml'], options),
            *(synthetic(found[name], options) for name in _EXAMPLE_PHOTOGRAPHS),
            _video(found[_EXAMPLE_VIDEO], few_frames)]


_EXAMPLE_PHOTOGRAPHS = 'building.jpg', 'home.jpg', 'aloeL.jpg'
_EXAMPLE_VIDEO, _EXAMPLE_FRAMES = 'vtest.avi', 20


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


def _open_folder(folder: str, options: Options) -> list[Dataset]:
    names = [path.name for path in sorted(Path(folder).iterdir(), key=natural_order)]
    image_names = [name for name in names if is_image(Path(name)) and not name.startswith('.')]
    layout = _layout(names) if options.kind in ('auto', 'sequence') else None
    if layout is not None:
        return [_sequence_folder(folder, names, layout, options)]
    inner = [os.path.join(folder, name) for name in names if os.path.isdir(os.path.join(folder, name))]
    sequences = [path for path in inner if options.kind in ('auto', 'sequence') and _layout(os.listdir(path))]
    if sequences and not image_names:
        return [dataset for path in sequences for dataset in _open_folder(path, options)]
    if options.kind in ('auto', 'images') and image_names:
        return [_images(_base(folder), [os.path.join(folder, name) for name in image_names], options)]
    what = 'no sequence with ground truth' if options.kind == 'sequence' else 'no images'
    if options.kind in ('bag', 'video'):
        raise SourceError(f'{folder}: a folder, not a {options.kind}; {ACCEPTED}')
    raise SourceError(f'{folder}: there are {what} in this folder{" (it is empty)" if not names else ""}; {ACCEPTED}')


@dataclasses.dataclass(frozen=True)
class _Layout:
    image: str         # regular expressions with the number as group
    homography: str
    homography_name: str


_OXFORD = _Layout(r'img0*(\d+)\.\w+', r'H1to(\d+)p?(?:\.\w+)?', 'H1to{}p')
_HPATCHES = _Layout(r'0*(\d+)\.\w+', r'H_1_(\d+)(?:\.\w+)?', 'H_1_{}')


def _layout(names: Sequence[str]) -> _Layout | None:
    """The layout of a sequence's folder; None for any other folder."""
    image_names = [name for name in names if is_image(Path(name))]
    for layout in (_OXFORD, _HPATCHES):
        numbers = {int(match[1]) for match in (re.fullmatch(layout.image, name) for name in image_names) if match}
        if not numbers:
            continue
        if any(re.fullmatch(layout.homography, name) for name in names):
            return layout
        # No homography at all: still a sequence if it has just the images of one, and then one that lacks something.
        telling = layout is _OXFORD or all(name.lower().endswith('.ppm') for name in image_names)
        if telling and {1, 2} <= numbers <= set(range(1, 7)) and len(image_names) == len(numbers):
            return layout
    return None


def _sequence_folder(folder: str, names: Sequence[str], layout: _Layout, options: Options) -> Dataset:
    def numbered(pattern: str, wanted: Callable[[str], bool]) -> dict[int, str]:
        matches = [(re.fullmatch(pattern, name), name) for name in names if wanted(name)]
        return {int(match[1]): os.path.join(folder, name) for match, name in matches if match}

    image_paths = numbered(layout.image, lambda name: is_image(Path(name)))
    homography_paths = numbered(layout.homography, lambda name: not is_image(Path(name)))
    instead = 'give --kind images to take the folder as images without ground truth'
    for number in sorted({1, *image_paths, *homography_paths}):
        if number not in image_paths:
            raise SourceError(f'{os.path.join(folder, re.sub(r"[^a-z]", "", layout.image[:3]) + str(number))}.*: image '
                             f'{number} of the sequence is missing; {ACCEPTED}')
        if number > 1 and number not in homography_paths:
            raise SourceError(f'{os.path.join(folder, layout.homography_name.format(number))}: the homography from '
                             f'image 1 to image {number} is missing; {homographies.ACCEPTED}; {instead}')
    entries = [(f'1 to {number}', float(number), image_paths[1], image_paths[number], homography_paths[number])
               for number in sorted(image_paths) if number > 1]
    if not entries:
        raise SourceError(f'{folder}: the sequence has only image 1; {ACCEPTED}')
    return _sequence(_base(folder), entries, f'sequence of {len(entries) + 1} images with ground truth', options)


def _sequence(name: str, entries: Sequence[tuple[str, float | None, str, str, str]], description: str,
              options: Options) -> Dataset:
    # Read before anything is computed: a bad file shows at once and not after an hour.
    matrices = [homographies.read_homography(entry[4]) for entry in entries]

    def make_pairs(dataset: Dataset) -> Iterator[Pair]:
        first = read_image(entries[0][2], grey=True)
        for (pair_name, change, _, second_path, homography_path), matrix in zip(entries, matrices):
            second, note = read_image(second_path, grey=True), ''
            if options.crop_identity and homographies.moves_nothing(matrix, first.shape) \
                    and not np.array_equal(first, second):
                second, matrix, note = _cropped(second, matrix)
            pair = Pair(name, pair_name, change, first, second, homographies.oriented(matrix, first.shape), note)
            if not _overlap(pair):
                raise homographies.HomographyError(
                    f'{homography_path}: under this homography the two images share no region; '
                    f'{homographies.ACCEPTED}')
            yield pair

    return Dataset(name, SEQUENCE, description, len(entries), make_pairs, {name: 'number of the second image'})


def _cropped(image: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
    """Where nothing moves, any fixed grid of points would be found again; so the second image loses its rim."""
    x, y = min(warps.IDENTITY_CROP[0], image.shape[1] // 4), min(warps.IDENTITY_CROP[1], image.shape[0] // 4)
    return np.ascontiguousarray(image[y:, x:]), warps.shift(-x, -y) @ matrix, \
        f'the homography is the identity: the second image was cropped by {x} pixels on the left and {y} at the top'


def _overlap(pair: Pair) -> bool:
    assert pair.second is not None
    assert pair.homography is not None
    height, width = pair.first.shape
    x, y = np.meshgrid(np.linspace(0, width - 1, 40), np.linspace(0, height - 1, 40))
    projected = homographies.project(pair.homography, np.column_stack((x.ravel(), y.ravel())))
    within = (projected >= 0).all(axis=1) & (projected < pair.second.shape[::-1]).all(axis=1)
    return bool(within.any())


def _images(name: str, paths: Sequence[str], options: Options) -> Dataset:
    source = ImageFiles(paths)
    return _frames(name, f'{len(source)} image{"s" * (len(source) != 1)}', source, options)


def _video(path: str, options: Options) -> Dataset:
    try:
        source = Video(path)
    except SourceError as error:
        raise SourceError(f'{error}; {ACCEPTED}') from None
    return _frames(os.path.basename(path), f'video of {len(source) or "an unknown number of"} frames', source, options)


def _bag(path: str, options: Options) -> Dataset:
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
                yield Pair(name, previous[0], None, previous[1], image if fits else None, None)
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


def _stem(path: str) -> str:
    return os.path.splitext(os.path.basename(path))[0]


def _base(folder: str) -> str:
    return os.path.basename(os.path.abspath(folder))


_SMALLEST_PHOTOGRAPH = 96   # pixels
