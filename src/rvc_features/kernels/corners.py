"""Corners of the response with the box of 3x3, of uint8 images, without a map; reference: response.py and maxima.py.

Where only the strongest corners are wanted, most of an image need not have a response. With the steepest gradients in
x and in y round a pixel, s and t, A and C are at most s^2 and t^2, and H <= (1 - 4 k) A C: where s t says that it can't
exceed the weakest wanted corner, gradients and response are left out, fourteen pixels of four rows at a time. For s and
t gradients are rounded to whole grey values, which are bytes, 32 to a vector. Of the blocks that are left, most fall by
A C - B^2 over squares of 4x4 pixels, before there is any response.

How strong the weakest wanted corner is, is guessed from tiles spread over the image; where the guess was too high the
image is gone over again, with a bound that rises with what is found.
"""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.blocks import (
    COLUMNS,
    GRADIENTS,
    INSIDE,
    ROWS,
    START,
    note_promising,
    responses_of_blocks,
    steepest_gradients,
    steepest_of_first_pair,
)
from rvc_features.kernels.compiler import bands, in_bands, installed, kernel, read_only
from rvc_features.kernels.rows import reflect, row_length, zeros
from rvc_features.kernels.sorting import replace_least

if installed:
    from rvc_features.kernels.vectors import (
        LANES,
        load,
        lowest_bit,
        maximum,
        splat,
        store,
        where_greater,
        where_not_less,
    )

_SAMPLE = 50        # rows: as many pixels tell the bound
_TILE_ROWS = 10     # of one of the tiles that these are taken from: with one row more on either side three batches
_TILE_COLUMNS = 128
_GUESSES = 2         # before all corners are looked for

_UINT8, _INT16, _FLOAT32 = np.empty(0, np.uint8), np.empty(0, np.int16), np.empty(0, np.float32)
_NO_MASK = read_only(np.empty((0, 0), np.uint8))


