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

"""The site of the documentation, built: no warning, every public name, no dead link."""

import importlib
import os
import re
import shutil
import subprocess
import sys
import zlib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from python_path import python_path

REPOSITORY = Path(__file__).resolve().parents[1]
DOCS = REPOSITORY / 'docs'
NEEDED = ('sphinx', 'numpydoc', 'myst_nb', 'sphinx_gallery', 'pydata_sphinx_theme')


class Page(HTMLParser):
    """
    The links of a page and the places that can be linked to.

    Attributes
    ----------
    links, anchors : set of str
        As they are in the page.
    pictures_without_text : list of str
        Sources of pictures without an alternative text.

    """

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.pictures_without_text = set(), set(), []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors |= {given[name] for name in ('id', 'name') if given.get(name)}
        self.links |= {given[name] for name in ('href', 'src') if given.get(name)}
        if tag == 'img' and 'alt' not in given:  # empty: the text beside it says the same
            self.pictures_without_text.append(given.get('src'))


def dead_links(site):
    """Return the links of the pages of a site that lead to nothing within it, page by page."""
    pages = {
        path.resolve(): Page(path.read_text(encoding='utf-8')) for path in site.rglob('*.html')
        if '_static' not in path.parts}  # a template of the theme
    dead = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            there = target.exists()
            if there and parts.fragment and target in pages:
                there = unquote(parts.fragment) in pages[target].anchors
            if not there:
                dead.append(f'{path.relative_to(site.resolve())}: {link}')
    return sorted(dead)


def test_dead_links_of_a_site_are_found(tmp_path):
    (tmp_path / 'one.html').write_text(
        '<a href="two.html#here">a</a><a href="two.html#gone">b</a><a href="gone.html">c</a>'
        '<a href="https://example.com/gone.html">d</a><img src="gone.png">')
    (tmp_path / 'two.html').write_text('<p id="here"><a href="#here">e</a></p>')
    assert dead_links(tmp_path) == [
        'one.html: gone.html', 'one.html: gone.png', 'one.html: two.html#gone']
    assert Page('<img src="a.png"><img src="b.png" alt="b">').pictures_without_text == ['a.png']


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Build a copy of docs/, as rosdoc2 does, so that the sources stay as they are."""
    for name in NEEDED:
        pytest.importorskip(name, reason='the site needs the extra [docs]')
    folder = tmp_path_factory.mktemp('site')
    shutil.copytree(
        DOCS, folder / 'docs', ignore=shutil.ignore_patterns('_build', 'generated', '__pycache__'))
    built = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'html',
         folder / 'docs', folder / 'html'],
        env=os.environ | {'PYTHONPATH': python_path(REPOSITORY)},
        capture_output=True, text=True, check=False)
    return folder / 'html', built


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_site_is_built_without_a_warning(site):
    _, built = site
    if built.returncode:
        pytest.fail(built.stdout + built.stderr, pytrace=False)


def public_names():
    """Yield every public name with the module that documents it, and what the page is called."""
    sys.path.insert(0, str(DOCS / '_ext'))
    try:
        api_pages = importlib.import_module('api_pages')
    finally:
        sys.path.remove(str(DOCS / '_ext'))
    for module in api_pages.modules_of(REPOSITORY / 'piezo_ros'):
        for name in module.own:
            page = (
                f'{api_pages.NAMES}/{module.name}.{name}' if module.is_package else module.name)
            yield f'{module.name}.{name}', f'generated/api/{page}.html'


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_every_public_name_has_a_page(site):
    html, _ = site
    # Four lines of text, then compressed: name, role, priority, address, title.
    packed = (html / 'objects.inv').read_bytes().split(b'\n', 4)[4]
    where = set(re.findall(
        r'^(\S+) py:\S+ \S+ ([^\s#]+)', zlib.decompress(packed).decode(), re.MULTILINE))
    missing = [name for name, page in public_names() if (name, page) not in where]
    assert not missing, missing
    assert len(where) > 1000


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_site_has_no_dead_link(site):
    html, _ = site
    dead = dead_links(html)
    assert not dead, '\n'.join(dead)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('page', [
    *(f'notebooks/{path.stem}' for path in (DOCS / 'notebooks').glob('*.ipynb')),
    *(f'generated/gallery/{path.stem}' for path in (DOCS / 'gallery').glob('plot_*.py'))])
def test_a_page_that_is_run_shows_its_pictures(site, page):
    html, _ = site
    path = html / f'{page}.html'
    pictures = [
        link for link in Page(path.read_text(encoding='utf-8')).links if link.endswith('.png')]
    assert pictures


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_every_picture_of_the_site_has_an_alternative_text(site):
    html, _ = site
    without = {
        str(path.relative_to(html)): pictures for path in html.rglob('*.html')
        if (pictures := Page(path.read_text(encoding='utf-8')).pictures_without_text)}
    assert not without
