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
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from python_path import python_path
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from piezo_ros.bag import (
    STREAMS,
    BagError,
    BagExistsError,
    BagWriter,
    BlockCodec,
    MalformedBlockError,
    read,
)
from piezo_ros.streams.message_type import TYPE_HASH, TYPE_NAME

COMPRESSIONS = ['zstd', 'lz4', 'none']
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_what_is_written_is_read(tmp_path, write_run, compression):
    samples = write_run(
        tmp_path / 'bag', 50, compression=compression, metadata={'scheme': 'fbff'})
    run = read(tmp_path / 'bag')
    assert run.samples == 50
    assert run.start_index == 0
    assert run.sample_period_s == 1e-5
    assert run.metadata == {'scheme': 'fbff', 'format_version': '1'}
    assert run.parameters == {'/plant': {'seed': 7}}
    assert run.lost == ()
    assert run.streams == tuple(STREAMS)
    np.testing.assert_array_equal(run.time_s, np.arange(50) * 1e-5)
    for stream, unit in STREAMS.items():
        aligned = getattr(run, f'{stream}_{unit}')
        np.testing.assert_array_equal(aligned, samples[stream][:50])
        start, whole = run.whole(stream)
        assert start == 0
        np.testing.assert_array_equal(whole, samples[stream])


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_rosbags_sees_every_sample_of_every_stream(tmp_path, write_run, compression):
    samples = write_run(tmp_path / 'bag', 50, compression=compression)
    seen = {stream: [] for stream in STREAMS}
    with AnyReader([tmp_path / 'bag']) as reader:
        assert reader.message_count == 5 * 51 + 1
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            index, period, *values = message.data
            assert time_ns == round(index * 1e4)
            assert period == 1e-5
            assert message.layout.dim[0].size == len(values)
            seen[connection.topic[1:]] += values
    for stream, values in samples.items():
        np.testing.assert_array_equal(seen[stream], values)


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_mcap_ros2_sees_every_sample_of_every_stream(tmp_path, write_run, compression):
    samples = write_run(tmp_path / 'bag', 50, compression=compression)
    seen = {stream: [] for stream in STREAMS}
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            index, _, *values = decoded.data
            assert message.log_time == message.publish_time == round(index * 1e4)
            seen[channel.topic[1:]] += values
    for stream, values in samples.items():
        np.testing.assert_array_equal(seen[stream], values)


def test_metadata_yaml_has_every_key_of_version_9(tmp_path, write_run, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'a_distribution')
    write_run(tmp_path / 'bag', 20, metadata={'scheme': 'fb'})
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    qos = [{
        'history': 'keep_all',
        'depth': 0,
        'reliability': 'reliable',
        'durability': 'volatile',
        'deadline': {'sec': 9223372036, 'nsec': 854775807},
        'lifespan': {'sec': 9223372036, 'nsec': 854775807},
        'liveliness': 'automatic',
        'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
        'avoid_ros_namespace_conventions': False,
    }]
    assert information == {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': 210_000},  # displacement ends with index 21
        'starting_time': {'nanoseconds_since_epoch': 0},
        'message_count': 106,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': f'/{stream}',
                    'type': 'std_msgs/msg/Float64MultiArray',
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': qos,
                    'type_description_hash': TYPE_HASH,
                },
                'message_count': 22 if stream == 'displacement' else 21,
            }
            for stream in STREAMS
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': ['bag_0.mcap'],
        'files': [{
            'path': 'bag_0.mcap',
            'starting_time': {'nanoseconds_since_epoch': 0},
            'duration': {'nanoseconds': 210_000},
            'message_count': 106,
        }],
        'custom_data': {'scheme': 'fb', 'format_version': '1'},
        'ros_distro': 'a_distribution',
    }
    assert '&' not in text  # no YAML anchors
    assert {file.name for file in (tmp_path / 'bag').iterdir()} == {'bag_0.mcap', 'metadata.yaml'}


def test_the_mcap_file_tells_readers_what_they_need(tmp_path, write_run):
    write_run(tmp_path / 'bag', metadata={'scheme': 'fb'})
    information = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    body = information['rosbag2_bagfile_information']
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        (schema,) = summary.schemas.values()
        assert (schema.name, schema.encoding) == (TYPE_NAME, 'ros2msg')
        for channel in summary.channels.values():
            assert channel.message_encoding == 'cdr'
            assert channel.metadata['topic_type_hash'] == TYPE_HASH
            profiles = yaml.safe_load(channel.metadata['offered_qos_profiles'])
            assert len(profiles[0]) == 9
            assert profiles == (
                body['topics_with_message_count'][0]['topic_metadata']['offered_qos_profiles'])
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        assert records['piezo_ros'].pop('digest').startswith('sha256:')
        assert records['piezo_ros'] == {'scheme': 'fb', 'format_version': '1'}
        assert yaml.safe_load(records['rosbag2']['serialized_metadata']) == body
        (attachment,) = reader.iter_attachments()
        assert attachment.name == 'parameters.yaml'
        assert (attachment.log_time, attachment.create_time) == (0, 0)
        assert summary.statistics.message_count == 106


