"""Stable order of numbers by their digits; reference: filters.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import kernel

_MOST_TO_COUNT = 11   # bits of a digit by which many keys are sorted; few have fewer, for each value has its counter


def strongest_first(values: np.ndarray, count: int | None = None) -> np.ndarray:
    """Indices from the largest value to the least, of equals the lower first; reference: `filters.reference_order`.

    `values` are float32, float64 or whatever becomes float64. With `count`, only so many of the largest.
    """
    values = np.asarray(values)
    if values.dtype != np.float32:
        values = values.astype(np.float64, copy=False)
    bits = (values + values.dtype.type(0)).view(f'u{values.itemsize}')   # -0.0 becomes 0.0
    return order_of_bits(bits, len(bits) if count is None else min(count, len(bits)))


@kernel
def order_of_bits(bits, count):
    """The same of the bits of floats, which are overwritten: those of a positive one rise with it, others fall."""
    size, top = len(bits), 8 * bits.itemsize - 1
    falls = 0
    for i in range(size):
        if not bits[i] >> bits.dtype.type(top):
            bits[i] = ~bits[i] & bits.dtype.type((1 << top) - 1)
        falls += i > 0 and bits[i] < bits[i - 1]
    if falls == 0:
        return np.arange(count)
    if size <= 2 * count:   # to sort them all is no more than to look for those
        return order_of_keys(bits)[:count]
    candidates = _among_the_least(bits, count)
    return candidates[order_of_keys(bits[candidates])[:count]]


@kernel
def _among_the_least(keys, count):
    """Indices of those keys, in their order, that can be among the `count` least; mostly not many more than that."""
    kind, width = keys.dtype.type, 8 * keys.itemsize
    counts = np.zeros(1 << _MOST_TO_COUNT, np.int64)
    prefix, fewer, rest = kind(0), 0, width   # so many keys have lower leading bits than `prefix`
    while rest > 0:
        digit = min(_MOST_TO_COUNT, rest)
        rest -= digit
        counts[:] = 0
        for key in keys:
            if rest + digit == width or key >> kind(rest + digit) == prefix:
                counts[np.int64((key >> kind(rest)) & kind((1 << digit) - 1))] += 1
        value = 0
        while fewer + counts[value] < count:
            fewer += counts[value]
            value += 1
        prefix = (prefix << kind(digit) if rest + digit < width else kind(0)) | kind(value)
        if fewer + counts[value] <= count + count // 4 + 64:
            break
    candidates, found = np.empty(fewer + counts[value], np.int64), 0
    for i in range(len(keys)):
        if keys[i] >> kind(rest) <= prefix:
            candidates[found] = i
            found += 1
    return candidates


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
    digit = 8 if size < 4000 else _MOST_TO_COUNT
    digits = (8 * keys.itemsize + digit - 1) // digit
    mask = kind((1 << digit) - 1)
    counts = np.zeros((digits, 1 << digit), np.int64)
    for i in range(size):
        key = keys[i]
        for place in range(digits):
            counts[place, np.int64((key >> kind(digit * place)) & mask)] += 1
    other_keys, other_order = np.empty(size, keys.dtype), np.empty(size, np.int64)
    is_first = True   # then the keys are the caller's
    for place in range(digits):
        shift = kind(digit * place)
        count = counts[place]
        if count[np.int64((keys[0] >> shift) & mask)] == size:
            continue
        start = 0
        for bucket in range(len(count)):
            start, count[bucket] = start + count[bucket], start
        for i in range(size):
            value = np.int64((keys[i] >> shift) & mask)
            other_keys[count[value]], other_order[count[value]] = keys[i], order[i]
            count[value] += 1
        keys, other_keys = other_keys, (np.empty(size, keys.dtype) if is_first else keys)
        order, other_order = other_order, order
        is_first = False
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
