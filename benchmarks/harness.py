"""How all benchmarks measure and report.

The contract: what is compared runs in turn in one process, so that a busy machine slows all alike; reported are the
median and the quartiles, and as the result the ratio of the medians. One thread, on one core. The clock is the
process's processor time: on an idle machine that of the wall, and on a busy one without the turns of others. Of the
whole process, for some peers work in a thread of their own.
Compilation is over before it starts.

Two states of the C heap matter. By default glibc hands large blocks back after every call, and the page faults on the
next ones cost more than much of the arithmetic, and vary. With its two thresholds raised (`WARM_HEAP`) the memory stays
and every contestant, OpenCV too, is at its best: that is what ratios are compared on.
"""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import time
from importlib import metadata
from pathlib import Path
from typing import Any, Callable

import cv2
import numpy as np

WARM_HEAP = {'MALLOC_MMAP_THRESHOLD_': '1073741824', 'MALLOC_TRIM_THRESHOLD_': '4294967296'}

SIZES = {'VGA': (640, 480), '720p': (1280, 720), '1080p': (1920, 1080), '4K': (3840, 2160)}


@dataclasses.dataclass
class Report:
    """Rows of a table, curves of a plot, and sentences to say beneath."""

    name: str
    title: str
    peer_title: str = 'peer'
    x_label: str = ''
    rows: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    curves: dict[str, list[tuple[float, float]]] = dataclasses.field(default_factory=dict)   # milliseconds over x
    notes: list[str] = dataclasses.field(default_factory=list)

    def compare(self, case: str, times: dict[str, list[float]], ours: str, peer: str,
                reach: float | None = None, deviation: float | None = None) -> float:
        """Add a row: `ours` against `peer`, both names in `times`; returns the ratio of the medians.

        `deviation` is the largest one of ours from the reference, as a share of the reference's largest value.
        """
        ratio = float(np.median(times[ours]) / np.median(times[peer]))
        self.rows.append({'case': case, 'ours': ours, 'peer': peer, 'ratio': ratio, 'reach': reach,
                          'deviation': deviation, 'ours_ms': quartiles(times[ours]),
                          'peer_ms': quartiles(times[peer])})
        return ratio

    def point(self, curve: str, x: float, times: list[float]) -> None:
        self.curves.setdefault(curve, []).append((x, float(np.median(times)) * 1e3))

    def growth(self, curve: str, low: float = 0, high: float = np.inf) -> float:
        """Exponent of the cost over x between its first and last point from `low` to `high`."""
        points = [point for point in self.curves[curve] if low <= point[0] <= high]
        (x0, y0), (x1, y1) = points[0], points[-1]
        return float(np.log(y1 / y0) / np.log(x1 / x0))


def in_turn(contestants: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each call: all contestants once unmeasured, then in turn, `rounds` times."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for contestant in contestants.values():
        contestant()
    for _ in range(rounds):
        for name, contestant in contestants.items():
            start = time.process_time()
            contestant()
            times[name].append(time.process_time() - start)
    return times


def deviation(values: np.ndarray, reference: np.ndarray) -> float:
    """Largest deviation from the reference as a share of the reference's largest magnitude."""
    return float(np.abs(values - reference).max() / np.abs(reference).max())


def quartiles(seconds: list[float]) -> list[float]:
    """First quartile, median and third quartile in milliseconds."""
    return [float(value) for value in np.percentile(seconds, [25, 50, 75]) * 1e3]


def surroundings() -> dict[str, Any]:
    """The machine, the versions and the state of the heap."""
    versions = {'python': platform.python_version(), 'numpy': np.__version__, 'opencv': cv2.__version__}
    for name in ('numba', 'scikit-image', 'halide', 'kornia_rs', 'adaptive-nms'):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = 'not installed'
    warm = all(os.environ.get(name) == value for name, value in WARM_HEAP.items())
    return {'processor': _processor(), 'cores': os.cpu_count(), 'load': round(os.getloadavg()[0], 2),
            'system': platform.platform(), 'versions': versions, 'heap': 'warm' if warm else 'default',
            'opencv threads': cv2.getNumThreads()}


def print_surroundings(found: dict[str, Any]) -> None:
    print(f'Machine   {found["processor"]}, {found["cores"]} cores, load {found["load"]} at the start; one is used')
    print(f'System    {found["system"]}')
    print('Versions  ' + ', '.join(f'{name} {version}' for name, version in found['versions'].items()))
    print(f'Heap      {found["heap"]}; OpenCV with {found["opencv threads"]} thread')


def print_report(report: Report) -> None:
    print(f'\n{report.title}\n')
    if report.rows:
        wide = max(len(row['case']) for row in report.rows)
        peer_wide = max(len(row['peer']) for row in report.rows)
        print(f'{"":{wide}}  {"ours, ms (quartiles)":>26}  {report.peer_title + ", ms (quartiles)":>{28 + peer_wide}}'
              f'  {"ratio":>6}  {"reach":>6}  {"deviation":>9}')
        for row in report.rows:
            reach = '' if row['reach'] is None else f'{row["reach"]:.2f}'
            off = '' if row['deviation'] is None else f'{row["deviation"]:.0e}'
            missed = '  missed' if row['reach'] is not None and row['ratio'] > row['reach'] else ''
            print(f'{row["case"]:{wide}}  {_times(row["ours_ms"]):>26}  {row["peer"]:>{peer_wide}} '
                  f'{_times(row["peer_ms"]):>27}  {row["ratio"]:6.3f}  {reach:>6}  {off:>9}{missed}')
    for note in report.notes:
        print(note)


def write(reports: list[Report], found: dict[str, Any], folder: Path) -> None:
    """One JSON file for all, and a plot for each benchmark with curves."""
    folder.mkdir(parents=True, exist_ok=True)
    data = {'surroundings': found, 'benchmarks': [dataclasses.asdict(report) for report in reports]}
    path = folder / 'benchmarks.json'
    path.write_text(json.dumps(data, indent=1) + '\n')
    print(f'\nWritten: {path}', end='')
    try:
        import matplotlib  # a development dependency: the numbers do without
        matplotlib.use('Agg')
        import matplotlib.pyplot as plt
    except ImportError:
        print('\nNo plots: matplotlib is not installed (pip install matplotlib).')
        return
    for report in reports:
        if report.curves:
            figure, axes = plt.subplots(figsize=(7, 5))
            for name, points in report.curves.items():
                axes.plot(*zip(*points), marker='o', markersize=3, label=name)
            axes.set(xlabel=report.x_label, ylabel='milliseconds', title=report.title, xscale='log', yscale='log')
            axes.grid(True, which='both', alpha=0.3)
            axes.legend(fontsize='small')
            path = folder / f'{report.name}.png'
            figure.tight_layout()
            figure.savefig(path, dpi=120)
            plt.close(figure)
            print(f', {path}', end='')
    print()


def _times(milliseconds: list[float]) -> str:
    first, median, third = milliseconds
    digits = 2 if median < 100 else 0
    return f'{median:.{digits}f} ({first:.{digits}f} to {third:.{digits}f})'


def _processor() -> str:
    try:
        for line in Path('/proc/cpuinfo').read_text().splitlines():
            if line.startswith('model name'):
                return line.split(':', 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
