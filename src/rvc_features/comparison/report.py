"""The report's files: one HTML page that needs nothing else, the same numbers as Markdown and CSV, and a picture.

Nothing here depends on when or where it runs: the same results give the same files to the byte.
"""

from __future__ import annotations

import os
from typing import Sequence

import cv2
import numpy as np

from rvc_features.comparison import pictures
from rvc_features.comparison.contestants import Contestant
from rvc_features.comparison.csv_tables import pairs_csv, summary_csv
from rvc_features.comparison.datasets import Dataset, Pair
from rvc_features.comparison.page import page
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Measured, write_whole
from rvc_features.comparison.summary import Section
from rvc_features.comparison.text_tables import as_markdown

HTML, MARKDOWN, SUMMARY_CSV, PAIRS_CSV, PICTURE = \
    'report.html', 'report.md', 'summary.csv', 'pairs.csv', 'comparison.png'


class Gallery:
    """Keeps those of the pairs coming by that the report shows: the middle one of each of the first data sets."""

    MOST = 4

    def __init__(self) -> None:
        self.shown: dict[str, Pair] = {}
        self._seen: dict[str, int] = {}

    def look(self, dataset: Dataset, pair: Pair) -> None:
        number = self._seen[dataset.name] = self._seen.get(dataset.name, -1) + 1
        wanted = ((dataset.count or 1) - 1) // 2
        if (dataset.name in self.shown or len(self.shown) < self.MOST) and number <= wanted:
            self.shown[dataset.name] = pair


def write(folder: str, title: str, sections: Sequence[Section], measured: Sequence[Measured],
          datasets: Sequence[Dataset], contestants: Sequence[Contestant], settings: Settings,
          gallery: Gallery, command: str) -> list[str]:
    """Write all files of the report; their paths."""
    epsilon = min(settings.epsilons)
    shown = {name: pictures.of_pair(pair, contestants, settings.points, epsilon, _PICTURE_WIDTH)
             for name, pair in gallery.shown.items()}
    files: dict[str, str | bytes] = {
        HTML: page(title, sections, measured, datasets, contestants, settings, gallery.shown, shown, command),
        MARKDOWN: as_markdown(title, sections, datasets, contestants, settings, measured, command),
        SUMMARY_CSV: summary_csv(sections),
        PAIRS_CSV: pairs_csv(measured, settings)}
    if gallery.shown:
        best_known = max(gallery.shown.values(), key=lambda pair: pair.homography is not None)
        small = pictures.of_pair(best_known, contestants, settings.points, epsilon,
                                 _MOSAIC_WIDTH)
        files[PICTURE] = _png(pictures.with_legend(pictures.mosaic(small, 2 if len(small) <= 4 else 4), best_known,
                                                  epsilon))
    paths = []
    for name, content in files.items():
        paths.append(os.path.join(folder, name))
        write_whole(paths[-1], content)
    return paths


_PICTURE_WIDTH, _MOSAIC_WIDTH = 560, 240   # pixels


def _png(image: np.ndarray) -> bytes:
    # Fewer grey levels make the file half as large, which a picture in a README should be.
    _, data = cv2.imencode('.png', np.minimum(image // 16 * 17, 255).astype(np.uint8),
                           [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return data.tobytes()
