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

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read, salvage

TYPE = 'std_msgs/msg/Float64MultiArray'


def _assert_holds(run, samples, count):
    assert run.samples == count
    for stream, unit in STREAMS.items():
        np.testing.assert_array_equal(getattr(run, f'{stream}_{unit}'), samples[stream][:count])
        np.testing.assert_array_equal(run.whole(stream)[1], samples[stream])


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
@pytest.mark.parametrize('layout', [
    {}, {'chunk_size': 1000}, {'indexed': False}, {'chunked': False}, {'crcs': True},
])
@pytest.mark.parametrize('size', [1, 7])
def test_a_recording_of_rosbag2_is_read(
    tmp_path, record_foreign, blocks_of, run_samples, compression, layout, size,
):
    samples = run_samples(200)
    record_foreign(
        tmp_path / 'a.mcap', blocks_of(samples, size), compression=compression, **layout)
    run = read(tmp_path / 'a.mcap')
    _assert_holds(run, samples, 200)
    assert run.metadata == {}
    assert run.parameters == {}
    assert run.lost == ()


@pytest.mark.parametrize('compression', [CompressionMode.NONE, CompressionMode.STORAGE])
@pytest.mark.parametrize('little_endian', [True, False])
def test_a_bag_of_the_rosbags_library_is_read(tmp_path, run_samples, compression, little_endian):
    store = get_typestore(Stores.ROS2_JAZZY)
    dimension = store.types['std_msgs/msg/MultiArrayDimension']
    layout = store.types['std_msgs/msg/MultiArrayLayout']
    samples = run_samples(100)
    writer = RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        for stream, values in samples.items():
            connection = writer.add_connection(f'/{stream}', TYPE, typestore=store)
            label = f'{stream}_{STREAMS[stream]}'
            for first in range(0, values.size, 10):
                part = values[first:first + 10]
                message = store.types[TYPE](
                    layout=layout(
                        dim=[dimension(label=label, size=part.size, stride=part.size)],
                        data_offset=2),
                    data=np.concatenate(([first, 1e-5], part)))
                raw = store.serialize_cdr(message, TYPE, little_endian=little_endian)
                writer.write(connection, 1_700_000_000_000_000_000 + first, raw)
    _assert_holds(read(tmp_path / 'bag'), samples, 100)


def test_garbage_in_the_padding_of_typed_publishers_does_not_matter(
    tmp_path, record_foreign, blocks_of, run_samples,
):
    samples = run_samples(50)
    blocks = []
    for number, (topic, raw) in enumerate(blocks_of(samples)):
        dirty = bytearray(raw)
        label_end = 12 + int.from_bytes(raw[8:12], 'little')
        for place in range(label_end, label_end + -(label_end - 4) % 4):
            dirty[place] = number % 251 + 1
        for place in (2, 3):
            dirty[place] = number % 3
        blocks.append((topic, bytes(dirty)))
    assert sum(dirty != clean for (_, dirty), (_, clean) in zip(
        blocks, blocks_of(samples), strict=True)) > 100
    record_foreign(tmp_path / 'a.mcap', blocks)
    _assert_holds(read(tmp_path / 'a.mcap'), samples, 50)


def test_streams_are_paired_by_index_whatever_their_blocks(tmp_path):
    values = np.arange(100.0)
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('reference', 20, 1e-3, values[20:])
        for first, stop in [(0, 30), (30, 31), (31, 32), (32, 70)]:
            writer.write_block('voltage', first, 1e-3, values[first:stop])
        writer.write_block('displacement', 10, 1e-3, values[10:90])
    run = read(tmp_path / 'bag')
    assert (run.start_index, run.samples) == (20, 50)
    for aligned in (run.reference_um, run.voltage_v, run.displacement_um):
        np.testing.assert_array_equal(aligned, values[20:70])
    np.testing.assert_array_equal(run.time_s, np.arange(20, 70) * 1e-3)
    assert run.whole('displacement')[0] == 10
    np.testing.assert_array_equal(run.whole('displacement')[1], values[10:90])


def test_a_missing_stream_is_named_with_the_topics_there_are(tmp_path):
    topics = {'voltage': '/rig/voltage', 'displacement': '/rig/displacement'}
    with BagWriter(tmp_path / 'bag', topics=topics) as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        writer.write_block('displacement', 0, 1e-5, [1.0, 2.0])
    run = read(tmp_path / 'bag')
    assert run.streams == ('voltage', 'displacement')
    with pytest.raises(BagError, match="'reference'.*/rig/displacement, /rig/voltage"):
        _ = run.reference_um


