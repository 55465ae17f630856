"""How `./run docs` makes a site of README.md and docs/: Sphinx with MyST, without warnings and without network.

The sources are read from the repository's root, so that links between the documents are the same here, on a forge and
in a text editor. What is special to this package lies in extensions/.
"""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(_HERE / 'extensions'))   # the package itself: as built, for it has generated modules

_package = ElementTree.parse(_HERE.parent / 'package.xml')
project = author = 'rvc_features'
version = release = _package.findtext('version')
project_copyright = 'the rvc_features authors'

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'mathml', 'course', 'reference']
root_doc = 'docs/index'
include_patterns = ['README.md', 'CONTRIBUTING.md', 'SECURITY.md', 'CHANGELOG.rst', 'docs/**']
exclude_patterns = ['**/__pycache__', 'docs/pictures']

myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 3
highlight_language = 'bash'      # what is indented in the documents are commands
suppress_warnings = ['config.cache']

autodoc_member_order = 'bysource'
autodoc_typehints = 'none'       # the docstrings say more: shapes, units, ranges
napoleon_google_docstring = False
# Types in docstrings are words for people ("ndarray, float32, shape (H, W)"), not names of classes.
nitpick_ignore_regex = [('py:class', '.*')]

html_theme = 'alabaster'
html_theme_options = {'description': 'Key points for ROS 1, with a Harris detector to read', 'page_width': '1200px',
                      'body_max_width': 'none', 'font_size': '15px', 'code_font_size': '13px'}
html_show_sphinx = html_show_copyright = html_copy_source = False
html_math_renderer = 'mathml'    # needs neither network nor LaTeX
