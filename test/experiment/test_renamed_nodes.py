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

"""Runs of nodes of any name, on topics of any name, from bag to results."""

import numpy as np
import pytest

from piezo_ros.bag import STREAMS, BagError, BagWriter, open_recording, read, salvage
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.recorded_response import recorded_response
from piezo_ros.experiment.run_replay import replay
from piezo_ros.model import RigParameters
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.parameters.provenance import run_metadata
from piezo_ros.parameters.roles import parameters_by_role

NAMES = {
    'plant': 'stage1', 'controller': 'plant', 'compensator': 'inverse', 'trajectory': 'scan'}
TOPICS = {
    **{stream: f'/rig/{stream}' for stream in STREAMS},
    'voltage': '/amplifier/input', 'displacement': '/stage/position'}


@pytest.fixture
def planned(write_plan):
    return read_plan(write_plan(runs=[{
        'scheme': 'fbff', 'amplitude_um': 2.5, 'frequency_hz': 700.0, 'periods': 5,
        'plant': {'seed': 7}}])).runs[0]


@pytest.fixture
def plain(planned, tmp_path):
    simulate_run(planned, tmp_path / 'plain')
    return read(tmp_path / 'plain')


def write_renamed(path, run, planned, *, parameters=None):
    """Write a run as a recorder would that saw renamed nodes and remapped topics."""
    nodes = parameters or {NAMES[role]: planned.parameters[role] for role in planned.nodes}
    with BagWriter(
        path, topics=TOPICS, namespace='/rig', metadata=run_metadata(parameters_by_role(nodes)),
    ) as writer:
        writer.attach_parameters(parameters_yaml('/rig', nodes))
        for stream in run.streams:
            start, values = run.whole(stream)
            writer.write_block(stream, start, run.sample_period_s, values)
            writer.write_block(stream, values.size, run.sample_period_s, [])


def test_a_run_of_renamed_nodes_and_remapped_topics_is_replayed_bit_by_bit(
    plain, planned, tmp_path,
):
    write_renamed(tmp_path / 'bag', plain, planned)
    run = read(tmp_path / 'bag')
    assert {'/rig/stage1', '/rig/plant', '/rig/inverse', '/rig/scan'} == set(run.parameters)
    assert run.metadata.items() >= plain.metadata.items()
    result = replay(run)
    assert result.is_faithful
    assert result.assumed == {}
    for stream, again in zip(plain.streams, result.streams, strict=True):
        assert plain.whole(stream)[1].tobytes() == again.tobytes(), stream
    other = replay(run, controller={'proportional_gain': 0.1})
    assert not np.array_equal(other.streams.voltage_v, run.voltage_v)
    assert other.is_faithful


def test_the_parameters_of_a_renamed_node_are_found(plain, planned, tmp_path):
    write_renamed(tmp_path / 'bag', plain, planned)
    run = read(tmp_path / 'bag')
    assert recorded_parameters(run, 'trajectory', TrajectoryParameters) == planned.trajectory
    assert recorded_parameters(run, 'controller', ControllerParameters) == planned.controller
    assert recorded_parameters(run, 'plant', RigParameters) == planned.plant
    assert recorded_node(open_recording(tmp_path / 'bag'), 'plant')['seed'] == 7
    assert recorded_node(run, 'recorder', anywhere=True) is None
    salvage(tmp_path / 'bag', tmp_path / 'saved')
    assert replay(read(tmp_path / 'saved')).is_faithful


def test_two_plants_in_one_namespace_are_refused_by_name(plain, planned, tmp_path):
    nodes = {NAMES[role]: planned.parameters[role] for role in planned.nodes}
    nodes['stage2'] = planned.parameters['plant']
    write_renamed(tmp_path / 'bag', plain, planned, parameters=nodes)
    run = read(tmp_path / 'bag')
    assert 'seed' not in run.metadata
    words = 'several nodes are the plant .*: /rig/stage1, /rig/stage2'
    with pytest.raises(BagError, match=words):
        replay(run)
    with pytest.raises(BagError, match=words):
        recorded_parameters(run, 'plant', RigParameters)


def test_another_node_that_is_called_plant_gives_way_to_one_that_is(plain, planned, tmp_path):
    nodes = {NAMES[role]: planned.parameters[role] for role in planned.nodes}
    nodes = {**nodes, 'law': nodes['plant'], 'plant': {'serial_number': 5}}
    write_renamed(tmp_path / 'bag', plain, planned, parameters=nodes)
    assert replay(read(tmp_path / 'bag')).is_faithful


def test_the_only_plant_will_do_wherever_it_was_but_not_for_a_replay(plain, planned, tmp_path):
    nodes = {f'/far/{NAMES[role]}': planned.parameters[role] for role in planned.nodes}
    write_renamed(tmp_path / 'bag', plain, planned, parameters=nodes)
    run = read(tmp_path / 'bag')
    assert recorded_parameters(run, 'plant', RigParameters) == planned.plant
    with pytest.raises(BagError, match=r'tells nothing of the controller .*/far/stage1'):
        replay(run)


def test_a_plant_of_another_release_is_known_by_its_name(plain, planned, tmp_path):
    nodes = {role: dict(planned.parameters[role]) for role in planned.nodes}
    del nodes['plant']['drift_um_per_s']
    write_renamed(tmp_path / 'bag', plain, planned, parameters=nodes)
    result = replay(read(tmp_path / 'bag'))
    assert result.is_faithful
    assert result.assumed == {'plant': ('drift_um_per_s',)}


def test_responses_are_identified_from_renamed_and_remapped_runs(write_plan, tmp_path):
    planned = read_plan(write_plan(runs=[{
        'scheme': 'open_loop', 'waveform': 'stepped_sine', 'harmonics': 0, 'amplitude_um': 0.5,
        'trajectory': {'dwell_s': 0.01, 'frequencies_hz': [500.0, 1000.0]}}])).runs[0]
    simulate_run(planned, tmp_path / 'plain')
    write_renamed(tmp_path / 'bag', read(tmp_path / 'plain'), planned)
    expected, found = (
        recorded_response(read(tmp_path / name)) for name in ('plain', 'bag'))
    np.testing.assert_array_equal(found.response, expected.response)