def test_a_stream_of_nothing_but_its_end_is_missing(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('feedforward', 0, 1e-5, [])
        writer.write_block('voltage', 0, 1e-5, [1.0])
    run = read(tmp_path / 'bag')
    assert run.streams == ('voltage',)
    assert run.samples == 1


def test_extra_topics_are_ignored(tmp_path, record_foreign, blocks_of, run_samples):
    samples = run_samples(10)
    blocks = blocks_of(samples)
    foreign = BlockCodec('voltage').encode(5, 1.0, [1.0])
    blocks[3:3] = [
        ('/status', b'\0\1\0\0\3\0\0\0{}\0'), ('/spectrum', foreign), ('/other/status', b'')]
    record_foreign(tmp_path / 'a.mcap', blocks)
    run = read(tmp_path / 'a.mcap')
    _assert_holds(run, samples, 10)
    assert '/spectrum' in run.topics


def test_of_two_rigs_one_must_be_chosen(tmp_path, record_foreign, blocks_of, run_samples):
    samples = run_samples(10)
    other = {stream: values + 1.0 for stream, values in samples.items()}
    record_foreign(
        tmp_path / 'a.mcap', blocks_of(samples, prefix='/lab/left') + blocks_of(other))
    with pytest.raises(BagError, match='/, /lab/left'):
        read(tmp_path / 'a.mcap')
    with pytest.raises(BagError, match='namespace /right, choices are /, /lab/left'):
        read(tmp_path / 'a.mcap', namespace='right')
    run = read(tmp_path / 'a.mcap', namespace='/lab/left')
    assert run.namespace == '/lab/left'
    _assert_holds(run, samples, 10)
    _assert_holds(read(tmp_path / 'a.mcap', namespace='lab/left/'), samples, 10)
    _assert_holds(read(tmp_path / 'a.mcap', namespace='/'), other, 10)


def _blocks(*parts):
    return [(index, 1e-5, samples) for index, samples in parts]


DAMAGE = [
    (_blocks((0, [1.0, 2.0]), (3, [3.0])), 2, "'voltage' has a gap: index 2 is due, 3 comes"),
    (_blocks((0, [1.0]), (1, [2.0]), (1, [2.0])), 2, "'voltage' has an overlap: index 2 .* 1 "),
    (_blocks((0, [1.0]), (1, []), (1, [2.0])), 1, "'voltage' goes on at index 1 after its end"),
    (_blocks((0, [1.0, 2.0]), (5, [])), 2, 'index 2 is due, 5 comes'),
    ([(0, 1e-5, [1.0]), (1, 2e-5, [2.0])], 1, 'from 1e-05 s to 2e-05 s at index 1'),
    ([(0, 1e-5, [1.0]), (1, np.nan, [2.0])], 1, 'sample period nan s at index 1'),
    ([(0, 1e-5, [1.0]), (1, -1.0, [2.0])], 1, 'sample period -1.0 s at index 1'),
    ([(7, 1e-5, [1.0]), (8.5, 1e-5, [2.0])], 1, "'voltage' has a block with index 8.5"),
    (_blocks((7, [1.0, 2.0]), (9, [3.0, np.nan, 4.0])), 3, "sample 10 of stream 'voltage' is nan"),
    (_blocks((7, [1.0]), (8, [-np.inf])), 1, "sample 8 of stream 'voltage' is -inf"),
]


@pytest.mark.parametrize(('blocks', 'kept', 'words'), DAMAGE)
def test_damage_is_refused_by_name_or_its_leading_part_kept(
    tmp_path, record_foreign, blocks, kept, words,
):
    codec = BlockCodec('voltage')
    record_foreign(
        tmp_path / 'a.mcap',
        [('/voltage', codec.encode(*block)) for block in blocks])
    with pytest.raises(BagError, match=words):
        read(tmp_path / 'a.mcap')
    run = read(tmp_path / 'a.mcap', allow_loss=True)
    assert len(run.lost) == 1
    everything = np.concatenate([samples for _, _, samples in blocks])
    np.testing.assert_array_equal(run.voltage_v, everything[:kept])


def test_a_malformed_message_is_named_and_what_is_before_it_kept(tmp_path, record_foreign):
    codec = BlockCodec('voltage')
    raws = [codec.encode_one(index, 1e-5, 1.0) for index in range(5)]
    raws[3] = BlockCodec('command').encode_one(3, 1e-5, 1.0)
    record_foreign(tmp_path / 'a.mcap', [('/voltage', raw) for raw in raws])
    with pytest.raises(BagError, match=r"message 3 of stream 'voltage'.*command_um"):
        read(tmp_path / 'a.mcap')
    assert read(tmp_path / 'a.mcap', allow_loss=True).samples == 3


@pytest.mark.parametrize('end', [103, 3])
def test_the_end_of_a_stream_from_the_middle_may_count_either_way(tmp_path, end):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 100, 1e-5, [1.0, 2.0, 3.0])
        writer.write_block('voltage', end, 1e-5, [])
    run = read(tmp_path / 'bag')
    assert (run.start_index, run.samples) == (100, 3)


