"""The compiled kernels of the strength at two scales, and of its ranking, against their references."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import contrast
from rvc_features.kernels import compiler, resampling, warm_up
from rvc_features.kernels import contrast as compiled_contrast
from rvc_features.kernels import two_scales as compiled_two_scales
from rvc_features.two_scales import (
    COARSE,
    FINE,
    HALVING,
    binomial,
    reference_two_scales,
    strength_and_maximum,
    two_scale_strength,
    window_weights,
    without_tails,
)

pytestmark = pytest.mark.skipif(not compiler.available(), reason='Numba is not installed')

random = np.random.default_rng(0)
SHAPES = [(1, 1200), (2, 520), (3, 400), (40, 36), (61, 37), (41, 203), (64, 128)]


def images(shape):
    yield 'noise', random.integers(0, 256, shape, np.uint8)
    yield 'binary noise', random.integers(0, 2, shape, np.uint8) * np.uint8(255)
    yield 'texture', texture(shape)
    yield 'low contrast', random.integers(200, 206, shape, np.uint8)
    yield 'white', np.full(shape, 255, np.uint8)
    yield 'float', random.normal(100, 30, shape).astype(np.float32)
    yield 'float, far from zero', (1e4 + random.normal(0, 1, shape)).astype(np.float32)


def outwards(weights):
    return weights[len(weights) // 2:]


def taps(scale, window_size, window):
    return (outwards(window_weights(scale, window_size, window)),
            outwards(without_tails(binomial(scale.further)) * 2**scale.further),
            scale.saddle * (scale.smoothing + scale.further) / 4)


def assert_equal_strength(strength, expected):
    """Near zero the root magnifies errors; there, squares are compared."""
    largest = expected.max()
    assert np.abs(strength.astype(np.float64) ** 2 - expected ** 2).max() <= 1e-5 * largest ** 2
    above_zero = expected > 0.05 * largest
    assert np.abs(strength - expected)[above_zero].max(initial=0) <= 1e-5 * largest


@pytest.mark.parametrize('window', ['box', 'gaussian'])
@pytest.mark.parametrize('shape', SHAPES)
def test_strength_kernel_equals_reference(shape, window):
    for name, image in images(shape):
        for window_size in (3, 5, 9, 31) if shape == (41, 203) else (5, 9):
            expected = reference_two_scales(image, window_size, window)
            scales = [taps(scale, window_size, window) for scale in (FINE, COARSE)]
            weights = compiled_two_scales.Weights.of(outwards(binomial(HALVING) * 2**HALVING), *scales, image.dtype)
            strength, largest = compiled_two_scales.strength(image, weights)
            assert strength.shape == shape, name
            assert strength.dtype == np.float32
            assert_equal_strength(strength, expected)
            assert largest == strength.max()


@pytest.mark.parametrize('shape', [(1, 1200), (5, 300), (41, 203)])
def test_bands_of_rows_make_no_difference(monkeypatch, shape):
    threads = cv2.getNumThreads()
    for image in (texture(shape), texture(shape).astype(np.float32)):
        expected = strength_and_maximum(image)
        cv2.setNumThreads(3)
        try:
            with monkeypatch.context() as patch:
                patch.setattr(compiler, '_LEAST_BAND', 1)
                strength, largest = strength_and_maximum(image)
        finally:
            cv2.setNumThreads(threads)
        assert np.array_equal(strength, expected[0])
        assert largest == expected[1]


def test_strength_is_written_where_it_is_told():
    for shape in ((60, 80), (9, 9)):   # the second is too small for the kernel
        image, out = texture(shape), np.empty(shape, np.float32)
        _, largest = strength_and_maximum(image, 5, 'gaussian', out)
        assert np.array_equal(out, two_scale_strength(image))
        assert largest == out.max()


def test_too_narrow_for_the_kernel_is_an_error():
    ones = np.ones(2)
    weights = compiled_two_scales.Weights.of(ones, (ones, ones, 1.0), (ones, ones, 1.0), np.uint8)
    with pytest.raises(ValueError, match='at least 36 pixels wide; got 35'):
        compiled_two_scales.strength(np.zeros((100, 35), np.uint8), weights)


@pytest.mark.parametrize('shape', [(1, 1), (1, 9), (9, 1), (2, 2), (31, 35), (200, 5)])
def test_images_too_small_for_the_kernel(shape):
    for _, image in images(shape):
        strength = two_scale_strength(image)
        assert strength.shape == shape
        assert_equal_strength(strength, reference_two_scales(image, 5, 'gaussian'))


@pytest.mark.parametrize('shape', [(1, 66), (2, 70), (4, 64), (5, 90), (6, 65), (41, 203), (64, 128)])
def test_contrast_kernels_equal_references(shape):
    for _, image in images(shape):
        for side in (8, 6):
            sums = contrast.reference_energy_of_cells(image, side)
            assert np.allclose(compiled_contrast.energy_of_cells(image, side), sums, rtol=1e-12)
        for run in (16, 64):
            means = contrast.reference_noise_of_runs(image, run)
            assert np.allclose(compiled_contrast.noise_of_runs(image, run), means, rtol=1e-12, atol=1e-9)
        sums = contrast.reference_energy_of_cells(image, contrast.SIDE)
        averages = [compiled_contrast.averages(sums, *shape, contrast.SIDE, factor, contrast.WEIGHTS)
                    for factor in contrast.FACTORS]
        for average, expected in zip(averages, contrast.reference_averages(sums, shape)):
            assert np.allclose(average, expected, rtol=1e-5, atol=1e-12)
        x, y = random.uniform(-3, 130, (2, 50))
        values = image.astype(np.float32)
        between = contrast.reference_bilinear(values, x, y)
        assert np.allclose(compiled_contrast.bilinear(values, x, y), between, rtol=1e-12)


def test_too_narrow_for_the_energy_kernel_is_an_error():
    with pytest.raises(ValueError, match='at least 18 pixels wide; got 17'):
        compiled_contrast.energy_of_cells(np.zeros((9, 17), np.uint8), 8)


def test_warm_up_compiles_for_every_window():
    warm_up.compile_all()
    kernels = compiled_two_scales._response, resampling.halve
    known = [list(kernel.signatures) for kernel in kernels]
    for window_size, window in ((5, 'gaussian'), (9, 'gaussian'), (5, 'box'), (9, 'box')):
        strength_and_maximum(texture((60, 80)), window_size, window)
    assert [list(kernel.signatures) for kernel in kernels] == known
