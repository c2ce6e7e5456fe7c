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

import os
import shutil

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_mutations import without_data_checksum
from rosbags.highlevel import AnyReader

from piezo_ros.bag import STREAMS, BagError, BagExistsError, BagWriter, read, salvage
from piezo_ros.bag.container.rosbag2_writer import Rosbag2Writer

FLUSH = 40  # steps of the run in each chunk
COUNT = 400


@pytest.fixture(scope='module')
def shared(tmp_path_factory):
    return tmp_path_factory.mktemp('shared')


def _summary(file):
    with file.open('rb') as stream:
        return make_reader(stream).get_summary()


def _cut(bag, directory, length):
    """Copy the MCAP file alone, as a killed recorder leaves it, and cut it."""
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir()
    file = directory / 'cut_0.mcap'
    shutil.copy(bag / 'bag_0.mcap', file)
    os.truncate(file, length)
    return file


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(fraction=st.floats(0, 1), whole_directory=st.booleans())
def test_exactly_the_whole_chunks_are_recovered(shared, write_run, fraction, whole_directory):
    bag = shared / 'bag'
    if not bag.exists():
        write_run(bag, COUNT, flush_every=FLUSH, metadata={'scheme': 'fb'})
    samples = read(bag)
    size = (bag / 'bag_0.mcap').stat().st_size
    length = round(fraction * size)
    chunks = _summary(bag / 'bag_0.mcap').chunk_indexes
    whole = sum(item.chunk_start_offset + item.chunk_length <= length for item in chunks)
    file = _cut(bag, shared / 'cut', length)
    output = shared / 'output'
    shutil.rmtree(output, ignore_errors=True)
    source = shared / 'cut' if whole_directory else file
    if not whole:
        with pytest.raises(BagError, match='no whole message|no MCAP file'):
            salvage(source, output)
        assert not output.exists()
        return
    result = salvage(source, output)
    run = read(output)
    assert run.samples == min(whole * FLUSH, COUNT)
    for stream in STREAMS:
        np.testing.assert_array_equal(
            run.whole(stream)[1][:run.samples], samples.whole(stream)[1][:run.samples])
    assert run.metadata['scheme'] == 'fb'
    assert run.parameters == {'/plant': {'seed': 7}}
    assert run.lost == result.lost
    if whole < len(chunks):
        assert result.lost
    with AnyReader([output]) as reader:
        assert reader.message_count == sum(result.messages.values())
        assert {item.topic: item.msgcount for item in reader.connections} == result.messages


@pytest.mark.parametrize('back', [1, 20, 50, 90, 500, 3000])
def test_of_an_uncompressed_chunk_cut_in_the_middle_the_whole_messages_are_recovered(
    tmp_path, write_run, back,
):
    write_run(tmp_path / 'bag', COUNT, compression='none')
    (chunk,) = _summary(tmp_path / 'bag' / 'bag_0.mcap').chunk_indexes
    end = chunk.chunk_start_offset + chunk.chunk_length
    raw = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    body_end = end - back
    file = _cut(tmp_path / 'bag', tmp_path / 'cut', body_end)
    result = salvage(file, tmp_path / 'output')
    # Every message record of this bag begins with its opcode and a length; count the whole ones.
    position = chunk.chunk_start_offset + 9 + 8 + 8 + 8 + 4 + 4 + 8
    expected = 0
    while position + 9 <= body_end:
        following = position + 9 + int.from_bytes(raw[position + 1:position + 9], 'little')
        expected += raw[position] == 5 and following <= body_end
        position = following
    assert sum(result.messages.values()) == expected
    assert expected < 5 * (COUNT + 1) + 1
    assert 'cut_0.mcap' in result.lost[0]
    assert read(tmp_path / 'output').samples >= COUNT - 40


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_a_whole_bag_is_copied_without_loss(tmp_path, write_run, compression):
    write_run(tmp_path / 'bag', 50, metadata={'scheme': 'fb'})
    result = salvage(tmp_path / 'bag', tmp_path / 'output', compression=compression)
    assert result.lost == ()
    before, after = read(tmp_path / 'bag'), read(tmp_path / 'output')
    assert after.lost == ()
    assert after.metadata == before.metadata
    assert after.parameters == before.parameters
    for stream in STREAMS:
        np.testing.assert_array_equal(after.whole(stream)[1], before.whole(stream)[1])


