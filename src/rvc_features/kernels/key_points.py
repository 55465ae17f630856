"""Key points as rows of six numbers, as they lie in memory; reference: key_points.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import kernel, read_only
from rvc_features.kernels.sorting import order_of_bits

NUMBERS = 6   # of a key point: x, y, size, angle, response, and the bits of the octave


def of_corners(x: np.ndarray, y: np.ndarray, responses: np.ndarray, size: int, octave: int) -> np.ndarray:
    """Key points of an octave's corners, one after the other; reference: `key_points.reference_of_corners`."""
    x, y = (np.ascontiguousarray(values, np.int64) for values in (x, y))
    return numbers_of_corners(x, y, np.ascontiguousarray(responses, np.float32), size, octave)


@kernel
def numbers_of_corners(x, y, responses, size, octave):
    numbers = np.empty(NUMBERS * len(x), np.float32)
    octaves = numbers.view(np.int32)
    size = np.float32(size << octave)
    for i in range(len(x)):
        at = NUMBERS * i
        numbers[at], numbers[at + 1] = x[i] << octave, y[i] << octave
        numbers[at + 2], numbers[at + 3], numbers[at + 4] = size, -1, responses[i]
        octaves[at + 5] = octave
    return numbers


def strongest(key_points: np.ndarray, count: int) -> np.ndarray:
    """The strongest of key points, strongest first; reference: `key_points.reference_strongest`."""
    return strongest_numbers(read_only(key_points).view(np.float32), min(count, len(key_points))).view(key_points.dtype)


@kernel
def strongest_numbers(numbers, count):
    responses = np.empty(len(numbers) // NUMBERS, np.float32)
    for i in range(len(responses)):
        responses[i] = numbers[NUMBERS * i + 4] + np.float32(0)   # -0.0 becomes 0.0
    order = order_of_bits(responses.view(np.uint32), count)
    chosen = np.empty(NUMBERS * count, np.float32)
    for i in range(count):
        for j in range(NUMBERS):
            chosen[NUMBERS * i + j] = numbers[NUMBERS * order[i] + j]
    return chosen


def sound_and_strongest_first(key_points: np.ndarray, height: int, width: int) -> np.ndarray | None:
    """Key points, strongest first; reference: `key_points.reference_sound_and_strongest_first`."""
    is_sound, ordered = _sound_and_strongest_first(read_only(key_points).view(np.float32), height, width)
    return ordered.view(key_points.dtype) if is_sound else None


@kernel
def _sound_and_strongest_first(numbers, height, width):
    is_sound = _are_sound(numbers, height, width)
    return is_sound, strongest_numbers(numbers, len(numbers) // NUMBERS if is_sound else 0)


@kernel
def _are_sound(numbers, height, width):
    right, bottom, infinite = np.float32(width - 0.5), np.float32(height - 0.5), np.float32(np.inf)
    unsound = 0
    for at in range(0, len(numbers), NUMBERS):
        x, y, size = numbers[at], numbers[at + 1], numbers[at + 2]
        unsound += not ((-0.5 <= x <= right) & (-0.5 <= y <= bottom) & (0 <= size < infinite)
                        & (abs(numbers[at + 3]) < infinite) & (abs(numbers[at + 4]) < infinite))
    return unsound == 0
