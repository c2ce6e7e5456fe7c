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

"""
What the launch files start, started: two rigs at once, one of them in one process.

Where `launch` is installed it starts them, too, included twice.
"""

import os
import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.bag import STREAMS, read
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
EXAMPLE = ROOT / 'docs' / 'examples' / 'gain_plant.py'
TWO_RIGS = ROOT / 'docs' / 'examples' / 'two_rigs.launch.py'

# Launches a file in a folder as `ros2 launch` does.
LAUNCH = """\
import os, sys
from launch import LaunchService
from launch.launch_description_sources import get_launch_description_from_python_launch_file
os.chdir(sys.argv[2])
service = LaunchService()
service.include_launch_description(get_launch_description_from_python_launch_file(sys.argv[1]))
sys.exit(service.run())
"""


@pytest.fixture
def alone(tmp_path):
    """Return the streams of a run of the same rig that nobody disturbs."""
    def simulate(**run):
        plan = tmp_path / 'plan.yaml'
        plan.write_text(yaml.safe_dump({
            'format_version': 1, 'score_periods': 1, 'runs': [run],
            'parameter_files': [str(CONFIG / f'{name}.yaml') for name in (
                'rig', 'compensator', 'controller', 'trajectory')]}))
        bag = tmp_path / f'alone_{run["scheme"]}'
        simulate_run(read_plan(plan).runs[0], bag)
        return read(bag)

    return simulate


def test_two_rigs_in_two_namespaces_give_the_numbers_that_they_give_alone(rig, launched, alone):
    runs = {
        'one': {'amplitude_um': 1.5, 'periods': 3.0, 'scheme': 'fbff'},
        'two': {'amplitude_um': 1.0, 'periods': 3.0, 'scheme': 'ff'}}
    started = {
        name: launched(
            namespace=f'{rig.namespace}/{name}', record='true',
            bag_directory=str(rig.directory / name), composed=composed,
            **{key: str(value) for key, value in run.items()})
        for (name, run), composed in zip(runs.items(), ('false', 'true'), strict=True)}
    assert [*started['two']] == ['recorder', 'loop']
    for name, run in runs.items():
        assert started[name]['recorder'].wait() == 0, started[name]['recorder'].output
        recorded, expected = read(rig.directory / name), alone(**run)
        for stream in STREAMS:
            np.testing.assert_array_equal(
                recorded.whole(stream)[1], expected.whole(stream)[1], err_msg=stream)
        assert {
            node.rpartition('/')[0] for node in recorded.parameters
        } == {f'{rig.namespace}/{name}'}


def test_a_foreign_plant_takes_its_place_in_the_loop(rig, launched):
    """The plant of the documentation, which knows nothing of this package."""
    bag = rig.directory / 'bag'
    plant = rig.start_file(
        EXAMPLE, '--ros-args', '-r', f'__ns:={rig.namespace}', '-p', 'required_readers:=2',
        '-p', 'gain_um_per_v:=1.25', '-p', 'delay_samples:=3')
    started = launched(
        namespace=rig.namespace, record='true', bag_directory=str(bag), without='plant',
        scheme='fbff', periods='2.0')
    assert [*started] == ['recorder', 'compensator', 'controller', 'trajectory']
    assert started['recorder'].wait() == 0, started['recorder'].output
    assert plant.wait() == 0, plant.output
    run = read(bag)
    assert run.samples == 667
    voltage_v, displacement_um = (run.whole(stream)[1] for stream in ('voltage', 'displacement'))
    np.testing.assert_array_equal(displacement_um[:4], 0.0)
    np.testing.assert_array_equal(displacement_um[4:], 1.25 * voltage_v[:-3])
    assert run.parameters[f'{rig.namespace}/plant']['delay_samples'] == 3


