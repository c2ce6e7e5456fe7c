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

"""A run that is described while it is recorded: later records and attachments win."""

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from piezo_ros.bag import BagError, BagWriter, open_recording, read, salvage

EARLY = '/plant:\n  ros__parameters: {seed: 7, order: lumped}\n'
LATE = '/plant:\n  ros__parameters: {seed: 8}\n/stage1:\n  ros__parameters: {scheme: fb}\n'


@pytest.fixture
def described(tmp_path):
    with BagWriter(
        tmp_path / 'bag', topics={'voltage': '/rig/u'}, namespace='/rig',
        metadata={'seed': '7', 'scheme': 'ff'},
    ) as writer:
        writer.attach_parameters(EARLY)
        for index in range(500):
            writer.write_block('voltage', index, 1e-5, [index / 3])
            if index == 250:
                writer.flush()
                writer.describe({'seed': '8', 'waveform': 'sine'}, LATE)
                writer.flush()
        writer.write_block('voltage', 500, 1e-5, [])
    return tmp_path / 'bag'


EXPECTED = {
    'seed': '8', 'scheme': 'ff', 'namespace': '/rig', 'topic.voltage': '/rig/u',
    'format_version': '1', 'waveform': 'sine'}
PARAMETERS = {'/plant': {'seed': 8, 'order': 'lumped'}, '/stage1': {'scheme': 'fb'}}


@pytest.mark.parametrize('reader', [read, open_recording])
def test_what_was_said_later_wins(described, reader):
    run = reader(described)
    assert run.samples == 500
    assert run.metadata == EXPECTED
    assert run.parameters == PARAMETERS


def test_the_closing_metadata_yaml_says_so_too(described):
    text = (described / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert information['custom_data'] == EXPECTED


def test_other_readers_read_the_bag(described):
    with AnyReader([described]) as reader:
        assert reader.message_count == 501
    with next(described.glob('*.mcap')).open('rb') as file:
        reader = make_reader(file)
        assert len(list(reader.iter_messages())) == 501
        assert len(list(reader.iter_attachments())) == 2
        assert [record.name for record in reader.iter_metadata()] == [
            'piezo_ros', 'piezo_ros', 'rosbag2']


def test_salvage_of_a_cut_bag_keeps_what_is_there(described, tmp_path):
    file = next(described.glob('*.mcap'))
    content = file.read_bytes()
    late = content.index(LATE.encode())
    for name, end, metadata, parameters in [
        ('behind', late + 2000, EXPECTED, PARAMETERS),
        ('ahead', late - 300, {
            **EXPECTED, 'seed': '7'}, {'/plant': {'seed': 7, 'order': 'lumped'}}),
    ]:
        file.write_bytes(content[:end])
        salvage(described, tmp_path / name)
        run = read(tmp_path / name, allow_loss=True)
        expected = {key: value for key, value in metadata.items() if (
            name == 'behind' or key != 'waveform')}
        assert expected.items() <= run.metadata.items()
        assert set(run.metadata) - set(expected) == {'lost'}
        assert run.parameters == parameters
        assert run.samples >= 200


def test_the_last_of_equal_attachments_is_kept_in_its_place(tmp_path):
    with BagWriter(tmp_path / 'bag', topics={'voltage': '/voltage'}) as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        for text in (EARLY, LATE, EARLY):
            writer.describe({}, text)
    assert read(tmp_path / 'bag').parameters['/plant']['seed'] == 7
    salvage(tmp_path / 'bag', tmp_path / 'saved')
    assert read(tmp_path / 'saved').parameters == read(tmp_path / 'bag').parameters


def test_metadata_may_be_said_without_parameters_and_is_checked(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        writer.describe({'seed': '3'})
        with pytest.raises(ValueError, match="'seed' is 7"):
            writer.describe({'seed': 7})
        with pytest.raises(ValueError, match="'namespace' is the writer's own"):
            writer.describe({'namespace': '/rig'})
    assert read(tmp_path / 'bag').metadata == {'seed': '3', 'format_version': '1'}
    assert read(tmp_path / 'bag').parameters == {}
    with pytest.raises(BagError, match='closed'):
        writer.describe({})
