"""Directives for the reference, which is made of the package's own definitions while the documents are built.

    node MODULE            the docstring of a node's module, which is its interface
    help SCRIPT            what a tool answers to --help
    fields DETECTOR        parameters of a detector: default, what is accepted, meaning
    dynamic CONFIG         those of a dynamic_reconfigure server, as its .cfg file has them
    presets                what each preset is for, what it costs, and what it sets
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import os
import runpy
import signal
import sys
from pathlib import Path
from typing import Any, Iterator, Sequence
from unittest import mock

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

from rvc_features import detectors, parameters, presets

_ROOT = Path(__file__).resolve().parents[2]
_WIDTH = '100'     # letters in a line of --help


class _Generated(SphinxDirective):
    """What a directive says as lines of reStructuredText, or of Markdown in a table."""

    required_arguments = 1

    def literal(self, text: str) -> list[nodes.Node]:
        """Text as it is."""
        return [nodes.literal_block(text, text, language='text')]

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[nodes.Node]:
        """A table; cells are Markdown."""
        lines = [_row(head), _row(['---'] * len(head)), *map(_row, rows)]
        box = nodes.container()
        self.state.nested_parse(StringList(lines, self.get_source_info()[0]), self.content_offset, box)
        return box.children

    def depend_on(self, *paths: str) -> None:
        """The page is made anew where one of these files of the repository has changed."""
        for path in paths:
            self.env.note_dependency(os.path.relpath(_ROOT / path, self.env.srcdir))


class _Node(_Generated):
    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        module = importlib.import_module(self.arguments[0])
        self.depend_on(str(module.__file__))
        return self.literal(inspect.cleandoc(module.__doc__ or ''))


class _Help(_Generated):
    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        name = self.arguments[0]
        self.depend_on(f'scripts/{name}')
        return self.literal(_help_of(name))


class _Fields(_Generated):
    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        detector = detectors.get(self.arguments[0])
        self.depend_on(inspect.getfile(detector))
        defaults = parameters.defaults(detector)
        return self.table(('parameter', 'default', 'accepted', ''), [
            (f'`{name}`', f'`{defaults[name]!r}`', specification.accepted(), specification.description)
            for name, specification in parameters.specifications(detector).items()])


class _Dynamic(_Generated):
    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        name = self.arguments[0]
        config = importlib.import_module(f'rvc_features.cfg.{name}Config')
        self.depend_on(f'cfg/{name}.cfg')
        return self.table(('parameter', 'type', 'default', 'range', ''),
                          list(_dynamic_rows(config.config_description['parameters'])))


class _Presets(_Generated):
    required_arguments = 0

    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        self.depend_on('src/rvc_features/presets.py')
        rows = []
        for name in presets.names():
            preset = presets.get(name)
            sets = ', '.join(f'`{key}` {value}' for key, value in preset.values.items()) or 'nothing: it is the default'
            rows.append((f'`{name}`', preset.purpose, preset.cost, sets))
        return self.table(('preset', 'for', 'costs', 'sets'), rows)


def _row(cells: Sequence[str]) -> str:
    return '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def _dynamic_rows(described: Sequence[dict[str, Any]]) -> Iterator[tuple[str, ...]]:
    for each in described:
        if each['edit_method']:
            values = ', '.join(f'`{entry["value"]}`' for entry in eval(each['edit_method'])['enum'])
        elif each['type'] in ('int', 'double'):
            values = f'{each["min"]:g} to {each["max"]:g}'
        else:
            values = ''
        yield f'`{each["name"]}`', each['type'], f'`{each["default"]}`', values, each['description']


def _help_of(script: str) -> str:
    """What a script of the package prints for --help, run in this process."""
    said, before = io.StringIO(), signal.getsignal(signal.SIGINT)
    try:
        with mock.patch.object(sys, 'argv', [script, '--help']), mock.patch.dict(os.environ, COLUMNS=_WIDTH), \
                contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
            runpy.run_path(str(_ROOT / 'scripts' / script), run_name='__main__')
    finally:
        signal.signal(signal.SIGINT, before)   # which scripts that start nodes change
    if not said.getvalue().startswith('usage:'):
        raise ValueError(f'scripts/{script} --help does not print its usage')
    return said.getvalue().rstrip()


def _escape(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are written to be read as they are: |H| is no reference."""
    lines[:] = [line.replace('|', '\\|') for line in lines]


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect('autodoc-process-docstring', _escape)
    for name, directive in (('node', _Node), ('help', _Help), ('fields', _Fields), ('dynamic', _Dynamic),
                            ('presets', _Presets)):
        app.add_directive(name, directive)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
