#!/usr/bin/env python3
"""Runs every test of the package and ends with one line: N passed, N failed, N skipped.

`./run test` calls it inside the package's environment; with names as arguments it runs only those steps or rostests,
such as: ./run test units reconfigure. With --quick, as `./run check` calls it, it runs the inner loop: style, types and
the units that aren't marked slow.
"""

import os
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).absolute().parents[1]   # not resolved: `run` calls it by a path without odd signs
ROSTESTS = sorted(path.stem for path in (ROOT / 'test').glob('*.test'))
TIME_LIMIT = 1500   # seconds for one step, also on a machine that is busy with other things


class Counts:
    """Tests so far."""

    def __init__(self):
        self.passed = self.failed = self.skipped = 0

    def add_report(self, report):
        """Count the cases of a JUnit report; no report is a failure."""
        if not report.is_file():
            self.failed += 1
            return
        for case in ElementTree.parse(report).iter('testcase'):
            outcomes = {child.tag for child in case}
            if outcomes & {'failure', 'error'}:
                self.failed += 1
            elif 'skipped' in outcomes:
                self.skipped += 1
            else:
                self.passed += 1


def run(command, **options):
    """Exit status of a command, which is ended with all that it started if it takes too long."""
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True, stdin=subprocess.DEVNULL, **options)
    try:
        return process.wait(TIME_LIMIT)
    except subprocess.TimeoutExpired:
        print(f'took longer than {TIME_LIMIT} s: {" ".join(command)}', flush=True)
        return 1
    finally:
        subprocess.run(['pkill', '-KILL', '-s', str(process.pid)], check=False)


def check(counts, command):
    """A step that passes or fails as a whole."""
    if run(command) == 0:
        counts.passed += 1
    else:
        counts.failed += 1


def units(counts, folder, *chosen):
    """Unit tests and doctests of the detector half: no ROS master is needed."""
    pytest(counts, folder / 'units.xml', *chosen, 'test/unit')


def pytest(counts, report, *chosen):
    """Tests without a ROS master, on all cores."""
    before = counts.failed
    status = run([*COVERAGE, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-n', 'auto', f'--junitxml={report}',
                  *chosen])
    counts.add_report(report)
    if status != 0 and counts.failed == before:
        counts.failed += 1


def rostest(counts, folder, name):
    """One rostest, under a master of its own."""
    before = counts.failed
    status = run(['rostest', '--results-base-dir', str(folder / name), f'test/{name}.test'],
                 env={**os.environ, 'ROS_HOME': str(folder / name)})
    reports = [path for path in (folder / name).rglob('*.xml')
               if path.name.startswith(('rosunit-', 'rostest-'))]
    for report in reports:
        counts.add_report(report)
    if not reports or (status != 0 and counts.failed == before):
        counts.failed += 1


def launch_files(counts, folder):
    """Every launch file: syntax, arguments, and that all it names exists."""
    for launch in sorted((ROOT / 'launch').glob('*.launch')):
        check(counts, ['rosrun', 'roslaunch', 'roslaunch-check', '-o', str(folder / f'{launch.stem}.xml'), str(launch)])


def documents(counts, folder):
    """The documents as a site, with warnings as errors; and what they tell people to type."""
    check(counts, ['python3', '-m', 'sphinx', '-q', '-W', '--keep-going', '-n', '-j', 'auto', '-c', 'docs',
                   '-d', str(folder / 'trees'), '.', str(folder / 'site')])
    pytest(counts, folder / 'documents.xml', 'test/documents')


def main(names):
    quick = names == ['--quick']
    if quick:
        names = ['style', 'types', 'units']
    counts = Counts()
    steps = {'style': lambda folder: check(counts, ['ruff', 'check', '--no-cache', '.']),
             'types': lambda folder: check(counts, ['python3', '-m', 'mypy']),
             'catkin_lint': lambda folder: check(counts, ['catkin_lint', '-W2', '--strict',
                                                          '--ignore', 'package_path_name', str(ROOT)]),
             'launch_files': lambda folder: launch_files(counts, folder),
             'docs': lambda folder: documents(counts, folder),
             'units': lambda folder: units(counts, folder, *(['-m', 'not slow'] if quick else []))}
    steps.update({name: lambda folder, name=name: rostest(counts, folder, name) for name in ROSTESTS})
    steps['soak'] = lambda folder: check(counts, ['python3', 'test/soak.py', '--minutes', '0.3'])
    unknown = set(names) - set(steps)
    if unknown:
        sys.exit(f'unknown: {", ".join(sorted(unknown))}; there are {", ".join(steps)}')
    with tempfile.TemporaryDirectory() as folder:
        for name, step in steps.items():
            if names and name not in names:
                continue
            print(f'\n==> {name}', flush=True)
            start, before = time.monotonic(), counts.failed
            step(Path(folder))
            print(f'==> {name}: {"failed" if counts.failed > before else "passed"}, '
                  f'{time.monotonic() - start:.0f} s', flush=True)
    print(f'\n{counts.passed} passed, {counts.failed} failed, {counts.skipped} skipped')
    return 1 if counts.failed or not counts.passed else 0


COVERAGE = [sys.executable]

if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