def test_streams_of_different_sample_periods_are_refused(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        writer.write_block('command', 0, 2e-5, [1.0])
    with pytest.raises(BagError, match="'voltage' is 1e-05 s, that of 'command' is 2e-05 s"):
        read(tmp_path / 'bag', allow_loss=True)


def test_streams_without_a_common_sample_are_refused(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        writer.write_block('command', 5, 1e-5, [1.0])
    with pytest.raises(BagError, match='no sample is common.*command 5 … 5, voltage 0 … 0'):
        read(tmp_path / 'bag')


@pytest.mark.parametrize('version', ['2', None])
def test_another_format_version_is_refused_by_name(tmp_path, version):
    record = {} if version is None else {'format_version': version}
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        writer.add_metadata('piezo_ros', record)
        writer.finish()
    with pytest.raises(BagError, match=f"format_version {version!r}.*reads '1'"):
        read(tmp_path / 'a.mcap', allow_loss=True)


def test_a_bag_split_into_files_is_read_in_order(tmp_path, write_split):
    values = write_split(tmp_path / 'bag', 11)
    np.testing.assert_array_equal(read(tmp_path / 'bag').voltage_v, values)
    (tmp_path / 'bag' / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: '
        '[bag_3.mcap, bag_4.mcap]}')
    np.testing.assert_array_equal(read(tmp_path / 'bag').voltage_v, values[30:50])


def test_a_missing_file_of_a_bag_is_named(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    (tmp_path / 'bag' / 'bag_0.mcap').unlink()
    with pytest.raises(BagError, match='bag_0.mcap'):
        read(tmp_path / 'bag')


def test_a_bag_without_its_metadata_yaml_is_read(tmp_path, write_run):
    samples = write_run(tmp_path / 'bag', 30)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    _assert_holds(read(tmp_path / 'bag'), samples, 30)


def test_another_storage_is_refused_by_name(tmp_path):
    with RosbagsWriter(
        tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3,
    ) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        writer.add_connection('/voltage', TYPE, typestore=store)
    with pytest.raises(BagError, match='sqlite3.*ros2 bag convert'):
        read(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match='bag.db3'):
        read(tmp_path / 'bag')


def test_compression_by_rosbag2_itself_is_refused_by_name(tmp_path):
    writer = RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        writer.add_connection('/voltage', TYPE, typestore=get_typestore(Stores.ROS2_JAZZY))
    with pytest.raises(BagError, match='compression_mode file.*ros2 bag convert'):
        read(tmp_path / 'bag')


def test_what_is_no_bag_is_refused_by_name(tmp_path):
    with pytest.raises(BagError, match='there is no bag .*absent'):
        read(tmp_path / 'absent')
    with pytest.raises(BagError, match=r'no \*.mcap file'):
        read(tmp_path)
    (tmp_path / 'empty.mcap').write_bytes(b'')
    with pytest.raises(BagError, match='empty.mcap is no MCAP file'):
        read(tmp_path / 'empty.mcap')


def test_a_flipped_bit_in_a_chunk_is_noticed(tmp_path, write_run):
    write_run(tmp_path / 'bag', 400, compression='none', flush_every=100)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 1
    file.write_bytes(raw)
    with pytest.raises(BagError, match='checksum'):
        read(tmp_path / 'bag')
    run = read(tmp_path / 'bag', allow_loss=True)
    assert 0 < run.samples < 400
    assert any('checksum' in sentence for sentence in run.lost)


def test_a_flipped_bit_in_the_parameters_is_noticed(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes().replace(b'seed: 7', b'seed: 8', 1))
    with pytest.raises(BagError, match='attachment with a wrong checksum'):
        read(tmp_path / 'bag')
    assert read(tmp_path / 'bag', allow_loss=True).parameters == {}


def test_an_unknown_compression_of_chunks_is_refused_by_name(tmp_path, write_run):
    write_run(tmp_path / 'bag', compression='zstd')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes().replace(b'\4\0\0\0zstd', b'\4\0\0\0zip9'))
    with pytest.raises(BagError, match="'zip9' is none of zstd, lz4 and none"):
        read(tmp_path / 'bag')


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_a_chunk_that_does_not_decompress_is_noticed(tmp_path, write_run, compression):
    write_run(tmp_path / 'bag', 400, flush_every=200, compression=compression)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    magic = {'zstd': b'\x28\xb5\x2f\xfd', 'lz4': b'\x04\x22\x4d\x18'}[compression]
    raw = file.read_bytes()
    second = raw.index(magic, raw.index(magic) + 1)
    file.write_bytes(raw[:second] + bytes(8) + raw[second + 8:])
    with pytest.raises(BagError, match='does not decompress'):
        read(tmp_path / 'bag')
    assert read(tmp_path / 'bag', allow_loss=True).samples == 200


@pytest.mark.parametrize('text', ['/plant: 3', '- 1', '{', '/plant: {parameters: {a: 1}}'])
def test_parameters_that_are_no_parameter_file_are_refused(tmp_path, text):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.attach_parameters(text)
        writer.write_block('voltage', 0, 1e-5, [1.0])
    with pytest.raises(BagError, match='parameters.yaml is no ROS parameter file'):
        read(tmp_path / 'bag')


@pytest.mark.parametrize('entry', [b'seed', b'format_version', b'scheme'])
def test_a11_a_flipped_byte_in_the_metadata_is_noticed(tmp_path, write_run, entry):
    write_run(tmp_path / 'bag', metadata={'seed': '7', 'scheme': 'fb'})
    file = tmp_path / 'bag' / 'bag_0.mcap'
    raw = bytearray(file.read_bytes())
    value = raw.index(entry) + len(entry) + 4
    raw[value] ^= 1
    file.write_bytes(raw)
    with pytest.raises(BagError, match='1 metadata records of piezo_ros with a wrong digest'):
        read(tmp_path / 'bag')
    run = read(tmp_path / 'bag', allow_loss=True)
    assert run.samples == 20
    assert run.metadata == {}
    assert salvage(tmp_path / 'bag', tmp_path / 'whole').lost == run.lost
    assert 'seed' not in read(tmp_path / 'whole').metadata


@pytest.mark.parametrize(('opcode', 'words'), [
    (0x0C, '1 of 2 metadata records are missing'), (0x09, '1 of 1 attachments are missing')])
def test_a11_a_record_that_has_become_another_is_missed(tmp_path, write_run, opcode, words):
    write_run(tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    raw = bytearray(file.read_bytes())
    position = 8
    while raw[position] != opcode:
        position += 9 + int.from_bytes(raw[position + 1:position + 9], 'little')
    raw[position] = 0x80
    file.write_bytes(raw)
    with pytest.raises(BagError, match=words):
        read(tmp_path / 'bag')


def test_a_record_without_digest_is_read(tmp_path):
    with (tmp_path / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        writer.add_metadata('piezo_ros', {'format_version': '1', 'seed': '7'})
        schema = writer.register_schema(TYPE, 'ros2msg', b'')
        channel = writer.register_channel('/voltage', 'cdr', schema)
        writer.add_message(channel, 0, BlockCodec('voltage').encode_one(0, 1e-5, 1.0), 0)
        writer.finish()
    assert read(tmp_path / 'a.mcap').metadata == {'format_version': '1', 'seed': '7'}


@pytest.mark.parametrize('other', [
    np.nextafter(1e-3, 1), np.nextafter(1e-3, 0), 1e-3 * (1 + 1e-12), 1e-3 * (1 - 9e-10)])
def test_b6_sample_periods_that_differ_by_rounding_are_one(tmp_path, record_foreign, other):
    blocks = [
        (f'/{stream}', BlockCodec(stream).encode(
            100 * number, other if (number + shift) % 2 else 1e-3, np.full(100, float(number))))
        for number in range(40) for shift, stream in enumerate(('voltage', 'displacement'))]
    record_foreign(tmp_path / 'a.mcap', blocks, chunk_size=3000)
    run = read(tmp_path / 'a.mcap')
    assert (run.samples, run.sample_period_s, run.lost) == (4000, run.sample_period_s, ())
    part = open_recording(tmp_path / 'a.mcap').part(150, 2000)
    np.testing.assert_array_equal(part.voltage_v, run.voltage_v[150:2000])


def test_b7_how_many_samples_a_problem_costs_is_told(tmp_path, record_foreign):
    codec = BlockCodec('voltage')
    record_foreign(tmp_path / 'a.mcap', [
        ('/voltage', codec.encode(100 * number, 1e-3 if number % 2 == 0 else 1.001e-3, [1.0] * 100))
        for number in range(40)], chunk_size=3000)
    run = read(tmp_path / 'a.mcap', allow_loss=True)
    assert run.samples == 100
    (loss,) = run.lost
    assert loss.endswith('; 3900 of 4000 samples of this stream are left out')
    assert open_recording(tmp_path / 'a.mcap', allow_loss=True).lost == run.lost
