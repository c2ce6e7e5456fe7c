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

"""The pages of docs/: printed ones are current, topics are all there, links lead somewhere."""

import re
from pathlib import Path

import pytest

from piezo_ros.bag import STREAMS
from piezo_ros.parameters.node_parameters import (
    NODE_PARAMETERS,
    ONLOOKER_PARAMETERS,
    PROGRAM_PARAMETERS,
    parameter_names,
)
from piezo_ros.reference_pages import PAGES, main

ROOT = Path(__file__).parents[1]
MARKDOWN = [
    ROOT / 'README.md', *sorted(
        path for path in (ROOT / 'docs').rglob('*.md')
        if path.relative_to(ROOT / 'docs').parts[0] not in ('_build', 'generated'))]


@pytest.mark.parametrize('name', PAGES)
def test_a_printed_page_is_what_the_code_prints(name, tmp_path):
    assert main([str(tmp_path)]) == 0
    printed = (tmp_path / name).read_text(encoding='utf-8')
    assert (ROOT / 'docs' / name).read_text(encoding='utf-8') == printed, 'run `make docs`'


def test_the_page_of_parameters_has_every_one_of_every_node():
    sections = dict(zip(
        *[iter(re.split(r'^## (.*)$', PAGES['parameters.md'](), flags=re.MULTILINE)[1:])] * 2,
        strict=True))
    assert list(sections) == [
        'Every node', *NODE_PARAMETERS, *PROGRAM_PARAMETERS, *ONLOOKER_PARAMETERS]
    for node in (*NODE_PARAMETERS, *PROGRAM_PARAMETERS, *ONLOOKER_PARAMETERS):
        text = sections[node] + (sections['Every node'] if node not in ONLOOKER_PARAMETERS else '')
        listed = re.findall(r'^\| `(\w+)`', text, re.MULTILINE)
        assert sorted(listed) == sorted(parameter_names(node))


def test_the_page_of_topics_names_every_stream_with_its_label():
    text = (ROOT / 'docs' / 'topics.md').read_text(encoding='utf-8')
    for stream, unit in STREAMS.items():
        assert f'| `{stream}` | `{stream}_{unit}` |' in text


@pytest.mark.parametrize('path', MARKDOWN, ids=lambda path: path.stem)
def test_every_link_to_a_file_leads_to_one(path):
    targets = re.findall(r'\]\(([^)#]+)[^)]*\)', path.read_text(encoding='utf-8'))
    for target in targets:
        assert target.startswith('http') or (path.parent / target).exists(), target
