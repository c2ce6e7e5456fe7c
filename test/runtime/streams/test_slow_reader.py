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

"""A reader that stops reading: the run waits for it, says so, and loses nothing."""

import signal
import time
from pathlib import Path

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters

PERIODS = 18.0
LOOP_NODES = ('compensator', 'controller', 'plant', 'trajectory')
NAMES_S = 2.0


def test_a_suspended_reader_stops_the_run_until_it_reads_again(rig, peer, tmp_path):
    onlooker = rig.start_file(
        Path(__file__).with_name('onlooker.py'), 'displacement', '100', '--ros-args', '-r',
        f'__ns:={rig.namespace}')
    onlooker.wait_for('ready')
    parameters = tmp_path / 'plant.yaml'
    # The controller and the onlooker.
    parameters.write_text('/**/plant: {ros__parameters: {required_readers: 2}}')
    loop = rig.start_node(
        'loop', '--params-file', str(parameters), '-p', f'periods:={PERIODS}',
        '-p', 'handshake_timeout_s:=60.0', '-p', 'autostart:=false')
    for node in LOOP_NODES:
        assert peer.change_state(node, 'configure')
    # The name of a node travels beside its endpoints, and a suspended one sends nothing again.
    time.sleep(NAMES_S)
    for node in LOOP_NODES:
        assert peer.change_state(node, 'activate')
    onlooker.wait_for('100 samples')
    onlooker.send(signal.SIGSTOP)
    warning = f'{rig.namespace}/displacement waits at sample '
    loop.wait_for(warning)
    (line,) = {line for line in loop.output.splitlines() if warning in line}
    assert 'WARN' in line
    assert f'{rig.namespace}/controller or {rig.namespace}/onlooker' in line
    assert loop.exit_code is None
    onlooker.send(signal.SIGCONT)
    trajectory = TrajectoryParameters(periods=PERIODS)
    status = peer.wait_for_status('plant', state='finished', index=trajectory.samples + 1)
    assert status['reason'] == ''
    assert onlooker.wait() == 0
    expected = simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(), trajectory)
    total_um = sum(expected.displacement_um.tolist())
    assert f'{trajectory.samples + 1} samples, sum {total_um!r}\nthe end' in onlooker.output
    for node in LOOP_NODES:
        assert peer.change_state(node, 'active_shutdown')
    assert loop.wait() == 0
