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

"""The ramp to zero volts as the stage sees it: no step is larger than the safe slew allows."""

import signal
from pathlib import Path

import numpy as np
import pytest
from std_srvs.srv import Trigger

from piezo_ros.model import RigParameters
from piezo_ros.parameters.node_parameters import SafetyParameters

PERIOD_S = 1e-5
STAGE = Path(__file__).parents[1] / 'support' / 'logging_stage.py'
# What is asked for last, V; what is beyond a rail is held at the rail.
VOLTAGES = (0.4, -1.7, 1e4, 1e6, 1e17, -1e300)
ENDS = ('SIGINT', 'SIGTERM', 'SIGHUP', 'stop', 'deactivate', 'peer dies', 'silence', 'end', 'gap')
QUICK = {('SIGTERM', 1e4)}


@pytest.fixture
def stage(rig, peer):
    """Start a plant that logs, between foreign nodes; return it, its writer and its log."""
    def start(**parameters):
        log = rig.directory / 'stage.bin'
        rig.environment['PIEZO_STAGE_LOG'] = str(log)
        words = [
            word for key, value in {
                'handshake_timeout_s': 60.0, 'watchdog_s': 60.0, 'linger_s': 0.0, **parameters,
            }.items() for word in ('-p', f'{key}:={value}')]
        peer.read('displacement')
        writer = peer.writer('voltage')
        process = rig.start_file(
            STAGE, '--ros-args', '-r', f'__ns:={rig.namespace}', *words)
        peer.wait_for_status('plant', state='active')
        return process, writer, log

    return start


def _end(end, process, writer, peer, block, samples):
    """End the run of the plant in one of the ways."""
    if end.startswith('SIG'):
        process.send(getattr(signal, end))
    elif end == 'stop':
        assert peer.call(Trigger, 'plant/stop', Trigger.Request()).success
    elif end == 'deactivate':
        peer.change_state('plant', 'deactivate')
    elif end == 'peer dies':
        peer.node.destroy_publisher(writer)
    elif end == 'end':
        writer.publish(block('voltage', samples, []))
    elif end == 'gap':
        writer.publish(block('voltage', samples + 7, [0.1]))
    # Of silence the watchdog hears.
    peer.wait(
        lambda: peer.status('plant').get('state') in ('stopped', 'faulted', 'finished')
        or process.exit_code is not None, 'the end of the run')


@pytest.mark.parametrize('compiled', ['false', pytest.param('true', marks=pytest.mark.slow)])
@pytest.mark.parametrize(('end', 'voltage_v'), [
    pytest.param(
        end, voltage_v, marks=() if (end, voltage_v) in QUICK else pytest.mark.slow)
    for end in ENDS for voltage_v in VOLTAGES])
def test_no_step_of_the_final_ramp_is_larger_than_the_safe_slew_allows(
        stage, peer, block, end, voltage_v, compiled):
    limits = {'watchdog_s': 0.5} if end == 'silence' else {}
    process, writer, log = stage(
        compiled=compiled, lost_writer_timeout_s=0.5, **limits)
    samples = [*np.linspace(0.0, min(max(voltage_v, -3.0), 3.0), 50), voltage_v]
    writer.publish(block('voltage', 0, samples))
    peer.wait_for_samples('displacement', len(samples) + 1)
    _end(end, process, writer, peer, block, len(samples))
    assert 'Traceback' not in process.output
    if process.exit_code is None:
        process.send(signal.SIGINT)
    process.wait()
    _assert_ramp(log, voltage_v)


def _assert_ramp(log, voltage_v):
    driven_v = np.fromfile(log, '<f8')
    begins = np.flatnonzero(np.isnan(driven_v))
    assert begins.size == 1, f'{begins.size} ramps'
    ramp_v = driven_v[begins[0] + 1:]
    rig = RigParameters()
    step_v = SafetyParameters().safe_slew_v_per_s * PERIOD_S
    lsb_v = rig.dac_span_v / 2**rig.dac_bits
    rails_v = [
        limit_v - rig.operating_point_v for limit_v in (
            rig.voltage_minimum_v, rig.voltage_maximum_v)]
    assert ramp_v[0] == pytest.approx(np.clip(voltage_v, *rails_v), abs=lsb_v)
    assert np.abs(np.diff(ramp_v)).max() <= step_v + lsb_v
    assert abs(ramp_v[-1]) <= lsb_v
    assert ramp_v.size <= abs(ramp_v[0]) / step_v + 3
