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

"""Bags that are nearly fine (B6), hostile (A8) or of another kind (B12)."""

import os

import numpy as np
import pytest
import yaml
from mcap.writer import Writer

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read, salvage
from piezo_ros.bag.recording_date import recorded_utc
from piezo_ros.cli.main import main
from piezo_ros.streams.message_type import DEFINITION, TYPE_NAME

BOMB = 'a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'a{level}: &a{level} [{", ".join([f"*a{level - 1}"] * 10)}]\n' for level in range(1, 12))


def _changed_metadata(bag, **entries):
    file = bag / 'metadata.yaml'
    content = yaml.safe_load(file.read_text())
    content['rosbag2_bagfile_information'].update(entries)
    file.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize('entries', [
    {'compression_mode': 5}, {'compression_mode': ['zstd']}, {'storage_identifier': 5},
    {'relative_file_paths': 5}, {'relative_file_paths': [5]}, {'relative_file_paths': [None]}])
def test_a8_metadata_yaml_of_other_types_counts_as_missing(tmp_path, write_run, entries):
    write_run(tmp_path / 'bag')
    _changed_metadata(tmp_path / 'bag', **entries)
    assert read(tmp_path / 'bag').samples == 20


@pytest.mark.parametrize(
    'text', ['[' * 20_000, '&a [*a]', BOMB, '5', 'rosbag2_bagfile_information: 5', '\0'],
    ids=lambda text: repr(text)[:20])
