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

"""A run on hardware that is interrupted from outside: the output comes to rest without a step."""

import os
import random
import signal
import time

import numpy as np
import pytest
from processes import ROOT, wait_until

SLEW_V_PER_S, PERIOD_S = 1000.0, 1e-3
INTERRUPTIONS = [
    (signal.SIGINT, 'piezo'), (signal.SIGTERM, 'piezo'), (signal.SIGKILL, 'piezo'),
    (signal.SIGINT, 'hardware_plant'), (signal.SIGTERM, 'hardware_plant'),
    *((signal.SIGKILL, name) for name in ('recorder', 'compensator', 'controller', 'trajectory'))]


def plan(directory, **plant):
    path, log = directory / 'plan.yaml', directory / 'output.f64'
    settings = {
        'device': 'paced_device:PacedDevice', 'address': log, 'output_channel': 'held -1.5',
        'demagnetise': 'false', 'read_samples': 10, **plant}
    words = ', '.join(f'{name}: {value}' for name, value in settings.items())
    path.write_text(f"""
format_version: 1
sample_period_s: {PERIOD_S}
score_periods: 1
runs:
  - scheme: ff
    waveform: sine
    amplitude_um: 4.0
    frequency_hz: 5.0
    harmonics: 1
    periods: 30
    ramp_periods: 1
    plant: {{{words}}}
""", encoding='utf-8')
    return path, log


def interrupt(rig, number, name, prefill_samples, after_s):
    path, log = plan(rig.directory, prefill_samples=prefill_samples)
    rig.environment['PYTHONPATH'] += f':{ROOT / "test" / "support"}'
    command = rig.piezo('run', path, '-o', rig.directory / 'out', '--yes')
    wait_until(lambda: log.is_file() and log.stat().st_size > 8 * 200, 'the output to move')
    time.sleep(after_s)
    if name == 'piezo':
        command.send(number)
    else:
        os.kill(rig.nodes()[name], number)
    command.wait()
    wait_until(lambda: not rig.nodes(), 'the nodes to end')
    return np.fromfile(log)


def assert_safe(output_v):
    assert np.abs(np.diff(output_v)).max() <= SLEW_V_PER_S * PERIOD_S * (1.0 + 1e-9)
    assert output_v.max() > 1.0
    assert output_v[-1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(('number', 'name'), INTERRUPTIONS)
def test_r8_an_interrupted_run_on_hardware_ends_at_rest(rig, number, name):
    assert_safe(interrupt(rig, number, name, 0, 0.5))


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(20))
def test_r8_interruptions_at_random_end_at_rest(rig, seed):
    random.seed(seed)
    number, name = random.choice(INTERRUPTIONS)
    assert_safe(interrupt(rig, number, name, random.choice([0, 300]), 3.0 * random.random()))


@pytest.mark.slow
def test_r11_after_a_kill_of_the_plant_the_next_start_ramps_from_there(rig):
    output_v = interrupt(rig, signal.SIGKILL, 'hardware_plant', 0, 0.5)
    held_v = output_v[-1]
    assert held_v != 0.0
    path, log = plan(rig.directory, output_channel=f'held {held_v}')
    log.unlink()
    assert rig.piezo('run', path, '-o', rig.directory / 'next', '--yes').wait() == 0
    output_v = np.fromfile(log)
    assert output_v[0] == held_v
    assert_safe(output_v)
