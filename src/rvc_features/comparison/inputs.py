"""From what the user names to data sets: paths, a photograph, OpenCV's examples.

`open_inputs` tells from the paths what they are: sequences with ground truth, folders and lists of images, videos,
bags.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Iterator, Sequence

from rvc_features.comparison import frame_pairs, sequences, warps
from rvc_features.comparison.datasets import ACCEPTED, SYNTHETIC, Dataset, Options, Pair, with_distinct_names
from rvc_features.comparison.sequences import stem
from rvc_features.recordings.image_sources import SourceError, is_image, natural_order, read_image


def open_inputs(paths: Sequence[str], options: Options) -> list[Dataset]:
    """One data set for each path, and one for all image files among them together."""
    datasets, image_files = [], []
    for path in paths:
        if not os.path.exists(path):
            raise SourceError(f'{path}: no such file or folder; {ACCEPTED}')
        if os.path.isdir(path):
            datasets += _open_folder(path, options)
        elif options.kind == 'bag' or (options.kind == 'auto' and path.lower().endswith('.bag')):
            datasets.append(frame_pairs.of_bag(path, options))
        elif options.kind in ('auto', 'images') and is_image(Path(path)):
            image_files.append(path)
        elif options.kind in ('auto', 'video'):
            datasets.append(frame_pairs.of_video(path, options))
        else:
            raise SourceError(f'{path}: can not be taken as {options.kind}; {ACCEPTED}')
    if image_files:
        folders = sorted({os.path.basename(os.path.dirname(os.path.abspath(path))) for path in image_files})
        datasets.append(frame_pairs.of_images(' + '.join(folders), image_files, options))
    return with_distinct_names(datasets)


def synthetic(photograph: str | None, options: Options) -> Dataset:
    """A photograph under known changes; None takes one that is installed with OpenCV, or draws a picture."""
    path = photograph or warps.default_photograph()
    image = read_image(path, grey=True) if path else warps.generated_photograph(options.seed)
    if min(image.shape) < _SMALLEST_PHOTOGRAPH:
        raise SourceError(f'{path}: the photograph is {image.shape[1]}x{image.shape[0]} pixels; it must be at least '
                         f'{_SMALLEST_PHOTOGRAPH} to each side')
    name = stem(path) if path else 'generated picture'

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


_SMALLEST_PHOTOGRAPH = 96   # pixels


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
    return [sequences.single_pair(found['graf1.png'], found['graf3.png'], found['H1to3p.xml'], options),
            *(synthetic(found[name], options) for name in _EXAMPLE_PHOTOGRAPHS),
            frame_pairs.of_video(found[_EXAMPLE_VIDEO], few_frames)]


_EXAMPLE_PHOTOGRAPHS = 'building.jpg', 'home.jpg', 'aloeL.jpg'
_EXAMPLE_VIDEO, _EXAMPLE_FRAMES = 'vtest.avi', 20


def _open_folder(folder: str, options: Options) -> list[Dataset]:
    names = [path.name for path in sorted(Path(folder).iterdir(), key=natural_order)]
    image_names = [name for name in names if is_image(Path(name)) and not name.startswith('.')]
    layout = sequences.layout_of(names) if options.kind in ('auto', 'sequence') else None
    if layout is not None:
        return [sequences.sequence_folder(folder, names, layout, options)]
    inner = [os.path.join(folder, name) for name in names if os.path.isdir(os.path.join(folder, name))]
    inner_sequences = [path for path in inner
                       if options.kind in ('auto', 'sequence') and sequences.layout_of(os.listdir(path))]
    if inner_sequences and not image_names:
        return [dataset for path in inner_sequences for dataset in _open_folder(path, options)]
    if options.kind in ('auto', 'images') and image_names:
        return [frame_pairs.of_images(os.path.basename(os.path.abspath(folder)),
                                      [os.path.join(folder, name) for name in image_names], options)]
    what = 'no sequence with ground truth' if options.kind == 'sequence' else 'no images'
    if options.kind in ('bag', 'video'):
        raise SourceError(f'{folder}: a folder, not a {options.kind}; {ACCEPTED}')
    raise SourceError(f'{folder}: there are {what} in this folder{" (it is empty)" if not names else ""}; {ACCEPTED}')
