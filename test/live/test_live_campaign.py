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

"""What the live graph leaves behind: the same bits however it is run, in bags anyone can read."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from processes import busy_processes
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from piezo_ros.bag import STREAMS, read
from piezo_ros.parameters.node_parameters import LOOP_NODES, NODE_PARAMETERS

# Two in a row of the scheme in which all nodes take part.
SCHEMES = ('fb', 'ff', 'open_loop', 'fbff', 'fbff')
# The bags that other readers read; test_kept_graph.py compares runs of every kind.
RUNS = {'separate': SCHEMES[2:4], 'composed': SCHEMES[3:4]}
SAMPLES = 1000
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def plan(write_plan):
    return write_plan(*SCHEMES, periods=3)


@pytest.fixture(scope='module')
def offline(make_rig, plan):
    return _bags(make_rig(), 'simulate', plan)


@pytest.fixture(scope='module')
def separate(make_rig, write_plan):
    return _bags(make_rig(), 'run', write_plan(*RUNS['separate'], periods=3), '--separate')


@pytest.fixture(scope='module')
def composed(make_rig, write_plan):
    return _bags(make_rig(), 'run', write_plan(*RUNS['composed'], periods=3), '--composed')


@pytest.fixture(scope='module')
def kept(make_rig, plan):
    return _bags(make_rig(), 'run', plan, '--keep')


def _bags(rig, command, plan, *options):
    """Do a plan and return its bags in order."""
    process = rig.piezo(command, plan, '-o', rig.directory / 'out', *options)
    assert process.wait(180) == 0, process.output
    return sorted((rig.directory / 'out' / 'bags').iterdir())


def _assert_same_bits(bags, expected):
    assert len(bags) == len(expected)
    for bag, other in zip(bags, expected, strict=True):
        run, other_run = read(bag), read(other)
        assert run.streams == other_run.streams == tuple(STREAMS)
        for stream in STREAMS:
            start, samples = run.whole(stream)
            other_start, other_samples = other_run.whole(stream)
            assert start == other_start
            np.testing.assert_array_equal(
                samples.view(np.uint64), other_samples.view(np.uint64),
                err_msg=f'{stream} of {bag} and {other}')


def test_every_stream_has_all_its_samples(offline):
    for bag in offline:
        run = read(bag)
        assert [run.whole(stream)[1].size for stream in STREAMS] == [*[SAMPLES] * 4, SAMPLES + 1]


def test_the_schemes_differ(offline):
    voltages_v = [read(bag).voltage_v for bag in offline[:4]]
    for i in range(4):
        for j in range(i):
            assert not np.array_equal(voltages_v[i], voltages_v[j])


def test_four_processes_give_the_bits_of_the_offline_simulation(separate, offline):
    _assert_same_bits(separate, offline[2:4])


def test_one_process_gives_the_bits_of_the_offline_simulation(composed, offline):
    _assert_same_bits(composed, offline[3:4])


@pytest.mark.slow  # test_kept_graph.py compares runs of every kind.
def test_a_kept_graph_gives_the_bits_of_the_offline_simulation(kept, offline):
    _assert_same_bits(kept, offline)


@pytest.mark.slow
def test_a_loaded_machine_gives_the_same_bits(rig, write_plan, offline):
    with busy_processes(2):
        bags = _bags(rig, 'run', write_plan('fbff', periods=3), '--separate')
    _assert_same_bits(bags, offline[3:4])


def test_two_rigs_at_once_in_one_domain_do_not_disturb_each_other(rig, write_plan, offline):
    plan = write_plan('fbff', periods=3)
    processes = [
        rig.piezo('run', plan, '-o', rig.directory / name, '--composed', '--default-namespace')
        for name in ('a', 'b')]
    for process in processes:
        assert process.wait(180) == 0, process.output
    for name in ('a', 'b'):
        _assert_same_bits(list((rig.directory / name / 'bags').iterdir()), offline[3:4])


@pytest.mark.parametrize(('processes', 'number'), [
    *(('separate', number) for number in range(2)), ('composed', 0)])
def test_rosbags_and_mcap_ros2_see_every_sample_of_a_live_run(request, processes, number):
    bag = request.getfixturevalue(processes)[number]
    run = read(bag)
    by_rosbags = {stream: [] for stream in STREAMS}
    by_mcap = {stream: [] for stream in STREAMS}
    with Reader(bag) as reader:
        store = get_typestore(Stores.ROS2_JAZZY)
        for connection, _, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            _append(by_rosbags, connection.topic, message)
    with (bag / f'{bag.name}_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for _, channel, _, message in reader.iter_decoded_messages():
            _append(by_mcap, channel.topic, message)
    for stream in STREAMS:
        samples = run.whole(stream)[1]
        assert samples.size >= SAMPLES
        np.testing.assert_array_equal(by_rosbags[stream], samples)
        np.testing.assert_array_equal(by_mcap[stream], samples)


def _append(streams, topic, message):
    samples = streams[topic.rpartition('/')[2]]
    index, _, *values = message.data
    assert index == len(samples)
    samples += values


@pytest.mark.parametrize('processes', ['separate', 'composed'])
def test_the_bag_names_its_run(request, processes):
    bags = request.getfixturevalue(processes)
    for bag, scheme in zip(bags, RUNS[processes], strict=True):
        with (bag / f'{bag.name}_0.mcap').open('rb') as file:
            records = {
                record.name: record.metadata for record in make_reader(file).iter_metadata()}
        metadata = records['piezo_ros']
        described = {
            'format_version': '1', 'scheme': scheme, 'waveform': 'triangle',
            'amplitude_um': '1.0', 'frequency_hz': '300.0', 'harmonics': '9', 'periods': '3.0',
            'sample_period_s': '1e-05', 'seed': '1'}
        assert described.items() <= metadata.items()
        assert {'version.numpy', 'version.rclpy', 'version.mcap'} <= metadata.keys()


@pytest.mark.parametrize('processes', ['separate', 'composed'])
def test_the_bag_holds_the_parameters_of_every_node(request, processes):
    rig_file = yaml.safe_load((ROOT / 'config' / 'rig.yaml').read_text())
    rig_file = rig_file['/**/plant']['ros__parameters']
    bags = request.getfixturevalue(processes)
    for bag, scheme in zip(bags, RUNS[processes], strict=True):
        with (bag / f'{bag.name}_0.mcap').open('rb') as file:
            (attachment,) = make_reader(file).iter_attachments()
        nodes = {
            name.rpartition('/')[2]: section['ros__parameters']
            for name, section in yaml.safe_load(attachment.data).items()}
        assert nodes.keys() == set(LOOP_NODES)
        for node in LOOP_NODES:
            for parameter_set in NODE_PARAMETERS[node]:
                assert parameter_set().to_mapping().keys() <= nodes[node].keys()
        assert nodes['controller']['scheme'] == scheme
        assert nodes['plant']['gain_mismatch'] == rig_file['gain_mismatch']
        assert len(nodes['compensator']['kappa_um_per_v']) == 11


@pytest.mark.parametrize('processes', ['separate', 'composed'])
def test_the_report_has_one_record_for_every_run(request, processes):
    bags = request.getfixturevalue(processes)
    report = json.loads((bags[0].parents[1] / 'report.json').read_text())
    assert [(run['scheme'], run['samples']) for run in report['runs']] == [
        (scheme, SAMPLES) for scheme in RUNS[processes]]
    assert [run['bag'] for run in report['runs']] == [f'bags/{bag.name}' for bag in bags]
    assert all(run['wall_seconds'] > 0.0 for run in report['runs'])
