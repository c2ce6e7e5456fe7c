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

"""A9: a bag that is not complete says so, even where every record that is left is whole."""

import shutil
import struct

import numpy as np
import pytest
import yaml
from mcap.writer import Writer
from mcap_mutations import without_data_checksum

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read, salvage
from piezo_ros.cli.main import main
from piezo_ros.streams.message_type import DEFINITION, TYPE_NAME

PERIOD_S = 1e-3


def _write(directory, lengths, *, end=True, flush_every=0):
    """Write streams of some lengths in blocks of one sample."""
    topics = {stream: f'/{stream}' for stream in lengths}
    with BagWriter(directory, topics=topics) as writer:
        for index in range(max(lengths.values())):
            for stream, length in lengths.items():
                if index < length:
                    writer.write_block(stream, index, PERIOD_S, [float(index)])
            if flush_every and (index + 1) % flush_every == 0:
                writer.flush()
        for stream, length in lengths.items():
            if end:
                writer.write_block(stream, length, PERIOD_S, [])


def _info(capsys, path):
    code = main(['bag', 'info', str(path)])
    return code, capsys.readouterr().err


def _records(raw):
    """Return opcode and bytes of each record between the magics."""
    position, records = 8, []
    while position < len(raw) - 8:
        end = position + 9 + struct.unpack_from('<Q', raw, position + 1)[0]
        records.append((raw[position], raw[position:end]))
        position = end
    return records


def _rearranged(path, order, *, with_summary=True):
    """Put the chunks of a file, with the message indices behind each, into another order."""
    raw = without_data_checksum(path.read_bytes())
    records = _records(raw)
    chunks, before, behind = [], [], []
    for opcode, record in records:
        if opcode == 0x06:
            chunks.append(record)
        elif opcode == 0x07:
            chunks[-1] += record
        else:
            (behind if chunks else before).append(record)
    if not with_summary:
        behind = []
    path.write_bytes(raw[:8] + b''.join([
        *before, *(chunks[number - 1] for number in order if number <= len(chunks)), *behind,
    ]) + (raw[-8:] if with_summary else b''))


@pytest.mark.parametrize(('lengths', 'words'), [
    ({'voltage': 60, 'displacement': 181}, "samples 60 … 179 of stream 'voltage' are missing"),
    ({'voltage': 180, 'displacement': 100},
     "samples 100 … 180 of stream 'displacement' are missing"),
    ({'voltage': 180, 'command': 179, 'displacement': 181},
     "samples 179 … 179 of stream 'command' are missing"),
])
def test_a9_streams_of_unequal_length_are_told(tmp_path, capsys, lengths, words):
    _write(tmp_path / 'bag', lengths)
    code, said = _info(capsys, tmp_path / 'bag')
    assert code == 3
    assert words in said
    assert read(tmp_path / 'bag').lost == ()  # what is common is whole


def test_a9_the_displacement_has_one_sample_more(tmp_path, capsys):
    _write(tmp_path / 'bag', {'voltage': 180, 'displacement': 181})
    assert _info(capsys, tmp_path / 'bag') == (0, '')
    _write(tmp_path / 'equal', {'voltage': 180, 'displacement': 180}, end=False)
    assert _info(capsys, tmp_path / 'equal') == (0, '')


def test_a9_a_stream_that_begins_late_is_told(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 0, PERIOD_S, np.zeros(10))
        writer.write_block('displacement', 4, PERIOD_S, np.zeros(7))
    code, said = _info(capsys, tmp_path / 'bag')
    assert code == 3
    assert "samples 0 … 3 of stream 'displacement' are missing" in said


def test_a9_a_chunk_that_is_gone_is_told_by_the_statistics(tmp_path):
    _write(tmp_path / 'bag', {'voltage': 180, 'displacement': 181}, end=False, flush_every=60)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    _rearranged(file, [1, 2])
    alone = tmp_path / 'alone.mcap'
    shutil.copy(file, alone)
    with pytest.raises(BagError, match='60 of 180 messages of /voltage are missing, as the stat'):
        read(alone)
    run = open_recording(alone, allow_loss=True)
    assert run.samples == 120
    assert any('61 of 181 messages of /displacement are missing' in loss for loss in run.lost)


