"""What the demo shows of its phases: a sheet of pictures and a table."""

from __future__ import annotations

import cv2
import numpy as np

from rvc_features.demo.scenes import Phase


def contact_sheet(phases: list[Phase], columns: int = 3, width: int = 480) -> np.ndarray:
    """The last picture of each phase, with a caption, in rows."""
    tiles = [_captioned(phase, width) for phase in phases]
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
        lines.append(f'{phase.scene:<12} {phase.setting:<22} {phase.frames_in:>9} {phase.frames_out:>5} '
                     f'{points:>8} {milliseconds:>7}')
    lines.append('points: median per frame; ms: median from image to annotated image, as another node sees it')
    return '\n'.join(lines)


def _captioned(phase: Phase, width: int) -> np.ndarray:
    picture = np.zeros((width * 3 // 4, width, 3), np.uint8) if phase.picture is None else phase.picture
    picture = cv2.resize(picture, (width, picture.shape[0] * width // picture.shape[1]), interpolation=cv2.INTER_AREA)
    count = f'{phase.points[-1]} points' if phase.points else 'no image'
    caption = np.full((30, width, 3), 40, np.uint8)
    cv2.putText(caption, f'{phase.setting}: {count}', (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1,
                cv2.LINE_AA)
    return np.vstack((caption, picture))
