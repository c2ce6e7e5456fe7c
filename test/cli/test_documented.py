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
"""What the documents print can be typed (B9): plans, parameter files, and commands of piezo."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from piezo_ros.cli.shared.command_line import argument_parser
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.plan.hardware_entry import complete_plant
from piezo_ros.experiment.plan.plan_file import PLAN_KEYS
from piezo_ros.experiment.plan.run_entry import RUN_KEYS
from piezo_ros.experiment.sweep import distribution, sweep_plan
from piezo_ros.model import ParameterError
from piezo_ros.parameters.node_parameters import NODE_PARAMETERS, check_node_parameters
from piezo_ros.parameters.parameter_file import read_parameter_file

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
_BLOCK = re.compile(r'^```\w*[^\n]*\n(.*?)^```$|((?:^    [^\n]*\n|^\n)+)', re.MULTILINE | re.DOTALL)
_PIEZO = re.compile(r'^(?:\S*/)?piezo (.*)$', re.MULTILINE)
_REMARK = re.compile(r' {2,}.*| #.*')


def blocks(path):
    """Return the code of a document: fenced blocks, and indented ones."""
    text = path.read_text(encoding='utf-8')
    return [
        fenced or re.sub(r'^    ', '', indented, flags=re.MULTILINE)
        for fenced, indented in _BLOCK.findall(text) if fenced or indented.strip()]


def yaml_blocks(path):
    """Return the blocks that are plans or parameter files, and their contents."""
    found = []
    for block in blocks(path):
        # Commands may stand before a file in one block, its name before its content.
        start = re.search(r'^(?:/\S*|\w+):(?: |$)', block, re.MULTILINE)
        if not start or '$' in block[start.start():]:
            continue
        try:
            content = yaml.safe_load(block[start.start():])
        except yaml.YAMLError:
            continue
        if isinstance(content, dict) and (
                'format_version' in content or 'ros__parameters' in block):
            found.append((block[start.start():], content))
    return found


YAML = [
    pytest.param(text, content, id=f'{path.stem}-{number}')
    for path in DOCUMENTS for number, (text, content) in enumerate(yaml_blocks(path))]
COMMANDS = [
    pytest.param(_REMARK.sub('', command), id=f'{path.stem}: {command[:40]}')
    for path in DOCUMENTS for block in blocks(path)
    for command in _PIEZO.findall(re.sub(r'\\\n *', '', block))]


def test_the_documents_have_such_blocks():
    assert len(YAML) >= 2
    assert len(COMMANDS) >= 30


@pytest.mark.parametrize(('text', 'content'), YAML)
def test_b9_every_printed_plan_and_parameter_file_is_taken(tmp_path, text, content):
    # Beside the files of config/, as the example that it shows.
    path = tmp_path / 'printed.yaml'
    path.write_text(text.replace('../', f'{ROOT}/config/'), encoding='utf-8')
    if 'format_version' in content:
        plan = read_plan(path)
        assert plan.runs or plan.scans
        return
    sections = read_parameter_file(path, NODE_PARAMETERS)
    assert sections
    for node, values in sections.items():
        try:
            if node == 'plant' and 'device' in values:
                complete_plant(values)
            else:
                check_node_parameters(node, values)
        except ParameterError as error:
            pytest.fail(f'{node}: {error}')


def test_the_page_of_plans_explains_every_key_in_a_table():
    page = (ROOT / 'docs' / 'plans.md').read_text(encoding='utf-8')
    explained = {
        key for row in re.findall(r'^\| (`[^|]*`) \|', page, re.MULTILINE)
        for key in re.findall(r'`(\w+)`', row)}
    assert explained == {
        *PLAN_KEYS, *RUN_KEYS, *sweep_plan.KEYS, *distribution.KINDS, *distribution.RELATIVE}


@pytest.mark.parametrize('command', COMMANDS)
def test_b9_every_printed_command_has_arguments_that_are_taken(command):
    words = shlex.split(re.sub(r'\|[\w.|]+', '', command))
    parser = argument_parser(words)
    try:
        parser.parse_args(words)
    except SystemExit as end:
        code = end.code
    else:
        code = 0
    assert not code, command
