"""What is kept of the benchmarks, and the tables of the documents made from it."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks import results
from benchmarks.harness import Report

KEPT = sorted(results.FOLDER.glob('*.json'))
FOUND = {'processor': 'Some (R) Processor', 'cores': 2, 'load': 0.5, 'system': 'Linux', 'versions': {'numpy': '1.26'},
         'heap': 'warm', 'opencv threads': 1}


def report():
    result = Report('response', 'Title', notes=['A note.'])
    result.compare('VGA box 3', {'box': [1e-3] * 3, 'other': [2e-3] * 3}, 'box', 'other', 0.6, 1e-7)
    result.compare('VGA box 5', {'box': [3e-3] * 3, 'other': [2e-3] * 3}, 'box', 'other')
    return result


def test_results_are_kept():
    assert KEPT


@pytest.mark.parametrize('path', KEPT, ids=lambda path: path.stem)
def test_each_file_follows_the_schema(path):
    results.check(json.loads(path.read_text()), path.name)


def test_the_tables_are_those_of_the_results():
    """`python3 -m benchmarks.results` writes them anew."""
    for path, text in results.tables().items():
        assert Path(path).read_text() == text
        assert text.count('<!-- results: ') == text.count('<!-- end of results -->') > 0


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setattr(results, 'FOLDER', tmp_path / 'results')
    document = tmp_path / 'document.md'
    table = '<!-- results: {} -->\nold\n<!-- end of results -->\n'
    document.write_text('before\n' + table.format('summary') + table.format('response') + 'after\n')
    monkeypatch.setattr(results, 'DOCUMENTS', (document,))
    return tmp_path


def test_a_run_is_kept_and_its_losses_are_told(place):
    path = results.keep([report()], FOUND)
    assert path.name == 'some-r-processor-2-cores.json'
    results.write_tables()
    text = (place / 'document.md').read_text()
    assert '| Title | other | 0.50 | 1.50 | VGA box 5 | 1 of 2 | 1e-07 |' in text
    assert '| VGA box 3 | 1.00 | other | 2.00 | 0.50 | 0.60 | 1e-07 |' in text
    assert '| VGA box 5 | 3.00 | other | 2.00 | 1.50 |  |  |' in text
    assert 'old' not in text
    assert text.startswith('before\n')
    assert text.endswith('after\n')


def test_another_run_leaves_the_other_benchmarks(place):
    results.keep([report()], FOUND)
    other = report()
    other.name = 'detect'
    kept = json.loads(results.keep([other], {**FOUND, 'load': 9.0}).read_text())['benchmarks']
    assert {name: benchmark['surroundings']['load'] for name, benchmark in kept.items()} == {'response': 0.5,
                                                                                             'detect': 9.0}


def first_row(kept):
    return kept['benchmarks']['response']['rows'][0]


@pytest.mark.parametrize(('spoil', 'text'), [
    (lambda kept: kept.update(more=1), 'the file has'),
    (lambda kept: first_row(kept).update(ratio='fast'), "ratio of a row of response is 'fast'"),
    (lambda kept: first_row(kept).update(ours_ms=[1.0]), 'three quartiles'),
    (lambda kept: kept['benchmarks']['response']['surroundings'].update(cores='two'), 'cores of surroundings'),
])
def test_what_does_not_follow_the_schema_is_an_error(place, spoil, text):
    kept = json.loads(results.keep([report()], FOUND).read_text())
    spoil(kept)
    with pytest.raises(ValueError, match=text):
        results.check(kept, 'a file')
