"""Images made for the tests: shapes whose corners are known."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'src'))   # no build, no ROS needed


def pytest_configure(config):
    config.addinivalue_line('markers', 'slow: takes seconds; `./run check`, the inner loop, leaves it out')


def draw_square(size=64, low=20, high=39, value=200):
    """A bright square on black; its corners are the pixels (low, low) ... (high, high)."""
    image = np.zeros((size, size), np.uint8)
    image[low:high + 1, low:high + 1] = value
    return image


def draw_polygon(vertices, shape=(240, 320), oversampling=8):
    """An antialiased bright polygon on dark grey; vertices in pixels, (0, 0) the centre of the top left pixel."""
    height, width = shape
    large = np.full((height * oversampling, width * oversampling), 40, np.uint8)
    points = (np.asarray(vertices) + 0.5) * oversampling - 0.5
    cv2.fillPoly(large, [np.rint(points * 16).astype(np.int32)], 200, cv2.LINE_8, 4)
    return cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA)


def texture(shape=(120, 160), seed=0, smoothing=1.5):
    """Smooth random grey values: corners of all strengths everywhere."""
    noise = np.random.default_rng(seed).normal(size=shape)
    smooth = cv2.GaussianBlur(noise, (0, 0), smoothing)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def positions(points):
    """Positions of key points as an (N, 2) array."""
    return np.column_stack((points['x'], points['y']))


@pytest.fixture
def square():
    return draw_square()
