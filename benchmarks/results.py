"""Results that are kept, one JSON file per machine, and the tables of the documents made from them.

    python3 -m benchmarks --keep            # run, keep, and write the tables
    python3 -m benchmarks.results           # only write the tables
    python3 -m benchmarks.results --check   # say whether they are what is kept

A table stands between `<!-- results: NAME -->` and `<!-- end of results -->`; NAME is that of a benchmark, or
`summary`: the least and the largest ratio to each peer of each benchmark.
"""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from pathlib import Path
from typing import Any

from benchmarks.harness import Report

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'benchmarks' / 'results'
DOCUMENTS = (ROOT / 'README.md', ROOT / 'docs' / 'performance.md')

#: What each row of a benchmark holds, and of what type.
ROW = {'case': str, 'ours': str, 'peer': str, 'ratio': float, 'reach': (float, type(None)),
       'deviation': (float, type(None)), 'ours_ms': list, 'peer_ms': list}
SURROUNDINGS = {'processor': str, 'cores': int, 'load': float, 'system': str, 'versions': dict, 'heap': str,
                'opencv threads': int}

_TABLE = re.compile(r'(<!-- results: (\w+) -->\n).*?(<!-- end of results -->)', re.DOTALL)


def keep(reports: list[Report], found: dict[str, Any]) -> Path:
    """Keep the rows and notes of some benchmarks for this machine; those of others stay as they were."""
    name = re.sub('[^a-z0-9]+', '-', f'{found["processor"]} {found["cores"]} cores'.lower()).strip('-')
    path = FOLDER / f'{name}.json'
    kept = json.loads(path.read_text()) if path.is_file() else {'benchmarks': {}}
    for report in reports:
        entry = dataclasses.asdict(report)
        kept['benchmarks'][report.name] = {'surroundings': found, **{key: entry[key]
                                                                     for key in ('title', 'rows', 'notes')}}
    check(kept, path.name)
    FOLDER.mkdir(exist_ok=True)
    path.write_text(json.dumps(kept, indent=1, sort_keys=True) + '\n')
    return path


def check(kept: dict[str, Any], where: str) -> None:
    """ValueError where a file does not hold what it should."""
    def fits(entry: dict[str, Any], wanted: dict[str, Any], what: str) -> None:
        if set(entry) != set(wanted):
            raise ValueError(f'{where}: {what} has {sorted(entry)}; it should have {sorted(wanted)}')
        for key, kind in wanted.items():
            if not isinstance(entry[key], kind):
                raise ValueError(f'{where}: {key} of {what} is {entry[key]!r}')

    fits(kept, {'benchmarks': dict}, 'the file')
    for name, benchmark in kept['benchmarks'].items():
        fits(benchmark, {'surroundings': dict, 'title': str, 'rows': list, 'notes': list}, name)
        fits(benchmark['surroundings'], SURROUNDINGS, f'surroundings of {name}')
        for row in benchmark['rows']:
            fits(row, ROW, f'a row of {name}')
            if not (len(row['ours_ms']) == len(row['peer_ms']) == 3 and row['ratio'] > 0):
                raise ValueError(f'{where}: a row of {name} needs three quartiles each, and a positive ratio: {row}')


def tables() -> dict[str, str]:
    """Each document with the tables as they should be."""
    machines = {}
    for path in sorted(FOLDER.glob('*.json')):
        machines[path.stem] = json.loads(path.read_text())
        check(machines[path.stem], path.name)
    return {str(path): _TABLE.sub(lambda found: found[1] + _tables_of(found[2], machines) + found[3], path.read_text())
            for path in DOCUMENTS}


def write_tables() -> None:
    """Write the tables into the documents."""
    for path, text in tables().items():
        Path(path).write_text(text)


def _tables_of(name: str, machines: dict[str, Any]) -> str:
    parts = []
    for machine in machines.values():
        benchmarks = machine['benchmarks']
        found = benchmarks.get(name, next(iter(benchmarks.values())))['surroundings']
        if name == 'summary':
            parts.append(f'\n{found["processor"]}, {found["cores"]} cores:\n\n' + _summary(benchmarks))
        elif name in benchmarks:
            versions = ', '.join(f'{key} {value}' for key, value in sorted(found['versions'].items()))
            parts.append(f'\n{found["processor"]}, {found["cores"]} cores, load {found["load"]}; {versions}; '
                         f'{found["heap"]} heap.\n\n'
                         '| what | ours, ms | peer | ms | ratio | to reach | deviation |\n'
                         '|---|---:|---|---:|---:|---:|---:|\n' + ''.join(map(_line, benchmarks[name]['rows']))
                         + ''.join(f'\n{note}\n' for note in benchmarks[name]['notes']))
    return ''.join(parts) + '\n'


def _summary(benchmarks: dict[str, Any]) -> str:
    lines = ['| what | peer | least ratio | largest ratio | for | lost | largest deviation |\n'
             '|---|---|---:|---:|---|---:|---:|\n']
    for _, benchmark in sorted(benchmarks.items()):
        rows = benchmark['rows']
        for peer in sorted({row['peer'] for row in rows}):
            against = sorted((row for row in rows if row['peer'] == peer), key=lambda row: row['ratio'])
            off = max((row['deviation'] for row in against if row['deviation'] is not None), default=None)
            lost = sum(row['ratio'] > 1 for row in against)
            least, most = against[0], against[-1]
            lines.append(f'| {benchmark["title"]} | {peer} | {least["ratio"]:.2f} | {most["ratio"]:.2f} '
                         f'| {most["case"]} | {lost} of {len(against)} | {"" if off is None else f"{off:.0e}"} |\n')
    return ''.join(lines)


def _line(row: dict[str, Any]) -> str:
    reach = '' if row['reach'] is None else f'{row["reach"]:.2f}'
    off = '' if row['deviation'] is None else f'{row["deviation"]:.0e}'
    bold = '**' if row['reach'] is not None and row['ratio'] > row['reach'] else ''   # what misses its mark
    return (f'| {row["case"]} | {row["ours_ms"][1]:.2f} | {row["peer"]} | {row["peer_ms"][1]:.2f} '
            f'| {bold}{row["ratio"]:.2f}{bold} | {reach} | {off} |\n')


if __name__ == '__main__':
    if '--check' in sys.argv[1:]:
        different = [path for path, text in tables().items() if Path(path).read_text() != text]
        sys.exit(f'not what benchmarks/results holds: {", ".join(different)}' if different else 0)
    write_tables()
