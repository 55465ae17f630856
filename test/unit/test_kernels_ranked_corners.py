"""Corners ranked in one pass are those of the steps one by one, and no bound leaves one out that passes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rvc_features import contrast, presets, ranked_corners
from rvc_features.kernels import compiler
from rvc_features.kernels import ranked_corners as compiled
from rvc_features.two_scales import LEAST_OF_ENERGY, strength_and_maximum

pytestmark = pytest.mark.skipif(not compiler.available(), reason='no Numba')


def texture(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Noise whose contrast grows from left to right and from top to bottom, so that energies differ much."""
    random = np.random.default_rng(seed)
    slope = np.add.outer(np.linspace(0, 1, shape[0]), np.linspace(0, 1, shape[1])) / 2
    return np.clip(128 + 90 * slope ** 2 * random.normal(0, 1, shape), 0, 255).astype(np.uint8)


def energies(image: np.ndarray) -> tuple[Any, ...]:
    averages = contrast.averages(image)
    return averages, contrast.SIDES, ranked_corners.lowest(*averages)


@pytest.mark.parametrize('shape', [(40, 48), (97, 203), (130, 331), (64, 640)])
@pytest.mark.parametrize('border', [0, 1, 4, 30])
def test_kernel_equals_the_reference(shape, border):
    image = texture(shape)
    strength, _ = strength_and_maximum(image)
    mask = np.zeros(shape, np.uint8)
    mask[5:-7, 11:-20] = 1
    for given in (None, mask):
        for minimum, least_of_energy in ((0.0, 0.0), (0.1, LEAST_OF_ENERGY)):
            arguments = strength, minimum, border, given
            x, y, rank = compiled.ranked_corners(*arguments, *energies(image), 0.35, least_of_energy, 0.0)
            expected = ranked_corners.reference_ranked_corners(image, *arguments, 0.35, least_of_energy)
            assert len(x) > 0 or minimum > 0 or border == 30
            assert np.array_equal(x, expected[0])
            assert np.array_equal(y, expected[1])
            assert np.allclose(rank, expected[2], rtol=1e-6)


def test_a_share_leaves_out_only_what_is_below_it():
    for seed in range(5):
        image = texture((200, 300), seed)
        arguments = strength_and_maximum(image)[0], 0.0, 4, None
        x, y, rank = compiled.ranked_corners(*arguments, *energies(image), 0.35, 0.0, 0.5)
        expected = ranked_corners.reference_ranked_corners(image, *arguments, 0.35, 0.0)
        best = expected[2].max()
        assert rank.max() == best
        passing = {(int(u), int(v)) for u, v, r in zip(*expected) if r > 0.5 * best}
        assert passing <= set(zip(x.tolist(), y.tolist()))
        assert len(x) < len(expected[0]) / 2


def test_no_energy_in_a_block_is_below_its_lowest():
    for shape in ((97, 203), (33, 64), (5, 36), (256, 65)):
        image = texture(shape)
        lowest = ranked_corners.lowest(*contrast.averages(image))
        y, x = (places.ravel() for places in np.indices(shape))
        energy = contrast.local_energy(image, x, y)
        for half_later in (0, 15):
            blocks = lowest[y // compiled.BLOCK, np.maximum(x - half_later, 0) // compiled.BLOCK]
            assert (energy >= blocks * (1 - 1e-6)).all()


def test_points_are_the_same_for_all_bounds():
    image = texture((240, 320))
    for options in ({}, {'threshold': 0.3}, {'border': 0}, {'strength': 'harris', 'evenness': 0.5}):
        passing = presets.create('repeatable', **options).detect_arrays(image)
        every = presets.create('repeatable', **{**options, 'threshold': 0.0}).detect_arrays(image)
        threshold = options.get('threshold', 0.05)
        assert np.array_equal(passing, every[every['response'].astype(float) > threshold * float(every['response'][0])])
