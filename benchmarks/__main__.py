"""Run benchmarks by name, or all: `python -m benchmarks [names] [--quick] [--output FOLDER]`."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from pathlib import Path

NAMES = ('response', 'detect', 'octaves', 'anms', 'scaling', 'node')
_ON_DEFAULT_HEAP = ('response', 'detect')   # run again there, quickly, for comparison


def main() -> int:
    parser = argparse.ArgumentParser(prog='benchmarks', description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', metavar='name', help=f'of {", ".join(NAMES)}; default: all')
    parser.add_argument('--quick', action='store_true', help='fewer sizes, windows and rounds')
    parser.add_argument('--output', type=Path, default=Path('bench_output'), help='folder for JSON and plots')
    parser.add_argument('--keep', action='store_true', help='keep the results for this machine in benchmarks/results/ '
                        'and write the tables of README.md and docs/performance.md anew')
    parser.add_argument('--heap', choices=('warm', 'default'), default='warm', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in NAMES]
    if unknown:
        parser.error(f'there is no benchmark {unknown[0]!r}; there are {", ".join(NAMES)}')
    names = [name for name in NAMES if name in (arguments.names or NAMES)]
    _in_the_right_surroundings(arguments.heap)

    import cv2

    from benchmarks import harness, images
    from rvc_features.kernels import compiler, warm_up
    cv2.setNumThreads(1)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    found = harness.surroundings()
    harness.print_surroundings(found)
    print(f'Pictures  {images.source()}')
    print(f'Kernels   {f"ready after {warm_up.compile_all():.1f} s" if compiler.available() else "none: no Numba"}')
    reports = []
    for name in names:
        report = importlib.import_module(f'benchmarks.{name}').run(arguments.quick)
        harness.print_report(report)
        reports.append(report)
    harness.write(reports, found, arguments.output)
    if arguments.keep and arguments.heap == 'warm':
        from benchmarks import results
        results.keep(reports, found)
        results.write_tables()

    again = [name for name in names if name in _ON_DEFAULT_HEAP]
    if arguments.heap == 'warm' and again:
        print('\nThe same on the default heap, quickly:\n', flush=True)
        subprocess.run([sys.executable, '-m', 'benchmarks', *again, '--quick', '--heap', 'default',
                        '--output', str(arguments.output / 'default_heap')], check=True)
    return 0


def _in_the_right_surroundings(heap: str) -> None:
    """Start anew where what glibc and the libraries read at their start is not as it must be."""
    from benchmarks.harness import WARM_HEAP
    wanted = {**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1',
              'RAYON_NUM_THREADS': '1', 'HL_NUM_THREADS': '1'}
    for name, value in WARM_HEAP.items():
        wanted.pop(name, None)
        if heap == 'warm':
            wanted[name] = value
    if wanted != dict(os.environ):
        os.execve(sys.executable, [sys.executable, '-m', 'benchmarks', *sys.argv[1:]], wanted)


if __name__ == '__main__':
    sys.exit(main())
