"""Pairs with ground truth: sequences in the layout of Oxford/VGG or HPatches, and single pairs of images.

Oxford/VGG: img1.png, img2.png, H1to2p. HPatches: 1.ppm, 2.ppm, H_1_2.
"""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path
from typing import Callable, Iterator, Sequence

import numpy as np

from rvc_features.comparison import homographies, warps
from rvc_features.comparison.datasets import ACCEPTED, SEQUENCE, Dataset, Options, Pair
from rvc_features.recordings.image_sources import SourceError, is_image, read_image


@dataclasses.dataclass(frozen=True)
class Layout:
    image: str         # regular expressions with the number as group
    homography: str
    homography_name: str


_OXFORD = Layout(r'img0*(\d+)\.\w+', r'H1to(\d+)p?(?:\.\w+)?', 'H1to{}p')
_HPATCHES = Layout(r'0*(\d+)\.\w+', r'H_1_(\d+)(?:\.\w+)?', 'H_1_{}')


def layout_of(names: Sequence[str]) -> Layout | None:
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


def sequence_folder(folder: str, names: Sequence[str], layout: Layout, options: Options) -> Dataset:
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
    return _sequence(os.path.basename(os.path.abspath(folder)), entries,
                     f'sequence of {len(entries) + 1} images with ground truth', options)


def single_pair(first: str, second: str, homography: str, options: Options) -> Dataset:
    """One pair of image files and the file with their homography."""
    name = f'{stem(first)}, {stem(second)}'
    return _sequence(name, [(f'{stem(first)} to {stem(second)}', None, first, second, homography)],
                     f'{os.path.basename(first)} and {os.path.basename(second)}, '
                     f'homography {os.path.basename(homography)}', options)


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


def stem(path: str) -> str:
    return os.path.splitext(os.path.basename(path))[0]
