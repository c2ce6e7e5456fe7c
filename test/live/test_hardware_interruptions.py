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
A run on hardware that is interrupted from outside: the output comes to rest without a step.

On a device that the node plays itself, and on a virtual card behind its device server, which goes
on or dies without the node. ``PIEZO_FAULT_TRIALS`` says how many interruptions at random there are.
"""

import os
import random
import signal
import time

import numpy as np
import pytest
from fault_results import first_trial, number_of_trials
from processes import ROOT, has_ni, wait_until

SLEW_V_PER_S, PERIOD_S, HELD_V, OPERATING_POINT_V = 1000.0, 1e-3, -1.5, 5.0
NODES = ('recorder', 'compensator', 'controller', 'trajectory')
INTERRUPTIONS = [
    (signal.SIGINT, 'piezo'), (signal.SIGTERM, 'piezo'), (signal.SIGKILL, 'piezo'),
    (signal.SIGINT, 'hardware_plant'), (signal.SIGTERM, 'hardware_plant'),
    *((signal.SIGKILL, name) for name in NODES)]
KILLED = (signal.SIGKILL, 'hardware_plant')
ON_A_PACED_DEVICE = [*INTERRUPTIONS, KILLED, (None, 'exception')]
ON_A_CARD = [*INTERRUPTIONS, KILLED, (signal.SIGKILL, 'server')]
# What leaves the output where it is; the next start ramps from there.
HOLDS = (KILLED, (signal.SIGKILL, 'server'))
needs_ni = pytest.mark.skipif(not has_ni(), reason='nidaqmx[grpc] is not installed')


class PacedStage:
    """A device inside the node, played by the wall clock."""

    server = None

    def __init__(self, rig, held_v=HELD_V, raises=None):
        self.log = rig.directory / 'output.f64'
        rig.environment['PYTHONPATH'] += f':{ROOT / "test" / "support"}'
        self._raises = '' if raises is None else f',raises {raises}'
        self._hold(held_v)

    def _hold(self, held_v):
        self.plant = {
            'device': 'paced_device:PacedDevice', 'address': str(self.log),
            'output_channel': f"'held {held_v!r}{self._raises}'"}

    def output_v(self):
        return np.fromfile(self.log)

    def go_on(self):
        """Hold what was held last, and forget how it came there."""
        self._raises = ''
        self._hold(float(self.output_v()[-1]))
        self.log.unlink()


class CardStage:
    """A virtual card in a process of its own, which follows the wall clock."""

    def __init__(self, rig, held_v=HELD_V):
        self._rig = rig
        self.log = rig.directory / 'output.f64'
        self._start(held_v)

    def _start(self, held_v):
        self.server, address = self._rig.start_emulator(
            'daqmx.daqmx_server', '--held', OPERATING_POINT_V + held_v, '--wall-clock', 1,
            '--log', self.log)
        self.plant = {'device': 'ni', 'address': address, 'timeout_s': 3.0}

    def output_v(self):
        return np.fromfile(self.log) - OPERATING_POINT_V

    def go_on(self):
        """Where the server died, start another one in front of what the output holds."""
        if self.server.exit_code is not None:
            self._start(float(self.output_v()[-1]))


def write_plan(rig, stage, *, periods=30, **plant):
    path = rig.directory / 'plan.yaml'
    settings = {'demagnetise': 'false', 'read_samples': 10, **stage.plant, **plant}
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
    periods: {periods}
    ramp_periods: 1
    plant: {{{words}}}
""", encoding='utf-8')
    return path


def interrupt(rig, stage, number, name, prefill_samples, after_s):
    """Interrupt a run; return the exit code of the command once all nodes have ended."""
    path = write_plan(rig, stage, prefill_samples=prefill_samples)
    command = rig.piezo('run', path, '-o', rig.directory / 'out', '--yes')
    wait_until(
        lambda: stage.log.is_file() and stage.log.stat().st_size > 8 * 200, 'the output to move')
    time.sleep(after_s)
    if name == 'piezo':
        command.send(number)
    elif name == 'server':
        stage.server.send(number)
        stage.server.wait()
    elif number is not None and name in (nodes := rig.nodes()):
        os.kill(nodes[name], number)
    code = command.wait()
    wait_until(lambda: not rig.nodes(), 'the nodes to end')
    return code


def assert_no_step(output_v):
    assert np.abs(np.diff(output_v)).max() <= SLEW_V_PER_S * PERIOD_S * (1.0 + 1e-9)


def assert_safe(output_v):
    assert_no_step(output_v)
    assert output_v.max() > 1.0
    assert output_v[-1] == 0.0


def assert_next_start_ramps(rig, stage):
    """Start once more from what is held; the output goes to rest from there."""
    before_v = stage.output_v()
    stage.go_on()
    path = write_plan(rig, stage, periods=2)
    command = rig.piezo('run', path, '-o', rig.directory / 'next', '--yes')
    assert command.wait() == 0, command.output
    after_v = stage.output_v()
    if isinstance(stage, PacedStage):
        assert after_v[0] == before_v[-1]
    assert_safe(after_v)


def assert_right(rig, stage, number, name, code):
    """Assert what must be true of the output after an interruption, whatever it was."""
    if name in ('server', 'exception'):
        assert code != 0
    if (number, name) in HOLDS:
        assert_no_step(stage.output_v())
        assert_next_start_ramps(rig, stage)
    else:
        assert_safe(stage.output_v())


@pytest.mark.slow
@pytest.mark.parametrize(('number', 'name'), ON_A_PACED_DEVICE)
def test_r8_an_interrupted_run_on_hardware_ends_at_rest(rig, number, name):
    stage = PacedStage(rig, raises=60 if name == 'exception' else None)
    code = interrupt(rig, stage, number, name, 0, 0.5)
    if (number, name) == KILLED:
        assert stage.output_v()[-1] != 0.0
    assert_right(rig, stage, number, name, code)


@pytest.mark.slow
@needs_ni
@pytest.mark.parametrize(('number', 'name'), ON_A_CARD)
def test_r8_r11_so_does_one_on_a_card(rig, number, name):
    stage = CardStage(rig)
    assert_right(rig, stage, number, name, interrupt(rig, stage, number, name, 0, 0.5))


FIRST = first_trial()


def drawn(seed):
    """Return one of the interruptions: whether on a card, signal, name, prefill, when."""
    draw = random.Random(seed)
    is_card = has_ni() and draw.random() < 0.5
    number, name = draw.choice(ON_A_CARD if is_card else ON_A_PACED_DEVICE)
    prefill_samples, after_s = draw.choice([0, 300]), 3.0 * draw.random()
    # Of ten samples each: before thirty of them the output has hardly moved.
    return is_card, number, name, prefill_samples, after_s, draw.randrange(30, 300)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(FIRST, FIRST + number_of_trials(20)))
def test_r8_interruptions_at_random_end_at_rest(rig, seed):
    is_card, number, name, prefill_samples, after_s, readings = drawn(seed)
    if is_card:
        stage = CardStage(rig)
    else:
        stage = PacedStage(rig, raises=readings if name == 'exception' else None)
    code = interrupt(rig, stage, number, name, prefill_samples, after_s)
    assert_right(rig, stage, number, name, code)
