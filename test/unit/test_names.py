"""What comments, docstrings and documents name exists: files, modules, functions, methods, tests."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / 'src' / 'rvc_features'
GENERATED = {'FeatureDetectorConfigConfig', 'CompressedPublisherConfig', 'KeyPoints'}
# Names of a user's own files in examples.
EXAMPLES = re.compile(r'^(my_|OUTPUT|FILE)|/my_')
ELSEWHERE = {'report.md', 'param_groups.py'}   # made by the tools; of rqt
SUFFIXES = {'py', 'md', 'csv', 'html', 'cfg', 'launch', 'json'}

FILES = sorted(path for pattern in ('*', '.github/**/*', 'cfg/*', 'launch/*', 'config/*', 'docs/**/*', 'scripts/*',
                                    'src/**/*', 'benchmarks/*', 'test/**/*', 'msg/*')
               for path in ROOT.glob(pattern)
               if path.is_file() and '__pycache__' not in path.parts
               and path.suffix in ('.py', '.md', '.rst', '.cfg', '.launch', '.test', '.txt', '.xml', '.yaml', '')
               and path.name != 'LICENSE')
EVERY_FILE = [str(path.relative_to(ROOT)) for path in ROOT.rglob('*') if path.is_file() and '.git' not in path.parts]


def text_of(path):
    """What a file says to people: all of a document, comments and docstrings of a program."""
    text = path.read_text(errors='replace')
    if path.suffix not in ('.py', '.cfg') and not text.startswith('#!/usr/bin/env python3'):
        return text
    said = [line[line.index('#'):] for line in text.splitlines() if '#' in line]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            said.append(ast.get_docstring(node) or '')
    return '\n'.join(said)


def definitions(path):
    """Names at the top of a module, and of each class in it the methods, fields and attributes."""
    names, classes = set(), {}
    for node in ast.parse(path.read_text()).body:
        for one in getattr(node, 'targets', [getattr(node, 'target', None)]):
            if isinstance(one, ast.Name):
                names.add(one.id)
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names |= {(alias.asname or alias.name).split('.')[0] for alias in node.names}
        if isinstance(node, ast.ClassDef):
            bases = {base.id for base in node.bases if isinstance(base, ast.Name)}
            members = {child.name for child in node.body if isinstance(child, ast.FunctionDef)}
            members |= {child.target.id for child in node.body if isinstance(child, ast.AnnAssign)}
            members |= {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)
                        and isinstance(part.value, ast.Name) and part.value.id == 'self'}
            classes[node.name] = (members, bases)
    return names, classes


MODULES, CLASSES = {}, {}
for _path in sorted([*PACKAGE.rglob('*.py'), *(ROOT / 'benchmarks').glob('*.py'), *(ROOT / 'test').rglob('*.py')]):
    if _path.parent.name == 'exercise_solutions':
        continue    # students', who call their classes like ours
    _names, _classes = definitions(_path)
    MODULES.setdefault(_path.stem if _path.stem != '__init__' else _path.parent.name, set()).update(_names)
    CLASSES.update(_classes)
FUNCTIONS = {node.name for path in (ROOT / 'test').rglob('*.py') for node in ast.walk(ast.parse(path.read_text()))
             if isinstance(node, ast.FunctionDef)}


def has_member(owner, member):
    """Whether a class or one of ours above it has that; of a class that is derived from another's, anything may be."""
    members, bases = CLASSES[owner]
    return member in members or any(base not in CLASSES or has_member(base, member) for base in bases - {'ABC'})


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_are_named_exist(path):
    missing = []
    named = r'(?<![\w/.*$}~<-])[\w./-]*\w\.(?:py|cfg|launch|msg|test|md)\b(?![\w(]| import )'
    for name in re.findall(named, text_of(path)):
        if EXAMPLES.search(name) or name in ELSEWHERE or name.startswith('/'):
            continue
        near = str((path.parent / name).resolve())
        if not (Path(near).exists() or any(f'/{file}'.endswith(f'/{name.lstrip("./")}') for file in EVERY_FILE)):
            missing.append(name)
    assert not missing


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_functions_that_are_named_exist(path):
    missing = []
    for name in re.findall(r'`(?:rvc_features\.)?([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)(?:\([^`]*\))?`', text_of(path)):
        owner, member = name.split('.')[-2:]
        if member in SUFFIXES:
            continue   # a file
        if owner in CLASSES:
            found = has_member(owner, member)
        elif owner in MODULES and len(MODULES[owner]) > 0:
            found = member in MODULES[owner] | GENERATED or member in MODULES
        else:
            continue   # of somebody else
        if not found:
            missing.append(name)
    assert not missing


@pytest.mark.parametrize('path', [path for path in FILES if path.suffix], ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_that_are_named_exist(path):
    named = set(re.findall(r'\btest_\w+', text_of(path))) - {'test_depend'}
    stems = {Path(file).stem for file in EVERY_FILE}
    assert not {name for name in named if name not in FUNCTIONS | stems and not name.endswith('_')}