@pytest.fixture
def launch(rig):
    """Launch a file, the launch files and nodes of this source tree being those of the package."""
    pytest.importorskip('launch_ros')
    prefix = rig.directory / 'prefix'
    programs = prefix / 'lib' / 'piezo_ros'
    share = prefix / 'share'
    for folder in programs, share / 'piezo_ros', share / 'ament_index/resource_index/packages':
        folder.mkdir(parents=True)
    (share / 'ament_index/resource_index/packages/piezo_ros').touch()
    for folder in 'launch', 'config':
        (share / 'piezo_ros' / folder).symlink_to(ROOT / folder)
    for name in 'recorder', 'compensator', 'controller', 'plant', 'trajectory', 'loop':
        (programs / name).write_text(
            f'#!/bin/sh\nexec {sys.executable} -m piezo_ros.nodes.executables {name} "$@"\n')
        (programs / name).chmod(0o755)
    script = rig.directory / 'run.py'
    script.write_text(LAUNCH)
    rig.environment.update(
        AMENT_PREFIX_PATH=f'{prefix}:{os.environ.get("AMENT_PREFIX_PATH", "")}',
        ROS_LOG_DIR=str(rig.directory / 'log'), RCUTILS_COLORIZED_OUTPUT='0')
    return lambda file: rig.start_file(script, str(file), str(rig.directory))


def write_long_rigs(path, periods_of_two):
    """Write the example anew: samples go one by one for minutes in rig one, in blocks in two."""
    text = TWO_RIGS.read_text()
    text = text.replace("periods='1500'", f'periods={str(periods_of_two)!r}')
    path.write_text(text.replace("periods='15'", "periods='1500'"))
    return path


def assert_healthy(process):
    assert process.wait() == 0, process.output
    for word in ('WARN]', 'ERROR', 'has died', 'Traceback'):
        assert word not in process.output, process.output


def test_two_included_rigs_give_the_numbers_that_they_give_alone(rig, launch, alone):
    """The example of the documentation: another name for a plant and for a stream."""
    process = launch(TWO_RIGS)
    assert_healthy(process)
    for name, plant, run in [
        ('one', 'plant', {'amplitude_um': 1.0, 'periods': 15.0, 'scheme': 'fbff'}),
        ('two', 'stage', {'amplitude_um': 1.0, 'periods': 1500.0, 'scheme': 'ff'}),
    ]:
        recorded, expected = read(rig.directory / name), alone(**run)
        for stream in STREAMS:
            np.testing.assert_array_equal(
                recorded.whole(stream)[1], expected.whole(stream)[1], err_msg=stream)
        assert {*recorded.parameters} == {
            f'/{name}/{node}' for node in ('compensator', 'controller', plant, 'trajectory')}
        assert f'/{name}: recorder is done; ending the other nodes of this rig' in process.output


def test_ctrl_c_in_a_launch_of_two_rigs_is_no_failure(rig, launch, until):
    process = launch(write_long_rigs(rig.directory / 'long.launch.py', 1_000_000))
    until(lambda: process.output.count('run 1 begins') == 10, 'ten runs to begin')
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    assert process.wait() == 0, process.output
    assert process.output.count('has finished cleanly') == 10, process.output
    for word in ('ERROR', 'has died', 'Traceback'):
        assert word not in process.output, process.output
    for name in 'one', 'two':
        assert not read(rig.directory / name).lost


def test_a_killed_node_ends_its_own_rig_in_order_and_no_other(rig, launch, until):
    process = launch(write_long_rigs(rig.directory / 'long.launch.py', 3000))
    until(lambda: process.output.count('run 1 begins') == 10, 'ten runs to begin')
    (pid,) = re.findall(r'plant-4]: process started with pid \[(\d+)]', process.output)
    os.kill(int(pid), signal.SIGKILL)
    until(lambda: '/two: recorder is done' in process.output, 'the other rig to end its run')
    assert process.wait() == 0, process.output
    assert '/one: plant was killed by signal 9; ending the other nodes' in process.output
    assert process.output.count('has died') == 1, process.output
    assert process.output.count('has finished cleanly') == 9, process.output
    assert not read(rig.directory / 'one').lost
    assert read(rig.directory / 'two').samples == 1_000_000
