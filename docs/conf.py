# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What Sphinx needs beside what rosdoc2 sets, which runs this file within a conf.py of its own."""

import re
from importlib.util import find_spec

extensions = ['sphinx.ext.mathjax', 'sphinx.ext.napoleon']

napoleon_google_docstring = False
napoleon_use_rtype = False
# Attributes as fields of their class: autodoc finds most of them too, and one is enough.
napoleon_use_ivar = True

# A heading of a Markdown page can be linked to.
myst_heading_anchors = 4

# A type that a package offers too has two pages; either will do.
suppress_warnings = ['ref.python']

# What rosdoc2 cannot tell by the names of the dependencies in package.xml; our folder launch/ looks
# like the package of that name.
_ASKED_BY = {
    'control': 'control', 'launch': 'launch.actions', 'lz4': 'lz4', 'mcap': 'mcap',
    'zstandard': 'zstandard'}


def _is_there(name):
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


autodoc_mock_imports = [name for name, asked in _ASKED_BY.items() if not _is_there(asked)]

# What is code already, or a bar that stands for no more than itself.
_CODE_OR_BAR = re.compile(r'``.*?``|`[^`]*`|\|')


def keep_bars(app, what, name, object_, options, lines):
    """Keep |S| an absolute value: reStructuredText would look for a substitution of that name."""
    lines[:] = [
        _CODE_OR_BAR.sub(lambda found: r'\|' if found[0] == '|' else found[0], line)
        for line in lines]


def skip_namesakes(app, what, name, object_, skip, options):
    """Leave a function that its package offers too to the page of the module it has its name of."""
    return True if getattr(object_, '__module__', '') == f'{app.env.docname}.{name}' else None


def setup(app):
    """Have docstrings changed as they are read, once napoleon has done its part."""
    app.connect('autodoc-skip-member', skip_namesakes)
    app.connect('autodoc-process-docstring', keep_bars, priority=900)
