"""The images that the examiner shows: each made so that one mistake, and no other, shows in it.

They are black at the rim, so that no treatment of the border matters, and slightly blurred, so that no two pixels tie.
Most are of `drop`s: a right angle that runs out into a round back. H has its maximum at the angle and is negative all
along the back; without the trace it would be positive there.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Mapping, NamedTuple, Sequence

import cv2
import numpy as np

ELSEWHERE = 'elsewhere'
BETWEEN = 'between'     # where points are not counted
_TOLERANCE = 6.0      # pixels: solutions differ in the weights of the window, and their corners by two or three pixels
_OVERSAMPLING = 8


class Site(NamedTuple):
    """A place in the image where points may be, with all that is within `radius` of it."""

    x: float
    y: float
    radius: float = _TOLERANCE


@dataclass(frozen=True)
class Scene:
    """An image, uint8 grey or BGR, and its places by name; a point counts to the first it lies in."""

    name: str
    image: np.ndarray
    sites: Mapping[str, Site]
    mask: np.ndarray | None = None

    def sites_of(self, points: np.ndarray) -> list[str]:
        """The place of each point; several places may share what stands before the | of their names."""
        found = np.full(len(points), ELSEWHERE, object)
        for name, site in reversed(list(self.sites.items())):
            found[np.hypot(points['x'] - site.x, points['y'] - site.y) <= site.radius] = name.split('|')[0]
        return found.tolist()


def _drop(shape: tuple[int, int], x: float, y: float, pointing: float, radius: float) -> np.ndarray:
    """Share of each pixel that a drop covers: its right angle at (x, y) points to `pointing` (degrees, clockwise)."""
    turned = np.radians(pointing)
    centre = np.array([x - radius * np.sqrt(2) * np.cos(turned), y - radius * np.sqrt(2) * np.sin(turned)])
    back = turned + np.pi + np.radians(np.linspace(-135, 135, 60))
    outline = np.vstack((centre + radius * np.column_stack((np.cos(back), np.sin(back))), (x, y)))
    large = np.zeros((shape[0] * _OVERSAMPLING, shape[1] * _OVERSAMPLING), np.uint8)
    cv2.fillPoly(large, [np.rint(((outline + 0.5) * _OVERSAMPLING - 0.5) * 16).astype(np.int32)], (255,), cv2.LINE_8, 4)
    return cv2.resize(large.astype(np.float32) / 255, shape[::-1], interpolation=cv2.INTER_AREA)


def _finished(image: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(cv2.GaussianBlur(image, (0, 0), 1.0)), 0, 255).astype(np.uint8)


def _drops(shape: tuple[int, int], placed: Sequence[tuple[float, float, float, float]],
           radius: float = 9.0) -> np.ndarray:
    """Drops of (x, y, pointing, contrast) on black, not blurred yet."""
    return sum((contrast * _drop(shape, x, y, pointing, radius) for x, y, pointing, contrast in placed),
               np.zeros(shape, np.float32))


@functools.lru_cache(maxsize=None)
def corners() -> Scene:
    """Three drops in an image that is no square, and where they would be with x and y swapped."""
    placed = [(24, 66, 135, 200), (88, 20, 270, 200), (128, 40, 20, 200)]
    sites = {f'corner {number}': Site(x, y) for number, (x, y, _, _) in enumerate(placed, 1)}
    sites.update({f'corner {number} with x and y swapped': Site(y, x) for number, (x, y, _, _) in enumerate(placed, 1)})
    return Scene('corners', _finished(_drops((96, 144), placed)), sites)


@functools.lru_cache(maxsize=None)
def edges() -> Scene:
    """A drop beside edges without a corner: its own round back, and a disc so large that its outline is straight."""
    shape, radius, (x, y) = (88, 132), 28, (92, 44)
    rows, columns = np.indices(shape, dtype=np.float32)
    disc = 190 * np.clip(radius + 0.5 - np.hypot(columns - x, rows - y), 0, 1)
    parts = {}
    for number, turned in enumerate(np.radians(np.arange(0, 360, 45))):
        kind = ('the straight parts of the edge', 'the diagonal parts of the edge')[number % 2]
        parts[f'{kind}|{number}'] = Site(x + radius * np.cos(turned), y + radius * np.sin(turned), 11)
    return Scene('edges', _finished(_drops(shape, [(20, 24, 225, 200)]) + disc),
                 {'the corner': Site(20, 24), 'the round back of the drop': Site(29, 33, 14), **parts,
                  BETWEEN: Site(x, y, radius + 8)})


STRENGTHS = (240, 200, 160, 120, 92, 64)


@functools.lru_cache(maxsize=None)
def strengths(gain: float = 1.0) -> Scene:
    """Six drops alike but for their contrast: the responses are as its fourth power. Not placed in order."""
    places = [(60, 58), (14, 16), (100, 20), (58, 14), (14, 60), (102, 62)]
    placed = [(x, y, 225, contrast) for (x, y), contrast in zip(places, STRENGTHS)]
    return Scene('strengths' if gain == 1 else f'strengths at {gain:.0%} of the brightness',
                 np.rint(_finished(_drops((92, 136), placed)) * gain).astype(np.uint8),
                 {f'the drop of grey value {contrast}': Site(x, y) for x, y, _, contrast in placed})


# x, y and contrast: searched for so that each mistake about adaptive non-maximal suppression leaves other points than
# the next, and so that the radii of the six that stay are far above those of the others. The contrasts come in pairs
# whose responses are within a tenth, whatever the window and the gradient.
CROWD = ((22, 14, 198), (52, 20, 196), (78, 12, 174), (112, 18, 135), (142, 16, 219),
         (14, 46, 152), (48, 54, 112), (74, 50, 133), (108, 52, 100), (138, 48, 221),
         (18, 84, 172), (44, 80, 154), (82, 86, 90), (104, 88, 252), (134, 82, 254))
CROWD_POINTS = 6


@functools.lru_cache(maxsize=None)
def crowd() -> Scene:
    """Fifteen drops, the strong ones close together: adaptive non-maximal suppression leaves most of those out."""
    placed = [(x, y, 225, contrast) for x, y, contrast in CROWD]
    return Scene('crowd', _finished(_drops((122, 172), placed)),
                 {f'drop {number}': Site(x, y) for number, (x, y, _, _) in enumerate(placed, 1)})


@functools.lru_cache(maxsize=None)
def directions() -> Scene:
    """Drops that point to eight sides: the gradient at each points the other way, into the drop."""
    placed = []
    for number, pointing in enumerate(np.arange(22.5, 360, 45).tolist()):
        turned = np.radians(pointing)
        middle_x, middle_y = 22 + 34 * (number % 4), 22 + 36 * (number // 4)
        placed.append((round(middle_x + 10 * np.cos(turned)), round(middle_y + 10 * np.sin(turned)), pointing, 220))
    return Scene('directions', _finished(_drops((80, 146), placed, 8)),
                 {f'the drop whose gradient points to {(pointing + 180) % 360:g} degrees': Site(x, y)
                  for x, y, pointing, _ in placed})


@functools.lru_cache(maxsize=None)
def colours() -> Scene:
    """A grey drop, and a drop whose colour differs from the disc round it in everything but the grey value."""
    shape = (80, 128)
    grey_drop = _drop(shape, 20, 26, 225, 9)
    rows, columns = np.indices(shape, dtype=np.float32)
    disc = np.clip(30.5 - np.hypot(columns - 88, rows - 40), 0, 1)
    coloured = _drop(shape, 82, 34, 225, 9)
    channels = [_finished(150 * grey_drop + ground * disc + (drop - ground) * coloured)
                for ground, drop in ((20, 135), (20, 94), (200, 11))]   # B, G and R: of equal grey, and of equal mean
    return Scene('colours', np.dstack(channels), {
        'the grey drop': Site(20, 26), 'the drop that is seen in the colours only': Site(82, 34, 26)})


@functools.lru_cache(maxsize=None)
def large() -> Scene:
    """One large drop far from the origin, where no place of it has half its coordinates."""
    return Scene('large', _finished(_drops((136, 176), [(104, 76, 225, 220)], 22)),
                 {'the drop': Site(122, 94, 44), 'half the way to the drop': Site(61, 47, 26),
                  'a quarter of the way to the drop': Site(30, 23, 16)})


@functools.lru_cache(maxsize=None)
def texture() -> Scene:
    """A fine chessboard, which the next octave can't see, and two weaker drops, which it can."""
    shape = (112, 160)
    rows, columns = np.indices(shape, dtype=np.float32)
    board = np.where((rows // 2 + columns // 2) % 2 == 0, 1, -1)
    fading = np.exp(-(np.hypot(columns - 44, rows - 56) / 16) ** 2 / 2)
    grey = 100 * np.exp(-(np.hypot(columns - 48, rows - 56) / 17) ** 4 / 2)
    drops = _finished(_drops(shape, [(112, 24, 225, 60), (112, 76, 225, 60)], 12)).astype(np.float32)
    return Scene('texture', np.clip(np.rint(grey * (1 + 0.95 * board * fading) + drops), 0, 255).astype(np.uint8),
                 {'the chessboard': Site(46, 56, 44), 'the upper drop': Site(122, 34, 24),
                  'the lower drop': Site(122, 86, 24)})


@functools.lru_cache(maxsize=None)
def masked() -> Scene:
    """The drops of `corners`, and a mask that allows all but the one in the middle."""
    scene = corners()
    mask = np.full(scene.image.shape, 255, np.uint8)
    mask[:, 64:108] = 0
    return Scene('masked', scene.image, scene.sites, mask)


@functools.lru_cache(maxsize=None)
def faint(gain: int) -> Scene:
    """A drop of three grey values only, times `gain`."""
    levels = np.rint(_finished(_drops((48, 48), [(18, 18, 225, 200)])) / 100)
    return Scene(f'faint times {gain}', (levels * gain).astype(np.uint8), {'the corner': Site(18, 18)})


@functools.lru_cache(maxsize=None)
def sharp() -> Scene:
    """The strongest corners that there are: a white square on black, not blurred."""
    image = np.zeros((48, 48), np.uint8)
    image[14:34, 14:34] = 255
    return Scene('sharp', image, {'the square': Site(23.5, 23.5, 18)})