def corners(image: np.ndarray, harris_k: float, minimum: float, border: int = 0, mask: np.ndarray | None = None,
            number: int | None = None, share: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local maxima of the response above `minimum`, all that can be among the strongest.

    Those of `response.reference_response`; reference: `maxima.reference_local_maxima`.

    Parameters
    ----------
    image : ndarray, uint8, shape (H, W)
        At least three pixels high and `compiler.LEAST_WIDTH` wide.
    harris_k : float
    minimum : float
        A corner's response must be greater.
    border : int
        Width in pixels of a rim without corners.
    mask : ndarray, uint8, shape (H, W), optional
        There are corners where it is not zero.
    number : int, optional
        Corners that are not among that many strongest may be left out.
    share : float
        Corners below this share of the strongest may be left out, where no number is given.

    Returns
    -------
    x, y : ndarray, int64, shape (N,)
        In reading order.
    response : ndarray, float32, shape (N,)
    """
    image, *rest = prepared(image, harris_k, minimum, border, mask, number, share)
    height, width = image.shape
    if bands(height, width) == 1:
        return corners_of_image(image, *rest)
    mask, k, border, least, most, of_least = rest

    def above(bound: np.float32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = in_bands(lambda *rows: _corners(image, mask, k, border, bound, most, of_least, *rows), height, width)
        return tuple(np.concatenate(parts) for parts in zip(*found))

    bound, guesses = np.float32(_first_bound(image, *rest)), 1
    found = above(bound)
    while len(found[0]) < most and bound > least:
        bound, guesses = np.float32(_next_bound(bound, len(found[0]), most, least, guesses)), guesses + 1
        found = above(bound)
    return found


def prepared(image: np.ndarray, harris_k: float, minimum: float, border: int, mask: np.ndarray | None,
             number: int | None, share: float) -> tuple:
    """What `corners` is called with, as `corners_of_image` takes it."""
    height, width = image.shape
    return (read_only(image), _NO_MASK if mask is None else read_only(mask), np.float32(harris_k), border,
            np.float32(minimum),
            # Of four pixels only one is a maximum.
            0 if number is None else min(number, ((height + 1) // 2) * ((width + 1) // 2)),
            np.float32(share if number is None else 1))


@kernel
def corners_of_image(image, mask, harris_k, border, least, number, share):
    """Those of the whole image in one thread; `number` is 0 where `share` tells which are wanted."""
    first, last = np.int64(0), image.shape[0]   # as types what bands have: a 0 would be compiled for apart
    bound, guesses = _first_bound(image, mask, harris_k, border, least, number, share), 1
    found = _corners(image, mask, harris_k, border, bound, number, share, first, last)
    while len(found[0]) < number and bound > least:
        bound, guesses = _next_bound(bound, len(found[0]), number, least, guesses), guesses + 1
        found = _corners(image, mask, harris_k, border, bound, number, share, first, last)
    return found


@kernel
def _first_bound(image, mask, harris_k, border, least, number, share):
    """What the weakest wanted corner most likely exceeds."""
    height = image.shape[0]
    if height <= 4 * _SAMPLE or share <= 0:
        return least
    # That of half as many more as there should be, for corners gather: most guesses are right then.
    among = 1 if number == 0 else 3 * number * _SAMPLE // (2 * height) + 12
    return _guess(image, mask, harris_k, border, least, among, share)


@kernel
def _next_bound(bound, found, number, least, guesses):
    """The same where so few corners exceed that bound."""
    return least if guesses == _GUESSES else max(least, np.float32(bound * (found / number) ** 4 / 4))


@kernel
def _corners(image, mask, harris_k, border, bound, number, share, first, last):
    """Those in some rows that exceed the bound, x, y and response.

    It rises to that of the strongest `number` of them or, where no number is given, to `share` of the strongest.
    """
    strongest = np.full(1 if number == 0 and share > 0 else 0, -np.inf, np.float32)
    width = image.shape[1]
    places, values = _scan(image, mask, harris_k, border, bound, number, strongest, share, first, last, 0, width,
                           _buffers(width))
    x, y = np.empty(len(places), np.int64), np.empty(len(places), np.int64)
    for i in range(len(places)):
        y[i] = places[i] // width
        x[i] = places[i] - y[i] * width
    return x, y, values


@kernel
def _guess(image, mask, harris_k, border, bound, among, share):
    """The response of number `among` of the strongest corners in tiles of the image, times `share`; at least `bound`.

    The tiles follow one another down the image and by the golden section across, which spreads them evenly. Every
    fourth comes first, and tells roughly what need not be looked at in the others.
    """
    height, width = image.shape
    buffers = _buffers(width)
    tiles = _SAMPLE * width // (_TILE_ROWS * _TILE_COLUMNS) + 1
    places = max(width - _TILE_COLUMNS, 0) // (2 * LANES) + 1
    for is_second in range(2):
        strongest = np.full(among - among // 4 if is_second else among // 4 + 4, -np.inf, np.float32)
        for tile in range(tiles):
            if (tile % 4 > 0) == is_second:
                first = (2 * tile + 1) * (height - _TILE_ROWS) // (2 * tiles)
                left = np.int64((tile * 0.6180339887498949) % 1.0 * places) * 2 * LANES
                _scan(image, mask, harris_k, border, bound, 0, strongest, share, first, first + _TILE_ROWS,
                      left, min(left + _TILE_COLUMNS, width), buffers)
                bound = max(bound, np.float32(1 if is_second else 0.25) * share * strongest[0])
    return bound


@kernel
def _buffers(width):
    length = row_length(width, START)
    responses = zeros(2 * ROWS * length, _FLOAT32)
    responses[:] = -np.inf
    # Eight rows of the image; steepest gradients in x and in y, in six rows and in the last two of them; gradients of
    # a few blocks; responses of eight rows; blocks of a batch, and those of them with corners in both halves of the
    # ring of responses.
    return (zeros((ROWS + 4) * length, _UINT8), zeros(4 * length, _UINT8),
            zeros((ROWS + 2) * 2 * GRADIENTS, _INT16), responses, np.empty((3, length // COLUMNS), np.int64))


@kernel
def _scan(image, mask, harris_k, border, bound, number, strongest, share, first, last, left, right, buffers):
    """Corners above the bound.

    It rises with those found: to the response of that `number` of them, if it is not zero, now and then; and to `share`
    of the least of the strongest, if any are noted.

    Columns are those from `left`, a multiple of 32, to `right`; what lies beyond them counts as if it had none.

    Four rows of responses are a batch. Two batches are kept: with each, the maxima are known from the row before its
    first to that before its last. Responses are -inf but in blocks where one exceeds the bound; buffers are left so.
    """
    height, width = image.shape
    pixels, steepest, gradients, responses, blocks = buffers
    length = row_length(width, START)
    lines, rows = np.empty(ROWS + 4, np.int64), np.empty(ROWS + 2, np.int64)
    candidates = np.zeros(2, np.int64)
    places, values, count = np.empty(1024, np.int64), np.empty(1024, np.float32), 0
    # The ends of a tile are no place for a maximum: what lies beyond them isn't known.
    columns = max(border, left + (left > 0)), min(width - border, right - (right < width))
    enough = number + number // 4   # corners at which the bound is looked at again
    half = 0
    begin = max(first - 1, 0)
    for row in range(begin, last + 1, ROWS):
        for i in range(ROWS + 4):   # rows of the image for six rows of gradients
            lines[i] = (row + i) % (ROWS + 4) * length + START
            if row == begin or i >= 4:
                _copy_row(image, reflect(row - 2 + i, height), left, right, pixels, lines[i])
        for i in range(ROWS + 2):   # of gradients; the border reflects
            at = row - 1 + i
            rows[i] = (2 if at < 0 else max(i - 2, 0) if at == height else i) * 2 * GRADIENTS
        if row == begin:
            steepest_of_first_pair(pixels, lines, left, right, steepest)
        steepest_gradients(pixels, lines, left, right, steepest)
        limit = np.sqrt(bound / (1 - 4 * harris_k + np.float32(1e-5))) / 16
        count_of_blocks = note_promising(steepest, left, right, np.uint16(min(limit, np.float32(65535))),
                                         blocks[0])
        _erase(responses, blocks[1 + half, :candidates[half]], half, length)
        candidates[half] = responses_of_blocks(pixels, lines, blocks[0, :count_of_blocks], width, gradients, rows,
                                                harris_k, bound, responses, half * ROWS * length, length,
                                                blocks[1 + half])
        for i in range(ROWS):   # nothing lies beyond the edges
            start = (half * ROWS + i) * length + START
            responses[start - 1] = responses[start + width] = -np.inf
            if row + i >= height:
                responses[start:start + width] = -np.inf

        for y in range(max(row - 1, first, border), min(row + ROWS - 1, last, height - border)):
            its_half = 1 - half if y < row else half
            while len(places) < count + LANES * candidates[its_half]:
                places, values = np.append(places, places), np.append(values, values)   # type: ignore[assignment]
            before = count
            count = _maxima_of_row(responses, (half * ROWS + y - row) % (2 * ROWS), length,
                                   blocks[1 + its_half, :candidates[its_half]], bound, mask, columns, width, y,
                                   places, values, count)
            if len(strongest) > 0:
                for i in range(before, count):
                    if values[i] > strongest[0]:
                        replace_least(strongest, values[i])
        if len(strongest) > 0:
            bound = max(bound, share * strongest[0])
        if number > 0 and count >= enough:
            bound = max(bound, np.partition(values[:count], count - number)[count - number])
            enough = count + number // 4 + 1
        half = 1 - half
    for half in range(2):
        _erase(responses, blocks[1 + half, :candidates[half]], half, length)
    return places[:count].copy(), values[:count].copy()


@kernel
def _copy_row(image, y, left, right, pixels, start):
    """The row from a vector before `left` to one after `right`, and its ends reflected."""
    width = image.shape[1]
    for x in range(max(left - LANES, 0), min(right + LANES, width), LANES):
        x = min(x, width - LANES)
        store(pixels, start + x, load(image, y * width + x))
    pixels[start - 1], pixels[start + width] = pixels[start + 1], pixels[start + width - 2]


@kernel
def _erase(responses, blocks, half, length):
    lowest = splat(np.float32(-np.inf))
    for x in blocks:
        for row in range(half * ROWS, (half + 1) * ROWS):
            store(responses, row * length + START + x, lowest)


@kernel
def _maxima_of_row(responses, row, length, blocks, bound, mask, columns, width, y, places, values, count):
    """Note the local maxima in the blocks of one row of the ring; returns how many there are then."""
    rows, least = 2 * ROWS, splat(bound)
    for first in blocks:
        start = START + first
        at, above, below = row * length + start, (row - 1) % rows * length + start, (row + 1) % rows * length + start
        value = load(responses, at)
        bits = where_greater(value, least) & INSIDE
        if bits == 0:
            continue
        before = maximum(maximum(load(responses, at - 1), load(responses, above - 1)),
                         maximum(load(responses, above), load(responses, above + 1)))
        after = maximum(maximum(load(responses, at + 1), load(responses, below - 1)),
                        maximum(load(responses, below), load(responses, below + 1)))
        bits &= where_greater(value, before) & where_not_less(value, after)
        while bits != 0:
            bit = lowest_bit(bits)
            bits &= bits - 1
            x = first + bit
            if columns[0] <= x < columns[1] and (mask.size == 0 or mask[y, x] != 0):
                places[count], values[count] = y * width + x, responses[at + bit]
                count += 1
    return count