def test_a_bag_cut_within_its_index_has_lost_nothing(tmp_path, write_run):
    write_run(tmp_path / 'bag', 50)
    size = (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    file = _cut(tmp_path / 'bag', tmp_path / 'cut', size - 10)
    assert read(file).lost == ()
    assert salvage(file, tmp_path / 'output').lost == ()
    with AnyReader([tmp_path / 'output']) as reader:
        assert reader.message_count == 5 * 51 + 1


@pytest.mark.parametrize('chunked', [True, False])
def test_all_topics_of_a_foreign_recording_are_kept_with_their_times(
    tmp_path, record_foreign, blocks_of, run_samples, chunked,
):
    blocks = blocks_of(run_samples(300), prefix='/rig')
    blocks[5:5] = [('/status', b'\0\1\0\0\3\0\0\0{}\0')] * 3
    record_foreign(tmp_path / 'a.mcap', blocks, chunk_size=20_000, chunked=chunked)
    size = (tmp_path / 'a.mcap').stat().st_size
    os.truncate(tmp_path / 'a.mcap', size // 2)
    result = salvage(tmp_path / 'a.mcap', tmp_path / 'output')
    assert result.messages['/status'] == 3
    kept = sum(result.messages.values())
    assert 0.3 * len(blocks) < kept < 0.7 * len(blocks)
    with AnyReader([tmp_path / 'output']) as reader:
        seen = [(item.topic, time_ns, raw) for item, time_ns, raw in reader.messages()]
    assert seen == [
        (topic, 1_700_000_000_000_000_000 + 1000 * number, raw)
        for number, (topic, raw) in enumerate(blocks[:kept])
    ]
    run = read(tmp_path / 'output')
    assert run.namespace == '/rig'
    assert run.lost == result.lost != ()


def test_the_quality_of_service_survives_in_both_places(tmp_path, write_run):
    write_run(tmp_path / 'bag', 50)
    salvage(tmp_path / 'bag', tmp_path / 'output')
    topics = [
        yaml.safe_load((tmp_path / name / 'metadata.yaml').read_text())[
            'rosbag2_bagfile_information']['topics_with_message_count']
        for name in ('bag', 'output')
    ]
    assert topics[0] == topics[1]
    channels = [
        _summary(tmp_path / name / f'{name}_0.mcap').channels for name in ('bag', 'output')]
    assert channels[0] == channels[1]


def test_salvage_never_overwrites(tmp_path, write_run):
    write_run(tmp_path / 'bag', 50)
    with pytest.raises(BagExistsError, match='exists'):
        salvage(tmp_path / 'bag', tmp_path / 'bag')


def test_losses_add_up_over_repeated_salvage(tmp_path, write_run):
    write_run(tmp_path / 'bag', COUNT, flush_every=FLUSH)
    size = (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    first = salvage(
        _cut(tmp_path / 'bag', tmp_path / 'cut', size // 2), tmp_path / 'first')
    second = salvage(tmp_path / 'first', tmp_path / 'second')
    assert second.lost == ()
    assert read(tmp_path / 'second').lost == first.lost
    third = salvage(
        _uncompressed_and_cut(tmp_path / 'second', tmp_path / 'plain'), tmp_path / 'third')
    assert third.lost
    assert read(tmp_path / 'third').lost == (*first.lost, *third.lost)


def _uncompressed_and_cut(bag, directory):
    salvage(bag, directory, compression='none')
    (file,) = directory.glob('*.mcap')
    (chunk,) = _summary(file).chunk_indexes
    os.truncate(file, chunk.chunk_start_offset + chunk.chunk_length - 10)
    return file


def test_zeros_as_a_loss_of_power_leaves_them_are_named(tmp_path, write_run):
    write_run(tmp_path / 'bag', COUNT, flush_every=FLUSH)
    first = _summary(tmp_path / 'bag' / 'bag_0.mcap').chunk_indexes[0]
    file = _cut(tmp_path / 'bag', tmp_path / 'cut', first.chunk_start_offset + first.chunk_length)
    os.truncate(file, file.stat().st_size + 500)
    result = salvage(file, tmp_path / 'output')
    assert '500 bytes' in result.lost[0]
    assert read(tmp_path / 'output').samples == FLUSH


def test_messages_of_an_unknown_type_are_counted_as_lost(tmp_path):
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file, use_chunking=False)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Byte', 'ros2msg', b'byte data')
        known = writer.register_channel('/known', 'cdr', schema, {'offered_qos_profiles': '{'})
        nameless = writer.register_channel('/nameless', 'cdr', 0)
        for channel in (known, nameless, nameless, 77):
            writer.add_message(channel, 5, b'', 6)
        writer.finish()
    result = salvage(tmp_path / 'a.mcap', tmp_path / 'output')
    assert result.messages == {'/known': 1}
    assert '3 messages of an unknown topic or type' in result.lost[0]


def test_a_topic_without_messages_and_foreign_metadata_are_kept(tmp_path):
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        writer.add_metadata('lab', {'operator': 'me'})
        writer.add_attachment(0, 0, 'notes.txt', 'text/plain', b'fine')
        schema = writer.register_schema('std_msgs/msg/Byte', 'ros2msg', b'byte data')
        used = writer.register_channel('/used', 'cdr', schema)
        writer.register_channel('/unused', 'cdr', schema)
        writer.add_message(used, 5, b'', 6)
        writer.finish()
    assert salvage(tmp_path / 'a.mcap', tmp_path / 'output').lost == ()
    with (tmp_path / 'output' / 'output_0.mcap').open('rb') as file:
        reader = make_reader(file)
        (message,) = reader.iter_messages()
        assert (message[2].log_time, message[2].publish_time) == (5, 6)
        topics = {channel.topic for channel in reader.get_summary().channels.values()}
        assert topics == {'/used', '/unused'}
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        assert records['lab'] == {'operator': 'me'}
        assert 'piezo_ros' not in records
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.data) == ('notes.txt', b'fine')


def test_b5_a_salvage_that_fails_leaves_nothing(tmp_path, write_run, monkeypatch):
    write_run(tmp_path / 'bag', 50)
    written = []

    def full(self, *arguments):
        written.append(arguments)
        if len(written) > 100:
            raise BagError('the disk is full')

    monkeypatch.setattr(Rosbag2Writer, 'write', full)
    with pytest.raises(BagError, match='the disk is full'):
        salvage(tmp_path / 'bag', tmp_path / 'output')
    assert [path.name for path in tmp_path.iterdir()] == ['bag']


@pytest.mark.parametrize('time_ns', [2**63, 2**64 - 5])
def test_b5_messages_with_times_that_rosbag2_cannot_hold_are_left_out_and_counted(
    tmp_path, time_ns,
):
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Byte', 'ros2msg', b'byte data')
        channel = writer.register_channel('/byte', 'cdr', schema)
        for time in (5, time_ns, 6, 2**63 - 1):
            writer.add_message(channel, time, b'', time)
        writer.finish()
    result = salvage(tmp_path / 'a.mcap', tmp_path / 'output')
    assert result.messages == {'/byte': 3}
    assert result.lost == ('a.mcap: 1 messages with a log time beyond 2**63 - 1 ns',)
    with AnyReader([tmp_path / 'output']) as reader:
        assert [time for _, time, _ in reader.messages()] == [5, 6, 2**63 - 1]


def test_a8_a_chunk_that_comes_twice_is_kept_once_and_told(tmp_path, write_run):
    write_run(tmp_path / 'bag', COUNT, flush_every=FLUSH)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    index = _summary(file).chunk_indexes[3]
    raw = without_data_checksum(file.read_bytes())
    start, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
    (tmp_path / 'twice.mcap').write_bytes(raw[:end] + raw[start:end] + raw[end:])
    result = salvage(tmp_path / 'twice.mcap', tmp_path / 'output')
    assert result.lost == (f'twice.mcap: {5 * FLUSH} messages that came before, byte by byte',)
    assert read(tmp_path / 'output').samples == COUNT


def test_a8_of_equal_files_one_is_kept_and_the_other_told(tmp_path, write_run):
    write_run(tmp_path / 'bag', COUNT)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    shutil.copy(tmp_path / 'bag' / 'bag_0.mcap', tmp_path / 'bag' / 'bag_1.mcap')
    result = salvage(tmp_path / 'bag', tmp_path / 'output')
    assert 'bag_1.mcap: 2006 messages that came before' in result.lost[0]
    assert read(tmp_path / 'output').samples == COUNT


def test_a8_streams_that_are_not_in_order_after_a_salvage_are_told(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for index in (0, 1, 1, 2):
            writer.write_block('voltage', index, 1e-5, [1.0])
    result = salvage(tmp_path / 'bag', tmp_path / 'output')
    assert 'overlap: index 2 is due, 1 comes again; 2 of 4 samples' in result.lost[0]
