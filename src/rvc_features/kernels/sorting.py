"""Stable order of numbers by their digits; reference: filters.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import kernel

_DIGIT = 11   # bits


def strongest_first(values: np.ndarray) -> np.ndarray:
    """Indices from the largest value to the least, of equals the lower first; reference: `filters.reference_order`.

    `values` are float32, float64 or whatever becomes float64.
    """
    values = np.asarray(values)
    if values.dtype != np.float32:
        values = values.astype(np.float64, copy=False)
    bits = (values + values.dtype.type(0)).view(f'u{values.itemsize}')   # -0.0 becomes 0.0
    return _strongest_first(bits)


@kernel
def _strongest_first(bits):
    """The bits of a positive float rise with it, those of a negative one fall; they are overwritten."""
    top = 8 * bits.itemsize - 1
    for i in range(len(bits)):
        if not bits[i] >> bits.dtype.type(top):
            bits[i] = ~bits[i] & bits.dtype.type((1 << top) - 1)
    return order_of_keys(bits)


@kernel
def order_of_keys(keys):
    """Stable radix sort: indices that bring unsigned keys into rising order. An unchanging digit costs little."""
    size = len(keys)
    order = np.arange(size)
    if size < 64:
        for i in range(1, size):
            moved, at = order[i], i
            while at > 0 and keys[order[at - 1]] > keys[moved]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = moved
        return order
    kind = keys.dtype.type
    digits = 8 * keys.itemsize // _DIGIT + 1
    mask = kind((1 << _DIGIT) - 1)
    counts = np.zeros((digits, 1 << _DIGIT), np.int64)
    for i in range(size):
        key = keys[i]
        for digit in range(digits):
            counts[digit, np.int64((key >> kind(_DIGIT * digit)) & mask)] += 1
    other_keys, other_order = np.empty(size, keys.dtype), np.empty(size, np.int64)
    for digit in range(digits):
        shift = kind(_DIGIT * digit)
        count = counts[digit]
        if count[np.int64((keys[0] >> shift) & mask)] == size:
            continue
        start = 0
        for bucket in range(len(count)):
            start, count[bucket] = start + count[bucket], start
        for i in range(size):
            value = np.int64((keys[i] >> shift) & mask)
            other_keys[count[value]], other_order[count[value]] = keys[i], order[i]
            count[value] += 1
        keys, other_keys = other_keys, (keys if digit > 0 else np.empty(size, keys.dtype))
        order, other_order = other_order, order
    return order


@kernel
def replace_least(heap, value):
    """Put a greater value in the place of the least one, which is in front."""
    size = len(heap)
    at = 0
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and heap[child + 1] < heap[child]:
            child += 1
        if heap[child] >= value:
            break
        heap[at] = heap[child]
        at = child
    heap[at] = value
