"""Modules of other people: whatever they do when they are imported, the node goes on and says so."""

import sys
import textwrap
import threading

import pytest

from rvc_features.nodes.detector_modules import import_all

MODULES = {
    'good_module': 'found = True',
    'raising_module': 'raise RuntimeError("x" * 1000)',
    'leaving_module': 'import sys\nsys.exit(3)',
    'wrong_module': 'def (:',
    'hanging_module': 'import sys\nsys.modules["the_gate"].wait()',
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name, text in MODULES.items():
        (tmp_path / f'{name}.py').write_text(textwrap.dedent(text))
    monkeypatch.syspath_prepend(tmp_path)
    gate = threading.Event()
    monkeypatch.setitem(sys.modules, 'the_gate', gate)
    yield tmp_path
    gate.set()
    for name in MODULES:
        sys.modules.pop(name, None)


def test_the_good_ones_are_imported_and_each_bad_one_is_named(folder):
    begun = []
    problems = import_all([*MODULES, 'no_such_module'], begun.append, patience=0.5)
    assert sys.modules['good_module'].found
    assert begun == [*MODULES, 'no_such_module', '']
    texts = dict(zip((name for name in [*MODULES, 'no_such_module'] if name != 'good_module'), problems))
    assert len(texts) == len(problems) == 5
    assert all(f"'{name}'" in text and len(text) < 400 for name, text in texts.items())
    assert 'RuntimeError: xxx' in texts['raising_module']
    assert 'SystemExit: 3' in texts['leaving_module']
    assert 'SyntaxError' in texts['wrong_module']
    assert 'hangs while it is imported' in texts['hanging_module']
    assert 'No module named' in texts['no_such_module']


def test_a_single_name_will_do(folder):
    assert import_all('good_module') == []


@pytest.mark.parametrize('modules', [5, {'a': 1}, [1, 2], ['x' * 100_000, None]])
def test_something_else_is_refused_and_cut(modules):
    problem, = import_all(modules)
    assert 'must be a list of module names' in problem
    assert len(problem) < 300
