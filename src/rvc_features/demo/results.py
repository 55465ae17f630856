"""What the demo shows of its phases: a sheet of pictures and a table."""

from __future__ import annotations

import math

import cv2
import numpy as np

from rvc_features.demo.scenes import Phase
from rvc_features.drawing import draw_key_points


def contact_sheet(phases: list[Phase], columns: int = 3, width: int = 480) -> np.ndarray:
    """The same frame of a scene with the points of each setting, with captions, in rows; uint8 (H, W, 3)."""
    tiles = [_tile(phase, width) for phase in phases]
    rows = []
    for start in range(0, len(tiles), columns):
        row = tiles[start:start + columns]
        height = max(tile.shape[0] for tile in row)
        row += [np.zeros((1, width, 3), np.uint8)] * (columns - len(row))
        rows.append(np.hstack([cv2.copyMakeBorder(tile, 4, height - tile.shape[0] + 4, 4, 4, cv2.BORDER_CONSTANT)
                               for tile in row]))
    return np.vstack(rows)


def summary(phases: list[Phase]) -> str:
    """A table of what went in and came out."""
    lines = [f'{"scene":<12} {"setting":<22} {"frames in":>9} {"out":>5} {"points":>8} {"ms":>7}']
    for phase in phases:
        points = f'{np.median(phase.points):.0f}' if phase.points else '-'
        milliseconds = f'{np.median(phase.milliseconds):.1f}' if phase.milliseconds else '-'
        lines.append(f'{phase.scene.name:<12} {phase.setting:<22} {phase.frames_in:>9} {phase.frames_out:>5} '
                     f'{points:>8} {milliseconds:>7}')
    lines.append('points: median per frame; ms: from publishing an image to having the annotated one, as another node '
                 'sees it, median on the frame of the sheet')
    return '\n'.join(lines)


def lost(phases: list[Phase]) -> str:
    """A sentence about frames that were played and did not come out; empty when there are none."""
    played, went_in, came_out = (sum(numbers) for numbers in zip(*((phase.frames, phase.frames_in, phase.frames_out)
                                                                  for phase in phases)))
    if came_out >= played:
        return ''
    return (f'of {played} frames {went_in} were received and {came_out} came out of the node; the others were lost '
            '(the machine is too busy, or the node refused them: see launch.log)')


def _tile(phase: Phase, width: int) -> np.ndarray:
    frame = phase.scene.shown
    scale = min(width / frame.shape[1], 2 * width / frame.shape[0])
    size = max(round(frame.shape[1] * scale), 1), max(round(frame.shape[0] * scale), 1)
    picture = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
    points = phase.shown_points.copy()
    # Positions count from the centre of the first pixel, which is half a pixel from the edge.
    points['x'], points['y'] = (points['x'] + 0.5) * scale - 0.5, (points['y'] + 0.5) * scale - 0.5
    points['size'] = np.maximum(points['size'] * scale, _least_size(len(points), picture.shape))
    picture = draw_key_points(picture, points)
    picture = cv2.copyMakeBorder(picture, 0, 0, 0, width - size[0], cv2.BORDER_CONSTANT)   # narrow ones
    caption = np.full((30, width, 3), 40, np.uint8)
    cv2.putText(caption, f'{phase.setting}: {len(points)} points', (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6,
                (255, 255, 255), 1, cv2.LINE_AA)
    return np.vstack((caption, picture))


def _least_size(count: int, shape: tuple[int, ...]) -> float:
    """Diameter of a ring in pixels: the fewer there are the larger, as long as they don't cover each other."""
    return min(max(math.sqrt(shape[0] * shape[1] / max(count, 1)) / 3, 5.0), 16.0)
