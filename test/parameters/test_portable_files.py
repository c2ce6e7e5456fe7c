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

import json

import pytest

from piezo_ros.parameters.portable_files import OUTPUT_MARKER, told_from_bag


@pytest.fixture
def output(tmp_path):
    directory = tmp_path / 'µ out'
    directory.mkdir()
    (directory / OUTPUT_MARKER).touch()
    return directory


def test_files_of_the_output_are_told_from_the_bag_on(output):
    file = str(output / 'motions' / 'wave.csv')
    told = told_from_bag(output / 'bags' / 'run', {
        '/trajectory': {
            'file': file, 'file_changes': json.dumps([{'at_sample': 3, 'file': file}]),
            'amplitude_um': 1.5, 'frequencies_hz': [1.0, 2.0]},
        '/plant': {'note': f'a {file}, b'}})
    short = '../../motions/wave.csv'
    assert told == {
        '/trajectory': {
            'file': short, 'file_changes': json.dumps([{'at_sample': 3, 'file': short}]),
            'amplitude_um': 1.5, 'frequencies_hz': [1.0, 2.0]},
        '/plant': {'note': f'a {short}, b'}}
    assert (output / 'bags' / 'run' / short).resolve() == output / 'motions' / 'wave.csv'


def test_files_elsewhere_keep_their_names(output):
    values = {
        '/trajectory': {'file': str(output.parent / 'wave.csv')},
        '/plant': {
            'longer': f'/mirror{output}/wave.csv', 'beside': f'{output}_2/wave.csv',
            'output': str(output)}}
    assert told_from_bag(output / 'bags' / 'run', values) == values


def test_a_bag_in_no_output_tells_its_files_as_they_are(tmp_path):
    values = {'/trajectory': {'file': str(tmp_path / 'wave.csv')}}
    assert told_from_bag(tmp_path / 'bags' / 'run', values) == values


def test_a_bag_named_by_way_of_a_link_or_a_relative_path_is_the_same(output, monkeypatch):
    link = output.parent / 'link'
    link.symlink_to(output)
    values = {'/trajectory': {'file': str(output / 'wave.csv')}}
    monkeypatch.chdir(output)
    for bag in link / 'bags' / 'run', output.relative_to(output) / 'bags' / 'run':
        assert told_from_bag(bag, values) == {'/trajectory': {'file': '../../wave.csv'}}
