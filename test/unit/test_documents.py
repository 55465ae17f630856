"""What the documents say is true: what is quoted is printed somewhere, and what is to be typed can be typed."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / 'src' / 'rvc_features'


def printed_texts():
    """Every text in the package's programs, with … for what is filled in."""
    for path in PACKAGE.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield re.sub(r'%[\w.]+', '…', node.value)
            elif isinstance(node, ast.JoinedStr):
                yield ''.join(part.value if isinstance(part, ast.Constant) else '…' for part in node.values)
    yield re.sub(r'\$\{[^}]*\}|\$\w+', '…', (ROOT / 'run').read_text())


def quoted_sentences():
    """What stands as code at the beginning of the first cell of a row of troubleshooting.md."""
    for line in (ROOT / 'docs' / 'troubleshooting.md').read_text().splitlines():
        found = re.match(r'\| (?:`` (.*?) ``|`([^`]*)`) \| ', line)
        if found:
            yield (found[1] or found[2]).strip(' ')


@pytest.fixture(scope='module')
def everything_printed():
    return '\n'.join(printed_texts())


@pytest.mark.parametrize('sentence', list(quoted_sentences()))
def test_what_troubleshooting_quotes_is_what_the_programs_print(sentence, everything_printed):
    missing = [part for part in sentence.split('…') if part.strip() and part.strip() not in everything_printed]
    assert not missing


def test_readme_lists_every_package_that_a_catkin_workspace_needs():
    entry = re.search(r'^apt_packages=\((.*?)^\)', (ROOT / 'run').read_text(), re.MULTILINE | re.DOTALL)[1].split()
    listed = re.search(r'sudo apt-get install (.*?)\n\n', (ROOT / 'README.md').read_text(), re.DOTALL)[1].split()
    assert set(entry) - {'python3-venv', 'opencv-doc'} <= set(listed)
    assert set(listed) - set(entry) - {'\\'} == {'python3-opencv', 'python3-numba', 'python3-tqdm', 'python3-yaml'}


def test_links_in_installed_documents_lead_to_what_is_installed():
    cmake = (ROOT / 'CMakeLists.txt').read_text()
    folders = re.search(r'foreach\(folder (.*?)\)', cmake)[1].split()
    files = re.search(r'install\(FILES (.*?) DESTINATION', cmake)[1].split()
    assert {'docs', 'README.md'} <= {*folders, *files}
    missing = []
    for path in [*(ROOT / 'docs').rglob('*.md'), *(ROOT / name for name in files if name.endswith('.md'))]:
        for link in re.findall(r'\]\(([^)#\s]+)', path.read_text()):
            if '://' in link:
                continue
            target = (path.parent / link).resolve().relative_to(ROOT)
            if not (ROOT / target).exists() or not {str(target), target.parts[0]} & {*folders, *files}:
                missing.append((path.name, link))
    assert missing == []


def test_the_reference_has_every_tool_message_and_configuration():
    tools, nodes = ((ROOT / 'docs' / 'reference' / f'{name}.md').read_text() for name in ('tools', 'nodes'))
    assert set(re.findall(r'^```\{help\} (\w+)$', tools, re.MULTILINE)) == {
        path.name for path in (ROOT / 'scripts').iterdir() if path.is_file()}
    assert set(re.findall(r'\{literalinclude\} \.\./\.\./((?:msg|srv)/\S+)', nodes)) == {
        str(path.relative_to(ROOT)) for folder in ('msg', 'srv') for path in (ROOT / folder).iterdir()}
    assert set(re.findall(r'^```\{dynamic\} (\w+)$', nodes, re.MULTILINE)) == {
        path.stem for path in (ROOT / 'cfg').glob('*.cfg')}


def test_the_reference_has_every_detector():
    from rvc_features import detectors
    nodes = (ROOT / 'docs' / 'reference' / 'nodes.md').read_text()
    own = {name for name in detectors.names() if detectors.get(name).__module__.startswith('rvc_features.')}
    assert set(re.findall(r'^```\{fields\} (\w+)$', nodes, re.MULTILINE)) == own
