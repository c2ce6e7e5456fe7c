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

"""
Settings of Sphinx for the documentation: `make docs`, or `sphinx-build docs build/docs`.

rosdoc2 runs this file within a conf.py of its own, on a copy of docs/, and with the extensions that
are installed there.
"""

import os
import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / '_ext'))
if (HERE.parent / 'piezo_ros').is_dir():
    sys.path.insert(0, str(HERE.parent))
# The folder of README.md and of the sources, also where docs/ was copied elsewhere.
repository = str(Path(find_spec('piezo_ros').origin).parents[1])
# For the kernels of the notebooks.
os.environ['PYTHONPATH'] = os.pathsep.join(
    filter(None, [repository, os.environ.get('PYTHONPATH', '')]))

project = 'piezo_ros'
project_copyright = '2026, piezo_ros maintainers'
author = 'piezo_ros maintainers'
release = version = '0.1.0'


def _is_there(name):
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


_NUMPYDOC = 'numpydoc' if _is_there('numpydoc') else 'sphinx.ext.napoleon'
_MARKDOWN = 'myst_nb' if _is_there('myst_nb') else 'myst_parser'
extensions = [
    'sphinx.ext.autodoc', 'sphinx.ext.autosummary', _NUMPYDOC, _MARKDOWN,
    *filter(_is_there, ['sphinx_gallery.gen_gallery', 'sphinx_copybutton']),
    'api_pages', 'command_line', 'docstrings', 'repository_pages']
# rosdoc2 names myst_parser for Markdown, which cannot be loaded beside myst_nb.
source_suffix = {
    '.rst': 'restructuredtext', '.md': 'markdown' if _MARKDOWN == 'myst_parser' else 'myst-nb'}
rosdoc2_settings = {
    'allow_other_extensions': True, 'override_theme': False,
    'support_markdown': _MARKDOWN == 'myst_parser'}

root_doc = 'index'
# `name` in a docstring is a link where there is such a name.
default_role = 'py:obj'
exclude_patterns = [
    '_build', 'gallery', 'sg_execution_times.rst', '**/.ipynb_checkpoints',
    # Beside the pages of the gallery, for download.
    'generated/gallery/*.ipynb',
    # What rosdoc2 adds for packages without a site of their own.
    'index.rst', 'README.md', 'CHANGELOG.rst', 'CONTRIBUTING.md', 'QUALITY_DECLARATION.md',
    '__*.rst']
templates_path = ['_templates']

# API pages: one for each module, one for each name that a package offers.
autosummary_generate = True
autosummary_ignore_module_all = False
autosummary_imported_members = True
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'
autodoc_default_options = {'show-inheritance': True}
numpydoc_show_class_members = False
numpydoc_validation_checks = set()
# What is not installed is stood in for; our folder launch/ looks like the package of that name.
_ASKED_BY = {
    'ament_index_python': 'ament_index_python', 'control': 'control',
    'diagnostic_msgs': 'diagnostic_msgs', 'launch': 'launch.actions', 'launch_ros': 'launch_ros',
    'lifecycle_msgs': 'lifecycle_msgs', 'lz4': 'lz4', 'mcap': 'mcap',
    'rcl_interfaces': 'rcl_interfaces', 'rclpy': 'rclpy', 'rosgraph_msgs': 'rosgraph_msgs',
    'sensor_msgs': 'sensor_msgs', 'std_msgs': 'std_msgs', 'std_srvs': 'std_srvs',
    'zstandard': 'zstandard'}
autodoc_mock_imports = [name for name, asked in _ASKED_BY.items() if not _is_there(asked)]
# A type that a package offers too has two pages; either will do.
suppress_warnings = ['ref.python']

# A heading of a Markdown page can be linked to.
myst_heading_anchors = 4
myst_enable_extensions = ['colon_fence', 'deflist', 'dollarmath']

# Notebooks are run as the site is built, with the pictures inline; an error ends the build.
os.environ.pop('MPLBACKEND', None)
nb_execution_mode = 'force'
nb_execution_raise_on_error = True
nb_execution_timeout = 900
# A kernel that does not warn of its own transport, which is that of this machine.
os.environ['JUPYTER_PATH'] = str(HERE / '_ext' / 'jupyter')

sphinx_gallery_conf = {
    'examples_dirs': 'gallery',
    'gallery_dirs': 'generated/gallery',
    'filename_pattern': r'/plot_',
    'abort_on_example_error': True,
    'download_all_examples': False,
    'remove_config_comments': True,
    'show_memory': False,
}

html_theme = 'pydata_sphinx_theme' if _is_there('pydata_sphinx_theme') else 'alabaster'
html_title = 'piezo_ros'
html_static_path = ['_static']
html_css_files = ['site.css']
html_theme_options = {
    'navigation_with_keys': False,
    'show_toc_level': 2,
    'header_links_before_dropdown': 6,
    'footer_start': ['copyright'],
    'footer_end': [],
    'collapse_navigation': True,
    'navigation_depth': 3,
} if html_theme == 'pydata_sphinx_theme' else {}
html_sidebars = {'index': [], 'generated/api/*': [], 'generated/api/names/*': []}
html_show_sourcelink = False
html_copy_source = False