def test_a8_metadata_yaml_out_of_bounds_counts_as_missing(tmp_path, write_run, text):
    write_run(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').write_text(text)
    assert read(tmp_path / 'bag').samples == 20


@pytest.mark.parametrize(
    'text', ['[' * 20_000, '&a [*a]', BOMB, '- 5', '9' * 5000],
    ids=lambda text: text[:20])
def test_a8_a_quality_of_service_out_of_bounds_is_left_out_by_salvage(tmp_path, text):
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        channel = writer.register_channel(
            '/voltage', 'cdr', schema, {'offered_qos_profiles': text})
        writer.add_message(channel, 0, BlockCodec('voltage').encode_one(0, 1e-5, 1.0), 0)
        writer.finish()
    assert salvage(tmp_path / 'a.mcap', tmp_path / 'whole').lost == ()
    content = yaml.safe_load((tmp_path / 'whole' / 'metadata.yaml').read_text())
    (topic,) = content['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['topic_metadata']['offered_qos_profiles'] == []


@pytest.mark.parametrize('text', [
    '[' * 20_000, '&a [*a]', BOMB, '5: {ros__parameters: {a: 1}}',
    '/plant: {ros__parameters: [a]}', '/plant: {ros__parameters: {5: a}}'],
    ids=lambda text: text[:20])
def test_a8_parameters_out_of_bounds_are_refused_by_name(tmp_path, text):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.attach_parameters(text)
        writer.write_block('voltage', 0, 1e-5, [1.0])
    with pytest.raises(BagError, match='parameters.yaml is no ROS parameter file'):
        read(tmp_path / 'bag')


@pytest.mark.timeout(20)
def test_a8_a_pipe_is_not_waited_for(tmp_path, write_run):
    (tmp_path / 'empty').mkdir()
    os.mkfifo(tmp_path / 'empty' / 'a.mcap')
    with pytest.raises(BagError, match='a.mcap is no regular file'):
        read(tmp_path / 'empty')
    with pytest.raises(BagError, match='a.mcap is no file and no directory'):
        read(tmp_path / 'empty' / 'a.mcap')
    write_run(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    os.mkfifo(tmp_path / 'bag' / 'metadata.yaml')
    assert read(tmp_path / 'bag').samples == 20
    assert recorded_utc(tmp_path / 'bag') == ''


def test_a8_a_file_name_in_metadata_yaml_that_no_file_can_have_is_a_missing_file(
        tmp_path, write_run):
    write_run(tmp_path / 'bag')
    _changed_metadata(tmp_path / 'bag', relative_file_paths=[f'{"a" * 300}.mcap'])
    with pytest.raises(BagError, match='lacks the file aaa'):
        read(tmp_path / 'bag')


def test_b6_the_empty_storage_that_a_reindex_leaves_is_read(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    _changed_metadata(tmp_path / 'bag', storage_identifier='')
    assert read(tmp_path / 'bag').samples == 20


def test_b6_a_split_file_that_was_not_copied_is_a_loss_that_is_told(tmp_path, write_split):
    values = write_split(tmp_path / 'bag', 3)
    (tmp_path / 'bag' / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: '
        '[bag_0.mcap, bag_1.mcap, bag_2.mcap, bag_3.mcap]}')
    with pytest.raises(BagError, match='the file bag_3.mcap that metadata.yaml names is missing'):
        read(tmp_path / 'bag')
    assert read(tmp_path / 'bag', allow_loss=True).samples == 30
    result = salvage(tmp_path / 'bag', tmp_path / 'whole')
    assert result.lost == ('the file bag_3.mcap that metadata.yaml names is missing',)
    np.testing.assert_array_equal(read(tmp_path / 'whole').voltage_v, values)


def test_b6_two_channels_of_one_topic_are_one_stream(tmp_path):
    values = np.arange(20.0)
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        channels = [
            writer.register_channel('/voltage', 'cdr', schema, {'publisher': name})
            for name in 'ab']
        for index, value in enumerate(values):
            raw = BlockCodec('voltage').encode_one(index, 1e-5, value)
            writer.add_message(channels[index // 3 % 2], index, raw, index)
        writer.finish()
    np.testing.assert_array_equal(read(tmp_path / 'a.mcap').voltage_v, values)
    part = open_recording(tmp_path / 'a.mcap').part(3, 11)
    np.testing.assert_array_equal(part.voltage_v, values[3:11])
    assert salvage(tmp_path / 'a.mcap', tmp_path / 'whole').lost == ()
    np.testing.assert_array_equal(read(tmp_path / 'whole').voltage_v, values)


@pytest.mark.parametrize(('head', 'words'), [
    (b'version https://git-lfs.github.com/spec/v1\noid sha', 'Git LFS pointer: `git lfs pull`'),
    (b'#ROSBAG V2.0\n', 'a ROS 1 bag: `rosbags-convert'),
    (b'SQLite format 3\0', 'a sqlite3 file: `ros2 bag convert`'),
    (b'\x28\xb5\x2f\xfd', 'compressed by zstd: `zstd -d`'),
])
def test_b12_a_file_of_another_format_is_named_with_its_tool(tmp_path, head, words):
    for name in ('a.mcap', 'a.bag'):
        (tmp_path / name).write_bytes(head + bytes(100))
        with pytest.raises(BagError, match=words):
            read(tmp_path / name)
    (tmp_path / 'a.mcap').unlink()
    with pytest.raises(BagError, match=r'it has a.bag \(ROS 1\), `rosbags-convert'):
        read(tmp_path)


@pytest.mark.parametrize(('type_name', 'encoding', 'words'), [
    ('std_msgs/msg/Float32MultiArray', 'cdr', '/voltage is of type std_msgs/msg/Float32MultiArray'),
    (TYPE_NAME, 'json', "/voltage has the encoding 'json'"),
    ('std_msgs/Float64MultiArray', 'ros1', '/voltage carries std_msgs/Float64MultiArray of ROS 1'),
])
def test_b12_messages_that_are_alike_are_named_with_the_remedy(
    tmp_path, capsys, type_name, encoding, words,
):
    for name, others in (('alone.mcap', []), ('among.mcap', ['displacement'])):
        with (tmp_path / name).open('wb') as file:
            writer = Writer(file)
            writer.start('ros2')
            alike = writer.register_schema(type_name, 'ros2msg', b'')
            schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
            channel = writer.register_channel('/voltage', encoding, alike)
            writer.add_message(channel, 0, b'{}', 0)
            for stream in others:
                channel = writer.register_channel(f'/{stream}', 'cdr', schema)
                writer.add_message(channel, 0, BlockCodec(stream).encode_one(0, 1e-5, 1.0), 0)
            writer.finish()
    with pytest.raises(BagError, match=words):
        read(tmp_path / 'alone.mcap')
    run = read(tmp_path / 'among.mcap')
    assert run.streams == ('displacement',)
    with pytest.raises(BagError, match=words):
        _ = run.voltage_v
    assert main(['bag', 'info', str(tmp_path / 'among.mcap')]) == 0
    assert words in capsys.readouterr().out


def test_b12_the_encoding_xcdr2_is_named(tmp_path, record_foreign):
    codec = BlockCodec('voltage')
    record_foreign(
        tmp_path / 'a.mcap',
        [('/voltage', b'\0\x07\0\0' + codec.encode_one(0, 1e-5, 1.0)[4:])])
    with pytest.raises(BagError, match='XCDR2'):
        read(tmp_path / 'a.mcap')


def test_the_names_of_monitors_are_told_of_as_no_streams_only_where_one_is_missing(
    tmp_path, record_foreign, blocks_of, run_samples,
):
    record_foreign(tmp_path / 'a.mcap', blocks_of(run_samples(10)))
    run = read(tmp_path / 'a.mcap')
    assert run.streams == tuple(STREAMS)
    assert run.unlike == {}
