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

"""The documentation without building it: pages, navigation, links of the site, notebooks."""

import ast
import importlib.util
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[1]
DOCS = REPOSITORY / 'docs'
MADE = (
    '_build', '_ext', '_static', '_templates', 'gallery', 'generated', 'sg_execution_times.rst')
PAGES = sorted(
    path.relative_to(DOCS).with_suffix('').as_posix()
    for suffix in ('md', 'rst', 'ipynb') for path in DOCS.rglob(f'*.{suffix}')
    if path.relative_to(DOCS).parts[0] not in MADE)
NOTEBOOKS = sorted((DOCS / 'notebooks').glob('*.ipynb'))
GALLERY = sorted((DOCS / 'gallery').glob('plot_*.py'))
PACKAGE = REPOSITORY / 'piezo_ros'
DOI = re.compile(r'\b10\.\d{4,}/[^\s"<>\])},]+')


def extension(name):
    """Return a module of docs/_ext, which is no package."""
    spec = importlib.util.spec_from_file_location(name, DOCS / '_ext' / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def modules():
    return [*extension('api_pages').modules_of(PACKAGE)]


def text_of(page):
    """Return the source of a page; that of a notebook is empty."""
    for suffix in ('md', 'rst'):
        path = DOCS / f'{page}.{suffix}'
        if path.exists():
            return path.read_text(encoding='utf-8')
    return ''


def toctree_entries(page):
    """Return the pages that a page lists in its toctrees; one that the build makes lists none."""
    text = '' if page.startswith('generated/') else text_of(page)
    blocks = [
        *re.findall(r'^```\{toctree\}\n(.*?)^```', text, re.MULTILINE | re.DOTALL),
        *re.findall(r'^\.\. toctree::\n((?: +.*\n|\n)+)', text, re.MULTILINE)]
    folder = (DOCS / page).parent
    return [
        (folder / line.strip()).resolve().relative_to(DOCS).as_posix()
        for block in blocks for line in block.splitlines()
        if line.strip() and not line.strip().startswith(':')]


def test_the_navigation_leads_to_every_page_once():
    listed, left = [], ['index']
    while left:
        entries = toctree_entries(left.pop())
        listed += entries
        left += entries
    assert sorted(listed) == sorted(set(listed))
    ours = {entry for entry in listed if not entry.startswith('generated/')}
    # A new page goes into the toctree of start, guide, reference or project/index.
    assert ours | {'index'} == set(PAGES)


def test_every_package_is_in_the_navigation_of_the_api(modules):
    top = {f'generated/api/{module.name}' for module in modules if module.name.count('.') == 1}
    assert {*toctree_entries('api')} == top


def test_a_module_has_its_own_names_on_its_page_and_links_to_those_of_others(tmp_path):
    api_pages = extension('api_pages')
    sources = {
        'stage/__init__.py':
            '"""A stage."""\nfrom stage.sensor import Sensor\nfrom other import Clock\n'
            "__all__ = ['Clock', 'Sensor', 'VERSION']\nVERSION = 1\n",
        'stage/sensor.py':
            "from stage.noise import noise\n__all__ = ['Sensor', 'noise']\nclass Sensor: ...\n",
        'stage/noise.py': "__all__ = ['noise']\ndef noise(): ...\n"}
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding='utf-8')
    modules = {module.name: module for module in api_pages.modules_of(tmp_path / 'stage')}
    assert [*modules] == ['stage', 'stage.noise', 'stage.sensor']
    assert modules['stage'].own == ('Sensor', 'VERSION')
    assert modules['stage.sensor'].own == ('Sensor',)
    page = api_pages.page_of(modules['stage'], ['stage.noise', 'stage.sensor'])
    assert '   Sensor\n   VERSION\n' in page
    assert ':py:obj:`Clock <other.Clock>`' in page
    assert '   stage.noise\n   stage.sensor\n' in page
    page = api_pages.page_of(modules['stage.sensor'], [])
    assert ':exclude-members: noise' in page
    assert ':py:obj:`noise <stage.noise.noise>`' in page


@pytest.mark.parametrize(('link', 'file', 'page', 'of_site'), [
    ('[a](docs/topics.md)', 'README.md', 'project/readme', '[a](../topics.md)'),
    ('[a](../README.md#the-loop)', 'docs/hardware.md', 'hardware',
     '[a](project/readme.md#the-loop)'),
    ('![a](docs/figures/tracking.svg)', 'README.md', 'project/readme',
     '![a](../figures/tracking.svg)'),
    ('[a](benchmarks/README.md)', 'README.md', 'project/readme', '[a](benchmarks.md)'),
    ('[a](LICENSE)', 'README.md', 'project/readme', 'a'),
    ('[a](https://example.com/docs/topics.md)', 'README.md', 'project/readme',
     '[a](https://example.com/docs/topics.md)'),
    ('[a](#here)', 'README.md', 'project/readme', '[a](#here)'),
    ('`[a](LICENSE)`\n\n    [a](LICENSE)\n', 'README.md', 'project/readme',
     '`[a](LICENSE)`\n\n    [a](LICENSE)\n'),
    ('[a\nb](parameters.md#plant)', 'docs/hardware.md', 'hardware', '[a\nb](parameters.md#plant)'),
])
def test_links_of_the_repository_become_links_of_the_site(link, file, page, of_site):
    with_links_of_site = extension('repository_pages').with_links_of_site
    assert with_links_of_site(link, file, page, REPOSITORY) == of_site


@pytest.mark.slow  # imports every command
def test_the_page_of_the_command_line_has_every_command_and_option():
    page = extension('command_line').page()
    assert 'piezo identify hysteresis' in page.splitlines()
    for words in ('--parameters FILE', '--composed', '--frequencies-hz', 'piezo bag salvage'):
        assert words in page


@pytest.mark.parametrize('path', NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_keeps_no_results_so_that_the_site_shows_those_of_the_code(path):
    notebook = json.loads(path.read_text(encoding='utf-8'))
    assert notebook['nbformat'] == 4
    assert notebook['cells'][0]['cell_type'] == 'markdown'
    for cell in notebook['cells']:
        if cell['cell_type'] == 'code':
            assert cell['outputs'] == []
            assert cell['execution_count'] is None
            compile(''.join(cell['source']), path.name, 'exec')


@pytest.mark.parametrize('path', GALLERY, ids=lambda path: path.stem)
def test_a_page_of_the_gallery_has_a_heading_and_imports_what_is_public(path, modules):
    tree = ast.parse(path.read_text(encoding='utf-8'))
    heading, line = ast.get_docstring(tree).splitlines()[:2]
    assert line == '=' * len(heading)
    public = {module.name: set(module.public) for module in modules}
    for statement in ast.walk(tree):
        if isinstance(statement, ast.ImportFrom) and statement.module.startswith('piezo_ros'):
            assert {alias.name for alias in statement.names} <= public[statement.module]


def test_the_versions_and_the_name_of_the_paper_agree():
    version = ElementTree.parse(REPOSITORY / 'package.xml').getroot().findtext('version')
    citation = yaml.safe_load((REPOSITORY / 'CITATION.cff').read_text(encoding='utf-8'))
    settings = (DOCS / 'conf.py').read_text(encoding='utf-8')
    assert citation['version'] == version
    assert f"release = version = '{version}'" in settings
    (paper,) = citation['references']
    for page in ('index', 'project/cite'):
        assert {doi.rstrip('.') for doi in DOI.findall(text_of(page))} == {paper['doi']}
