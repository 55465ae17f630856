"""Directives for the course's pages, whose pictures are made while the documents are built.

    picture NAME      one that extensions/drawings.py has under that name
    sliders           for each line, written as for compare_detectors, what it finds
    mistake NAME      what a solution with that mistake finds; the names are those of check_exercise
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import cv2
import drawings
import numpy as np
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

_PACKAGE = Path(__file__).resolve().parents[2] / 'src' / 'rvc_features'


class _Picture(SphinxDirective):
    """A picture that is made now, with what it shows as text for who can't see it."""

    has_content = True
    optional_arguments = 1
    final_argument_whitespace = True

    def drawn(self) -> tuple[np.ndarray, str, list[nodes.Node]]:
        """The picture, what it shows, and what stands above it."""
        name = self.arguments[0]
        return drawings.FIXED[name](), ' '.join((drawings.FIXED[name].__doc__ or '').split()), []

    def run(self) -> list[nodes.Node]:
        """Called by Sphinx."""
        picture, text, above = self.drawn()
        subject = '\n'.join([self.name, *self.arguments, *self.content])
        folder = Path(self.env.doctreedir) / 'drawn'
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f'{self.name}-{hashlib.sha256(subject.encode()).hexdigest()[:12]}.png'
        if not cv2.imwrite(str(path), picture):
            raise OSError(f'{path} can\'t be written')
        for source in [Path(drawings.__file__), *_PACKAGE.glob('*.py'), *(_PACKAGE / 'exercise').glob('*.py')]:
            self.env.note_dependency(os.path.relpath(source, self.env.srcdir))
        here = os.path.dirname(self.env.doc2path(self.env.docname))
        return [*above, nodes.image(uri=os.path.relpath(path, here), alt=text)]


class _Sliders(_Picture):
    def drawn(self) -> tuple[np.ndarray, str, list[nodes.Node]]:
        texts = [line.strip() for line in self.content if line.strip()]
        return drawings.sliders(texts), 'What these settings find: ' + '; '.join(texts), []


class _Mistake(_Picture):
    def drawn(self) -> tuple[np.ndarray, str, list[nodes.Node]]:
        picture, sentence = drawings.mistake(self.arguments[0])
        text = nodes.paragraph('', '', nodes.strong('', 'A typical mistake'),
                               nodes.Text(', which check_exercise calls '),
                               nodes.emphasis('', self.arguments[0]), nodes.Text(f': {sentence}.'))
        return picture, sentence, [text]


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive('picture', _Picture)
    app.add_directive('sliders', _Sliders)
    app.add_directive('mistake', _Mistake)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
