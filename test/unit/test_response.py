"""The response against a direct computation from its definition, in double precision and with loops over taps."""

import numpy as np
import pytest
from conftest import texture

from rvc_features.response import harris_response

WINDOWS = [3, 5, 7, 9, 15, 21, 31]
NAMES = ('gaussian', 'box')


def shifted_sum(values, weights_y, weights_x):
    """Correlation with a separable kernel, border reflected without its outermost pixel (dcb|abcd|cba)."""
    def along(values, weights):
        length, radius = values.shape[0], len(weights) // 2
        index = np.arange(-radius, length + radius)
        while length > 1 and ((index < 0) | (index >= length)).any():
            index = np.where(index < 0, -index, index)
            index = np.where(index >= length, 2 * length - 2 - index, index)
        padded = values[index if length > 1 else np.zeros_like(index)]
        return sum(weight * padded[i:i + length] for i, weight in enumerate(weights))
    return along(along(values, weights_y).T, weights_x).T


def direct_response(image, window_size, window, k=0.04):
    image = image.astype(np.float64)
    i_x = shifted_sum(image, [1, 2, 1], [-1, 0, 1])
    i_y = shifted_sum(image, [-1, 0, 1], [1, 2, 1])
    if window == 'box':
        weights = np.full(window_size, 1 / window_size)
    else:
        sigma = 0.3 * ((window_size - 1) * 0.5 - 1) + 0.8
        weights = np.exp(-(np.arange(window_size) - window_size // 2) ** 2 / (2 * sigma ** 2))
        weights /= weights.sum()
    a, b, c = (shifted_sum(product, weights, weights) for product in (i_x * i_x, i_x * i_y, i_y * i_y))
    return a * c - b * b - k * (a + c) ** 2


def checkerboard(shape, pitch=1):
    y, x = np.indices(shape)
    return ((x // pitch + y // pitch) % 2 * 255).astype(np.uint8)


IMAGES = {
    'texture': texture((61, 83)),
    'noise': np.random.default_rng(1).integers(0, 256, (50, 71), np.uint8),
    'binary noise': np.random.default_rng(2).integers(0, 2, (64, 48), np.uint8) * np.uint8(255),
    'pixel checkerboard': checkerboard((40, 41)),
    'checkerboard': checkerboard((48, 64), 8),
    'one edge': np.repeat(np.repeat([[0, 255]], 20, 1), 30, 0).astype(np.uint8),
    'diagonal edge': np.tril(np.full((45, 45), 255, np.uint8)),
}


@pytest.mark.parametrize('window', NAMES)
@pytest.mark.parametrize('window_size', WINDOWS)
@pytest.mark.parametrize('image', IMAGES.values(), ids=IMAGES)
def test_equals_direct_computation(image, window_size, window):
    expected = direct_response(image, window_size, window)
    response = harris_response(image, window_size, window)
    assert response.dtype == np.float32
    assert response.shape == image.shape
    assert np.abs(response - expected).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize('shape', [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5), (7, 4)])
@pytest.mark.parametrize('window', NAMES)
def test_images_smaller_than_the_window(shape, window):
    image = np.random.default_rng(3).integers(0, 256, shape, np.uint8)
    expected = direct_response(image, 9, window)
    assert np.allclose(harris_response(image, 9, window), expected, atol=1e-5 * max(1, np.abs(expected).max()))


@pytest.mark.parametrize('value', [0, 1, 255])
def test_flat_image_has_no_response(value):
    assert not harris_response(np.full((30, 40), value, np.uint8), 5).any()


def test_strided_image_equals_its_copy():
    image = texture((80, 90))
    assert np.array_equal(harris_response(image[::2, 10:50:3], 5), harris_response(image[::2, 10:50:3].copy(), 5))


def test_float_image_equals_the_same_grey_values():
    image = IMAGES['texture']
    expected = harris_response(image, 7)
    assert np.allclose(harris_response(image.astype(np.float32), 7), expected, atol=1e-5 * expected.max())


def test_input_is_not_changed():
    image = texture()
    before = image.copy()
    harris_response(image, 5, 'box')
    assert np.array_equal(image, before)


def test_corner_edge_and_flat_have_their_signs():
    image = np.zeros((60, 60), np.uint8)
    image[20:40, 20:40] = 255
    response = harris_response(image, 5)
    assert response[20, 20] > 0
    assert response[20, 30] < 0
    assert response[10, 10] == 0


def test_harris_k_lowers_the_response():
    image = texture()
    assert (harris_response(image, 5, harris_k=0.06) <= harris_response(image, 5, harris_k=0.04)).all()


def test_derivative_smoothing_equals_smoothing_the_image_first():
    import cv2
    image = texture(smoothing=0.5)
    smooth = cv2.GaussianBlur(image.astype(np.float64), (9, 9), 1.0, borderType=cv2.BORDER_REFLECT_101)
    expected = direct_response(smooth, 5, 'gaussian')
    response = harris_response(image, 5, derivative_sigma=1.0)
    assert np.abs(response - expected).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize(('arguments', 'error', 'text'), [
    (('not an image', 5), TypeError, 'image must be .*; got str'),
    ((np.zeros((9, 9), np.float64), 5), TypeError, 'uint8 or float32; got float64'),
    ((np.zeros((9, 9, 3), np.uint8), 5), ValueError, r'got shape \(9, 9, 3\)'),
    ((np.zeros((0, 9), np.uint8), 5), ValueError, r'got shape \(0, 9\)'),
    ((np.zeros((9, 9), np.uint8), 4), ValueError, 'window_size must be an odd integer of at least 3; got 4'),
    ((np.zeros((9, 9), np.uint8), 1), ValueError, 'window_size must be .*; got 1'),
    ((np.zeros((9, 9), np.uint8), 5.0), TypeError, 'window_size must be .*; got 5.0 .float'),
    ((np.zeros((9, 9), np.uint8), [5]), TypeError, r'window_size must be .*; got \[5\] .list'),
    ((np.zeros((9, 9), np.uint8), 5, 'round'), ValueError, "window must be one of 'gaussian', 'box'; got 'round'"),
    ((np.zeros((9, 9), np.uint8), 5, 'box', float('nan')), ValueError, 'harris_k must be a finite .*; got nan'),
    ((np.zeros((9, 9), np.uint8), 5, 'box', 0.04, -1.0), ValueError, 'derivative_sigma must be .*; got -1.0'),
])
def test_bad_arguments_are_named(arguments, error, text):
    with pytest.raises(error, match=text):
        harris_response(*arguments)


def test_what_was_right_once_is_not_right_in_another_type():
    image = np.zeros((9, 9), np.uint8)
    harris_response(image, 5, 'box', 0)
    for arguments in ((5.0, 'box', 0), (5, 'box', False)):
        with pytest.raises(TypeError, match='must be'):
            harris_response(image, *arguments)
