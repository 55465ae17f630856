"""The four-colour image of the transport tests: blue | green over red | yellow, in any encoding."""

import cv2
import numpy as np

SHAPE = (64, 96)
COLOURS = ((255, 0, 0), (0, 255, 0), (0, 0, 255), (0, 255, 255))   # BGR: top left, top right, bottom left, bottom right
GREYS = (29, 150, 76, 226)                                          # what BGR2GRAY makes of them
ENCODINGS = ('mono8', 'bgr8', 'rgb8', 'bgra8', 'rgba8', 'bayer_rggb8', 'mono16')


def quadrants(encoding):
    """The image as an array of that encoding; made by hand and not by the code under test."""
    bgr = np.zeros((*SHAPE, 3), np.uint8)
    for part, colour in zip(_parts(bgr), COLOURS):
        part[:] = colour
    if encoding == 'mono8':
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    if encoding == 'mono16':
        return cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 256 + 77
    if encoding.startswith('bayer_'):
        mosaic = np.zeros(SHAPE, np.uint8)
        for letter, (y, x) in zip(encoding[6:10], ((0, 0), (0, 1), (1, 0), (1, 1))):
            mosaic[y::2, x::2] = bgr[y::2, x::2, 'bgr'.index(letter)]
        return mosaic
    alpha = np.full((*SHAPE, 1), 255, np.uint8)
    planes = {'b': bgr[..., 0:1], 'g': bgr[..., 1:2], 'r': bgr[..., 2:3], 'a': alpha}
    return np.concatenate([planes[letter] for letter in encoding.rstrip('8')], axis=2)


def corners(array):
    """The pixels three steps in from the four corners (a demosaiced rim is extrapolated)."""
    return np.array([array[3, 3], array[3, -4], array[-4, 3], array[-4, -4]]).astype(int)


def centres(array):
    """The mean of the 8x8 pixels in the middle of each quadrant."""
    middles = []
    for part in _parts(array):
        y, x = part.shape[0] // 2, part.shape[1] // 2
        middles.append(part[y - 4:y + 4, x - 4:x + 4].mean(axis=(0, 1)))
    return np.array(middles)


def _parts(array):
    y, x = array.shape[0] // 2, array.shape[1] // 2
    return array[:y, :x], array[:y, x:], array[y:, :x], array[y:, x:]