def test_a9_a_chunk_that_is_gone_is_told_by_metadata_yaml(tmp_path):
    _write(tmp_path / 'bag', {'voltage': 180, 'displacement': 181}, end=False, flush_every=60)
    _rearranged(tmp_path / 'bag' / 'bag_0.mcap', [1, 2], with_summary=False)
    run = open_recording(tmp_path / 'bag', allow_loss=True)
    assert (
        '60 of 180 messages of /voltage are missing, as metadata.yaml counts them' in run.lost)
    assert salvage(tmp_path / 'bag', tmp_path / 'whole').lost


@pytest.mark.parametrize('with_summary', [True, False])
def test_a9_chunks_in_another_order_are_read_as_far_as_they_follow_and_told(
    tmp_path, capsys, with_summary,
):
    _write(tmp_path / 'bag', {'voltage': 180, 'displacement': 181}, end=False, flush_every=60)
    _rearranged(
        tmp_path / 'bag' / 'bag_0.mcap', [2, 3, 4, 1], with_summary=with_summary)
    with pytest.raises(BagError, match='overlap' if with_summary else 'was not closed'):
        read(tmp_path / 'bag')
    run = read(tmp_path / 'bag', allow_loss=True)
    assert (run.start_index, run.samples) == (60, 120)
    code, said = _info(capsys, tmp_path / 'bag')
    assert code == 3
    assert "stream 'voltage' has an overlap: index 180 is due, 0 comes again" in said
    assert '60 of 180 samples of this stream are left out' in said
    assert salvage(tmp_path / 'bag', tmp_path / 'whole').lost


def test_a9_messages_of_a_channel_without_record_are_counted(tmp_path):
    codec = BlockCodec('voltage')
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        channel = writer.register_channel('/voltage', 'cdr', schema)
        for index in range(3):
            writer.add_message(channel, index, codec.encode_one(index, PERIOD_S, 1.0), index)
        writer.add_message(77, 5, b'', 5)
        writer.finish()
    with pytest.raises(BagError, match='1 messages of channel 77, of which no record tells'):
        read(tmp_path / 'a.mcap')
    assert read(tmp_path / 'a.mcap', allow_loss=True).samples == 3


def test_a9_of_a_lost_first_chunk_the_channels_come_from_the_summary(tmp_path):
    _write(tmp_path / 'bag', {'voltage': 180, 'displacement': 181}, flush_every=60)
    _rearranged(tmp_path / 'bag' / 'bag_0.mcap', [2, 3, 4])
    run = read(tmp_path / 'bag', allow_loss=True)
    assert (run.start_index, run.samples) == (60, 120)
    assert any('60 of 181 messages of /voltage are missing' in loss for loss in run.lost)
    result = salvage(tmp_path / 'bag', tmp_path / 'whole')
    assert result.messages['/voltage'] == 121
    assert result.lost


def test_a_whole_bag_and_counts_of_less_than_there_is_are_no_loss(tmp_path):
    _write(tmp_path / 'bag', dict.fromkeys(STREAMS, 20))
    file = tmp_path / 'bag' / 'metadata.yaml'
    content = yaml.safe_load(file.read_text())
    for entry in content['rosbag2_bagfile_information']['topics_with_message_count']:
        entry['message_count'] = 1
    file.write_text(yaml.safe_dump(content))
    assert read(tmp_path / 'bag').lost == ()


@pytest.mark.parametrize('counts', [
    5, [5], [{}], [{'topic_metadata': 5}], [{'topic_metadata': {'name': []}, 'message_count': 1}],
    [{'topic_metadata': {'name': '/voltage'}, 'message_count': 'many'}]])
def test_counts_of_another_form_are_ignored(tmp_path, counts):
    _write(tmp_path / 'bag', {'voltage': 20})
    file = tmp_path / 'bag' / 'metadata.yaml'
    content = yaml.safe_load(file.read_text())
    content['rosbag2_bagfile_information']['topics_with_message_count'] = counts
    file.write_text(yaml.safe_dump(content))
    assert read(tmp_path / 'bag').samples == 20