def test_parameters_and_metadata_stand_before_the_first_message(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        summary = make_reader(file).get_summary()
    first_chunk = summary.chunk_indexes[0].chunk_start_offset
    assert summary.attachment_indexes[0].offset < first_chunk
    assert summary.metadata_indexes[0].offset < first_chunk


def test_the_type_hash_is_that_of_an_independent_implementation():
    assert get_typestore(Stores.ROS2_JAZZY).hash_rihs01(TYPE_NAME) == TYPE_HASH


def test_the_type_hash_is_that_of_the_installed_messages():
    pytest.importorskip('std_msgs')
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    files = [
        Path(prefix, 'share', 'std_msgs', 'msg', 'Float64MultiArray.json') for prefix in prefixes]
    found = [file for file in files if file.is_file()]
    if not found:
        pytest.skip('std_msgs is installed without its share directory')
    hashes = {
        entry['type_name']: entry['hash_string']
        for entry in json.loads(found[0].read_text())['type_hashes']
    }
    assert hashes[TYPE_NAME] == TYPE_HASH


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_the_same_run_gives_the_same_bytes(tmp_path, write_run, compression):
    for parent in ('a', 'b'):
        write_run(tmp_path / parent / 'bag', 300, flush_every=100, compression=compression)
    for name in ('bag_0.mcap', 'metadata.yaml'):
        assert (tmp_path / 'a/bag' / name).read_bytes() == (tmp_path / 'b/bag' / name).read_bytes()


def test_the_channels_do_not_depend_on_what_arrives_first(tmp_path):
    topics = {stream: f'/rig/{stream}' for stream in ('voltage', 'reference', 'displacement')}
    with BagWriter(tmp_path / 'bag', topics=topics) as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        writer.write_block('reference', 0, 1e-5, [1.0])
    with Reader(tmp_path / 'bag') as reader:
        assert [(item.topic, item.msgcount) for item in reader.connections] == [
            ('/rig/reference', 1), ('/rig/voltage', 1), ('/rig/displacement', 0)]


def test_blocks_of_any_size_are_timed_by_their_first_sample(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_block('voltage', 7, 1e-5, np.arange(3.0))
        writer.write('voltage', BlockCodec('voltage').encode(10, 1e-5, np.arange(5.0)))
    with Reader(tmp_path / 'bag') as reader:
        assert [time_ns for _, time_ns, _ in reader.messages()] == [70_000, 100_000]
        assert (reader.start_time, reader.duration) == (70_000, 30_001)


def test_a_bag_without_messages_is_a_bag(tmp_path):
    with BagWriter(tmp_path / 'bag'):
        pass
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 0
    with pytest.raises(BagError, match='no stream'):
        read(tmp_path / 'bag')


def test_a_bag_is_never_overwritten(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    before = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    with pytest.raises(BagExistsError, match='exists') as caught:
        BagWriter(tmp_path / 'bag')
    assert isinstance(caught.value, FileExistsError)
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_bytes() == before


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match='file/bag'):
        BagWriter(tmp_path / 'file' / 'bag')


@pytest.mark.parametrize(('options', 'words'), [
    ({'compression': 'gzip'}, "'gzip'.*zstd, lz4, none"),
    ({'topics': {'speed': '/speed'}}, "'speed'"),
    ({'topics': {'voltage': 'voltage'}}, "'voltage' of 'voltage' must be absolute"),
    ({'topics': {'voltage': '/rig/'}}, "'/rig/' of 'voltage' must be absolute"),
    ({'topics': {'voltage': '/u', 'command': '/u'}}, "'/u' is that of 'voltage' and of 'command'"),
    ({'namespace': 'rig'}, "namespace 'rig' must be / or absolute"),
    ({'metadata': {'topic.voltage': '/u'}}, "'topic.voltage' is the writer's own"),
    ({'metadata': {'namespace': '/rig'}}, "'namespace' is the writer's own"),
    ({'metadata': {'seed': 7}}, "'seed' is 7"),
    ({'metadata': {'format_version': '2'}}, 'format_version'),
])
def test_invalid_arguments_are_refused_before_anything_is_created(tmp_path, options, words):
    with pytest.raises(ValueError, match=words):
        BagWriter(tmp_path / 'bag', **options)
    assert not (tmp_path / 'bag').exists()


def test_close_may_be_called_twice_and_nothing_may_follow(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    writer.write_block('voltage', 0, 1e-5, [1.0])
    writer.close()
    writer.close()
    with pytest.raises(BagError, match='closed'):
        writer.write_block('voltage', 1, 1e-5, [1.0])
    with pytest.raises(BagError, match='closed'):
        writer.flush()
    with pytest.raises(BagError, match='closed'):
        writer.attach_parameters('')
    assert read(tmp_path / 'bag').samples == 1


def test_an_error_of_the_caller_leaves_a_whole_bag(tmp_path):
    def fail():
        with BagWriter(tmp_path / 'bag') as writer:
            writer.write_block('voltage', 0, 1e-5, [1.0])
            raise ZeroDivisionError
    with pytest.raises(ZeroDivisionError):
        fail()
    assert read(tmp_path / 'bag').samples == 1


def test_a_block_that_cannot_be_timed_is_refused_and_the_bag_goes_on(tmp_path):
    codec = BlockCodec('voltage')
    with BagWriter(tmp_path / 'bag', topics={'voltage': '/voltage'}) as writer:
        writer.write_block('voltage', 0, 1e-5, [1.0])
        for raw, words in [
            (b'', 'ends early|encapsulation'),
            (codec.encode(0, 1e-5, [1.0])[:-20], 'ends early'),
            (codec.encode_one(np.nan, 1e-5, 1.0), 'index'),
            (codec.encode_one(1, np.inf, 1.0), 'sample period'),
            (BlockCodec('command').encode_one(1, 1e-5, 1.0), 'command_um'),
        ]:
            with pytest.raises(MalformedBlockError, match=words):
                writer.write('voltage', raw)
        for index in (-1, 2**52):
            with pytest.raises(BagError, match='log time'):
                writer.write_block('voltage', index, 10.0, [1.0])
        with pytest.raises(BagError, match=r"'command'.*voltage"):
            writer.write_block('command', 0, 1e-5, [1.0])
        writer.write_block('voltage', 1, 1e-5, [2.0])
    np.testing.assert_array_equal(read(tmp_path / 'bag').voltage_v, [1.0, 2.0])


def _run_child(script: str, directory: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', script, str(directory)], capture_output=True, text=True,
        check=False, timeout=60, cwd=ROOT, env={**os.environ, 'PYTHONPATH': python_path(ROOT)})


def test_a_killed_recorder_loses_only_what_came_after_its_last_flush(tmp_path):
    child = _run_child("""
import os, signal, sys
from pathlib import Path
from piezo_ros.bag import BagWriter
writer = BagWriter(Path(sys.argv[1]))
writer.attach_parameters('/plant: {ros__parameters: {seed: 7}}')
for index in range(1500):
    if index == 1000:
        writer.flush()
    writer.write_block('voltage', index, 1e-5, [float(index)])
os.kill(os.getpid(), signal.SIGKILL)
""", tmp_path / 'bag')
    assert child.returncode == -9
    with pytest.raises(BagError, match='not closed'):
        read(tmp_path / 'bag')
    run = read(tmp_path / 'bag', allow_loss=True)
    np.testing.assert_array_equal(run.voltage_v, np.arange(1000.0))
    assert run.parameters == {'/plant': {'seed': 7}}
    assert 'not closed' in run.lost[0]


def test_a_full_disk_is_named_and_what_was_flushed_stays_readable(tmp_path):
    # A limit on the size of files gives the same OSError as a full disk, but for its number.
    child = _run_child("""
import resource, signal, sys
from pathlib import Path
from piezo_ros.bag import BagError, BagWriter
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
flushed = 0
try:
    with BagWriter(Path(sys.argv[1]), compression='none') as writer:
        for index in range(0, 100_000, 1000):
            writer.write_block('voltage', index, 1e-5, [float(index)] * 1000)
            writer.flush()
            flushed = index + 1000
except BagError as error:
    print(flushed, error)
for call in (writer.close, writer.close):
    call()
try:
    writer.flush()
except BagError as error:
    print('then', error)
""", tmp_path / 'bag')
    assert child.stderr == ''
    first, second = child.stdout.splitlines()
    flushed, message = first.split(' ', 1)
    assert 'bag_0.mcap' in message
    assert 'piezo bag salvage' in message
    assert 'closed' in second
    run = read(tmp_path / 'bag', allow_loss=True)
    assert 10_000 < int(flushed) <= run.samples
    np.testing.assert_array_equal(run.voltage_v, np.arange(run.samples) // 1000 * 1000)
