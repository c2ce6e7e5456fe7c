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

"""The links of the documents lead somewhere."""

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
DOCS = REPOSITORY / 'docs'
# What `make docs` made is no part of the sources.
MADE = (DOCS / '_build', DOCS / 'generated')
DOCUMENTS = sorted([
    *REPOSITORY.glob('*.md'), REPOSITORY / 'benchmarks' / 'README.md',
    *(path for path in DOCS.rglob('*.md') if not {*MADE} & {*path.parents})])
_CODE = re.compile(r'^```.*?^```$|^    .*?$|`[^`\n]*`', re.MULTILINE | re.DOTALL)
# [text](target), the text over one line or several, and a picture.
_LINK = re.compile(r'\[[^\[\]]*\]\(\s*([^()\s]+)\s*\)')
_HEADING = re.compile(r'^#+ (.*)$', re.MULTILINE)


def links_of(text):
    return _LINK.findall(_CODE.sub('', text))


def anchors_of(text):
    """Return the names that headings get: small letters, no signs, hyphens for spaces."""
    return {
        re.sub(r'[^\w\- ]', '', heading).strip().lower().replace(' ', '-')
        for heading in _HEADING.findall(re.sub(r'^```.*?^```$', '', text, flags=re.M | re.S))}


def dead_links(path, text):
    dead = []
    for link in links_of(text):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = link.partition('#')
        target = (path.parent / name).resolve() if name else path
        there = not name or (target.exists() and target.is_relative_to(REPOSITORY))
        if there and anchor:
            of = text if target == path else target.read_text(encoding='utf-8')
            there = anchor in anchors_of(of)
        if not there:
            dead.append(link)
    return dead


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_every_link_within_the_repository_leads_to_what_there_is(path):
    assert not dead_links(path, path.read_text(encoding='utf-8'))


def test_every_page_can_be_reached_from_the_first_one():
    reached, left = set(), [REPOSITORY / 'README.md']
    while left:
        path = left.pop()
        if path in reached or path.suffix != '.md':
            continue
        reached.add(path)
        left += [
            (path.parent / link.partition('#')[0]).resolve()
            for link in links_of(path.read_text(encoding='utf-8'))
            if not re.match(r'[a-z]+:|#', link)]
    assert reached == set(DOCUMENTS)


@pytest.mark.parametrize(('text', 'dead'), [
    ('[what\nis there](../README.md) ![picture](figures/tracking.svg)', []),
    ('[what is not](nowhere.md)', ['nowhere.md']),
    ('[outside](../../elsewhere.md)', ['../../elsewhere.md']),
    ('# Two words, here\n\n[a](#two-words-here) [b](#three-words)', ['#three-words']),
    ('[of another page](launch.md#rigging)', ['launch.md#rigging']),
    ('`[code](nowhere.md)`\n\n    [code](nowhere.md)\n\n```sh\n[code](nowhere.md)\n```\n', []),
    ('[elsewhere](https://example.com/nowhere.md)', []),
])
def test_dead_links_are_found(text, dead):
    assert dead_links(REPOSITORY / 'docs' / 'page.md', text) == dead
