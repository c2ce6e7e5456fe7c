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

"""Streams on topics of any name: what the writer says of them, what readers find without it."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from piezo_ros.bag import STREAMS, BagError, BagWriter, BlockCodec, open_recording, read, salvage
from piezo_ros.bag.recorded_topics import remapped_entries
from piezo_ros.streams.message_type import DEFINITION, TYPE_NAME

REMAPPED = {
    **{stream: f'/rig/{stream}' for stream in STREAMS},
    'voltage': '/amplifier/input', 'displacement': '/stage/position'}
# Each is called what the other one is.
MISLEADING = {**REMAPPED, 'voltage': '/rig/command', 'command': '/rig/voltage'}


def write(path, topics, samples, **options):
    with BagWriter(path, topics=topics, **options) as writer:
        for stream in topics:
            values = samples[stream]
            for start in range(0, values.size, 7):
                writer.write_block(stream, start, 1e-5, values[start:start + 7])
            writer.flush()
            writer.write_block(stream, values.size, 1e-5, [])


def renamed(blocks, topics):
    """Give the topics of blocks other names."""
    return [(topics.get(topic, topic), raw) for topic, raw in blocks]


def records_of(path):
    with next(path.glob('*.mcap')).open('rb') as file:
        records = [
            record.metadata for record in make_reader(file).iter_metadata()
            if record.name == 'piezo_ros']
    assert all(record.pop('digest') for record in records)
    return records


def assert_holds(path, samples, **options):
    run = read(path, **options)
    recording = open_recording(path, **options)
    part = recording.part(3, 15)
    assert run.streams == tuple(recording.streams)
    assert set(run.streams) == set(samples)
    for stream, values in samples.items():
        np.testing.assert_array_equal(run.whole(stream)[1], values)
        np.testing.assert_array_equal(part.whole(stream)[1], values[3:15])
    assert recording.namespace == run.namespace
    return run


@pytest.mark.parametrize('topics', [REMAPPED, MISLEADING])
def test_a_bag_says_where_its_streams_are(tmp_path, run_samples, topics):
    samples = run_samples(20)
    write(tmp_path / 'bag', topics, samples, namespace='/rig')
    run = assert_holds(tmp_path / 'bag', samples)
    assert run.namespace == '/rig'
    assert run.topics == tuple(sorted(topics.values()))
    remapped = {
        f'topic.{stream}': name for stream, name in topics.items() if name != f'/rig/{stream}'}
    assert run.metadata == {'namespace': '/rig', **remapped, 'format_version': '1'}
    summary = open_recording(tmp_path / 'bag').streams
    assert {stream: summary[stream].topic for stream in STREAMS} == topics


@pytest.mark.parametrize(('topics', 'namespace', 'expected'), [
    ({'voltage': '/voltage'}, None, {}),
    ({'voltage': '/a/voltage', 'command': '/b/command'}, None, {}),
    ({'voltage': '/a/voltage'}, '/a', {}),
    ({'voltage': '/voltage'}, '/', {}),
    ({'voltage': '/a/voltage'}, '/', {'namespace': '/', 'topic.voltage': '/a/voltage'}),
    ({'voltage': '/a/u'}, None, {'namespace': '/a', 'topic.voltage': '/a/u'}),
    ({'voltage': '/a/b/u', 'command': '/a/command'}, None,
     {'namespace': '/a', 'topic.voltage': '/a/b/u'}),
    ({'voltage': '/u', 'command': '/a/command'}, '/a',
     {'namespace': '/a', 'topic.voltage': '/u'}),
])
def test_the_record_names_what_the_names_do_not_tell(topics, namespace, expected):
    assert remapped_entries(topics, namespace) == expected


def test_an_ordinary_run_has_the_same_bytes_with_its_namespace(tmp_path, run_samples):
    topics = {stream: f'/rig/{stream}' for stream in STREAMS}
    for name, options in [('a', {}), ('b', {'namespace': '/rig'})]:
        write(tmp_path / name / 'bag', topics, run_samples(20), **options)
    for name in ('bag_0.mcap', 'metadata.yaml'):
        assert (tmp_path / 'a/bag' / name).read_bytes() == (tmp_path / 'b/bag' / name).read_bytes()


@pytest.mark.parametrize('topics', [REMAPPED, MISLEADING])
def test_a_cut_bag_is_salvaged_with_its_record(tmp_path, run_samples, topics):
    samples = run_samples(200)
    write(tmp_path / 'bag', topics, samples, namespace='/rig')
    file = next((tmp_path / 'bag').glob('*.mcap'))
    content = file.read_bytes()
    before = records_of(tmp_path / 'bag')
    file.write_bytes(content[:len(content) * 2 // 3])
    saved = salvage(tmp_path / 'bag', tmp_path / 'saved')
    assert set(saved.messages) <= set(topics.values())
    record, = records_of(tmp_path / 'saved')
    assert before[0].items() <= record.items()
    run = read(tmp_path / 'saved', allow_loss=True)
    assert run.namespace == '/rig'
    assert run.streams
    for stream in run.streams:
        start, values = run.whole(stream)
        np.testing.assert_array_equal(values, samples[stream][start:start + values.size])


def test_other_readers_see_every_sample(tmp_path, run_samples):
    samples = run_samples(20)
    write(tmp_path / 'bag', REMAPPED, samples, namespace='/rig')
    seen = {name: [] for name in REMAPPED.values()}
    again = {name: [] for name in REMAPPED.values()}
    with AnyReader([tmp_path / 'bag']) as reader:
        for connection, _, raw in reader.messages():
            seen[connection.topic] += reader.deserialize(raw, connection.msgtype).data[2:].tolist()
    with next((tmp_path / 'bag').glob('*.mcap')).open('rb') as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        for _, channel, _, message in decoded:
            again[channel.topic] += message.data[2:]
    for stream, name in REMAPPED.items():
        np.testing.assert_array_equal(seen[name], samples[stream])
        np.testing.assert_array_equal(again[name], samples[stream])


@pytest.mark.parametrize('order', ['ahead', 'behind'])
def test_the_record_tells_whatever_the_names_say_and_wherever_it_stands(
    tmp_path, run_samples, order,
):
    samples = run_samples(20)
    record = {'format_version': '1', **remapped_entries(MISLEADING, '/rig')}
    with (tmp_path / 'bag.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'another program')
        if order == 'ahead':
            writer.add_metadata('piezo_ros', record)
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        for stream, name in MISLEADING.items():
            channel = writer.register_channel(name, 'cdr', schema)
            writer.add_message(channel, 0, BlockCodec(stream).encode(0, 1e-5, samples[stream]), 0)
        if order == 'behind':
            writer.add_metadata('piezo_ros', record)
        writer.finish()
    assert assert_holds(tmp_path / 'bag.mcap', samples).namespace == '/rig'


def test_a_file_of_several_remapped_rigs_is_read_and_salvaged(tmp_path, run_samples):
    rigs = {
        '/a': {**REMAPPED, 'voltage': '/a/displacement', 'displacement': '/a/voltage'},
        '/b': {stream: f'/b/{stream}_x' for stream in ('command', 'displacement')}}
    rigs['/a'] = {stream: name.replace('/rig', '/a') for stream, name in rigs['/a'].items()}
    samples = {rig: run_samples(20 + number) for number, rig in enumerate(rigs)}
    with (tmp_path / 'bag.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'another program')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        for rig, topics in rigs.items():
            record = {'format_version': '1', **remapped_entries(topics, rig)}
            writer.add_metadata('piezo_ros', record)
            for stream, name in topics.items():
                channel = writer.register_channel(name, 'cdr', schema)
                raw = BlockCodec(stream).encode(0, 1e-5, samples[rig][stream])
                writer.add_message(channel, 0, raw, 0)
        writer.finish()
    salvage(tmp_path / 'bag.mcap', tmp_path / 'saved')
    for path in (tmp_path / 'bag.mcap', tmp_path / 'saved'):
        with pytest.raises(BagError, match='say which: /a, /b$'):
            read(path)
        for rig, topics in rigs.items():
            expected = {stream: samples[rig][stream] for stream in topics}
            assert_holds(path, expected, namespace=rig)


@pytest.mark.parametrize(('names', 'namespace'), [
    # One rig: what its other streams are in.
    ({'/rig/displacement': '/stage/position'}, '/rig'),
    ({'/rig/displacement': '/stage/position', '/rig/voltage': '/rig/amplifier/input'}, '/rig'),
    # Nothing under its own name: what the topics have in common.
    ({f'/rig/{stream}': f'/lab/{stream}/out' for stream in STREAMS}, '/lab'),
    ({f'/rig/{stream}': f'/{stream}_out' for stream in STREAMS}, '/'),
])
def test_labels_tell_the_streams_of_a_foreign_recording(
    tmp_path, run_samples, blocks_of, record_foreign, names, namespace,
):
    samples = run_samples(20)
    record_foreign(tmp_path / 'a.mcap', renamed(blocks_of(samples, 3, prefix='/rig'), names))
    run = assert_holds(tmp_path / 'a.mcap', samples)
    assert run.namespace == namespace
    assert run.metadata == {}
    salvage(tmp_path / 'a.mcap', tmp_path / 'saved')
    assert assert_holds(tmp_path / 'saved', samples).namespace == namespace


def test_other_arrays_are_no_streams(tmp_path, run_samples, blocks_of, record_foreign):
    samples = run_samples(20)
    blocks = renamed(blocks_of(samples, 3, prefix='/rig'), {'/rig/voltage': '/amplifier/input'})
    raw = BlockCodec('command').encode(0, 1e-5, [1.0, 2.0])
    blocks.insert(0, ('/other/label', raw.replace(b'command_um', b'command_mm')))
    # Two numbers ahead of the samples make a block of an array that happens to be labelled so.
    blocks.insert(0, ('/other/layout', raw.replace(
        np.array([2, 2, 2], '<u4').tobytes(), np.array([2, 2, 0], '<u4').tobytes())))
    blocks.insert(0, ('/other/rest', b'\x00\x01\x00\x00'))
    record_foreign(tmp_path / 'a.mcap', blocks)
    run = assert_holds(tmp_path / 'a.mcap', samples)
    assert run.namespace == '/rig'
    assert '/other/layout' in run.topics


def test_a_relay_of_a_stream_is_left_aside(tmp_path, run_samples, blocks_of, record_foreign):
    samples = run_samples(20)
    blocks = blocks_of(samples, 3, prefix='/rig')
    relayed = [
        (to, raw) for topic, raw in blocks if topic == '/rig/voltage'
        for to in ('/rig/voltage_relay', '/slow/u')]
    record_foreign(tmp_path / 'a.mcap', [*relayed, *blocks])
    assert assert_holds(tmp_path / 'a.mcap', samples).namespace == '/rig'
    only = {'voltage': samples['voltage']}
    assert_holds(tmp_path / 'a.mcap', only, namespace='/slow')


@pytest.mark.parametrize('prefix', ['', '/rig'])
@pytest.mark.parametrize('names', [{}, {'voltage': '/amplifier/input'}, {
    stream: f'/x/{stream}_out' for stream in STREAMS}])
def test_copies_for_a_recorder_are_left_aside(
    tmp_path, run_samples, blocks_of, record_foreign, prefix, names,
):
    samples = run_samples(20)
    plain = renamed(
        blocks_of(samples, 1, prefix=prefix),
        {f'{prefix}/{stream}': name for stream, name in names.items()})
    copies = blocks_of(samples, 10, prefix=f'{prefix}/recorded')
    record_foreign(tmp_path / 'a.mcap', [*copies, *plain])
    assert assert_holds(tmp_path / 'a.mcap', samples).namespace == (prefix or '/')
    recording = open_recording(tmp_path / 'a.mcap')
    assert recording.streams['voltage'].topic == names.get('voltage', f'{prefix}/voltage')


def test_copies_alone_and_a_rig_called_so_are_read(
    tmp_path, run_samples, blocks_of, record_foreign,
):
    samples = run_samples(20)
    blocks = blocks_of(samples, 3, prefix='/recorded')
    record_foreign(tmp_path / 'a.mcap', blocks)
    assert assert_holds(tmp_path / 'a.mcap', samples).namespace == '/recorded'
    record_foreign(tmp_path / 'b.mcap', renamed(blocks, {'/recorded/voltage': '/x/u'}))
    assert assert_holds(tmp_path / 'b.mcap', samples).namespace == '/recorded'


def test_what_is_not_clear_is_refused_by_name(tmp_path, run_samples, blocks_of, record_foreign):
    samples = run_samples(20)
    two = [
        block for rig in ('a', 'b') for block in renamed(
            blocks_of(samples, 3, prefix=f'/{rig}'),
            {f'/{rig}/displacement': f'/stage_{rig}/position'})]
    record_foreign(tmp_path / 'two.mcap', two)
    with pytest.raises(BagError, match=(
            r'several namespaces, say which: /a, /b, /stage_a, /stage_b; the names do not tell '
            r'the rig of these: /stage_a/position \(displacement\), '
            r'/stage_b/position \(displacement\)')):
        read(tmp_path / 'two.mcap')
    assert read(tmp_path / 'two.mcap', namespace='/a').streams == tuple(STREAMS)[:-1]
    assert read(tmp_path / 'two.mcap', namespace='/stage_b').streams == ('displacement',)

    one = renamed(blocks_of(samples, 3), {'/displacement': '/left'})
    again = [('/right', raw) for topic, raw in one if topic == '/left']
    record_foreign(tmp_path / 'one.mcap', [*one, *again])
    with pytest.raises(BagError, match="stream 'displacement' .* several topics.*: /left, /right"):
        read(tmp_path / 'one.mcap')


def test_two_rigs_of_which_all_topics_are_remapped_are_told_by_their_namespaces(
    tmp_path, run_samples, blocks_of, record_foreign,
):
    samples, other = run_samples(20), run_samples(30)
    record_foreign(tmp_path / 'a.mcap', [
        (f'{topic}_x', raw)
        for rig, values in [('/a', samples), ('/b', other)]
        for topic, raw in blocks_of(values, 3, prefix=rig)])
    with pytest.raises(BagError, match='several namespaces, say which: /a, /b;'):
        read(tmp_path / 'a.mcap')
    assert_holds(tmp_path / 'a.mcap', samples, namespace='a')
    assert_holds(tmp_path / 'a.mcap', other, namespace='b')
