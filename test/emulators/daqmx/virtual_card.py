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
A virtual NI-DAQmx card with the simulated rig behind it, without any transport.

Time is evaluated when the card is called, without threads. By default it goes on as far as a call
needs (deterministic); with `wall_clock_factor` it follows the wall clock. What is assumed of a real
card is listed in README.md beside this file.
"""

import dataclasses
import math
import time

import numpy as np

from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

TIMEBASE_HZ = 20e6
FINITE, CONTINUOUS = 10178, 10123
ALLOW_REGENERATION = 10097
POLL_S = 0.0005


class DaqmxFault(Exception):
    """An error code of DAQmx, with how much was read or written where a call says so."""

    def __init__(self, code, text, count=None, readings=None):
        super().__init__(text)
        self.code, self.text, self.count, self.readings = code, text, count, readings


@dataclasses.dataclass
class Faults:
    """What the card does wrong; set and cleared at any time."""

    gone: bool = False
    reserved: bool = False  # by a program that is not one of ours
    stuck_v: float | None = None  # the sensor shows this and nothing else
    clock_stands: bool = False
    rate_factor: float = 1.0  # of the rate that the card makes of what is asked for
    ticks_before_read: int = 0  # pass by before each read: a slow reader
    ticks_before_write: int = 0  # pass by before each write: a slow writer
    short_reads: list = dataclasses.field(default_factory=list)  # that the next reads return


class RigStage:
    """Amplifier, stage and sensor: the rig between connectors of volts."""

    def __init__(self, parameters=None, *, sensor_offset_v=0.0, compiled=False):
        self.parameters = parameters or RigParameters()
        self.sensor_offset_v = sensor_offset_v
        self._compiled = compiled
        self._rig = None

    def at_rate(self, rate_hz, held_v):
        """Take the sample period of a clock; the rig settles if it is another one."""
        period_s = 1.0 / rate_hz
        if self._rig is None or self._rig.sample_period_s != period_s:
            self._rig = Rig(self.parameters, period_s, compiled=self._compiled)
            if self._compiled:
                # Compiled now, not while the clock runs.
                Rig(self.parameters, period_s).run(np.zeros(1))
            deviation_v = held_v - self.parameters.operating_point_v
            if deviation_v:
                self._rig.drive(np.full(math.ceil(0.05 * rate_hz), deviation_v))

    def measure_v(self):
        return self._sensor_v(np.array([self._rig.measure()]))[0]

    def hold_v(self, held_v):
        """Hold each voltage for a period and return the sensor at its end, shape (N,)."""
        rig = self._rig
        return self._sensor_v(rig.answer(rig.index, held_v - self.parameters.operating_point_v))

    def _sensor_v(self, displacement_um):
        scale_um_per_v = 2.0 * self.parameters.highest_reading_um / self.parameters.adc_span_v
        return displacement_um / scale_um_per_v + self.sensor_offset_v


class WireStage:
    """A wire from the output to the sensor input."""

    def __init__(self, held_v=0.0):
        self._held_v = held_v

    def at_rate(self, rate_hz, held_v):
        self._held_v = held_v

    def measure_v(self):
        return self._held_v

    def hold_v(self, held_v):
        self._held_v = held_v[-1]
        return np.array(held_v)


@dataclasses.dataclass
class CardTask:
    name: str
    channels: list = dataclasses.field(default_factory=list)
    is_output: bool = False
    lowest_v: float = -10.0
    highest_v: float = 10.0
    mode: int = 0  # 0: on demand
    rate_hz: float = 0.0
    source: str = ''
    samples: int = 1000
    buffer_samples: int = 0
    regeneration: int = ALLOW_REGENERATION
    running: bool = False
    started_s: float = 0.0
    data_v: np.ndarray = dataclasses.field(default_factory=lambda: np.empty(0))
    taken: int = 0  # AO: written; AI: read
    ticks: int = 0  # AO: generated; AI: acquired
    failed: DaqmxFault | None = None
    done: bool = False


class VirtualCard:
    """
    One card, Dev1: ao0 drives the stage, ai0 has its sensor, ai1 ... ai7 have 1 ... 7 V.

    Attributes
    ----------
    faults : Faults
        What it does wrong.
    outputs_v : list of ndarray
        What the output ao0 went to, one array for each piece of time.
    calls : list of str
        The functions called, for tests of what a client does.

    """

    name = 'Dev1'
    product = 'PCI-6289'
    serial = 0x17C0FFEE
    highest_input_rate_hz, highest_output_rate_hz, lowest_rate_hz = 625e3, 2.86e6, 0.006
    range_v = 10.0

    def __init__(
        self, stage=None, *, held_v=0.0, dac_bits=0, adc_bits=0, wall_clock_factor=None,
    ):
        self.stage = stage or RigStage()
        self.faults = Faults()
        self.dac_bits, self.adc_bits = dac_bits, adc_bits
        self.wall_clock_factor = wall_clock_factor
        self.held_v = {'ao0': float(held_v), 'ao1': 0.0}
        self.outputs_v = [np.array([float(held_v)])]
        self.stage.at_rate(1e5, float(held_v))
        self.tasks = {}
        self.calls = []

    # Tasks

    def create_task(self, name):
        self._called('create_task')
        name = name or f'_unnamedTask<{len(self.calls):X}>'
        if name in self.tasks:
            raise DaqmxFault(-200089, f'Task name conflicts with an existing task name: {name}')
        self.tasks[name] = CardTask(name)
        return name

    def clear_task(self, name):
        self._called('clear_task', name)
        task = self.tasks.pop(name, None)
        if task is None:
            raise DaqmxFault(-200088, 'Task specified is invalid or does not exist.')
        self._catch_up()

    def add_channels(self, name, channels, lowest_v, highest_v, *, is_output):
        self._called('add_channels', name)
        task = self._task(name)
        for channel in channels.split(','):
            device, _, local = channel.strip().lstrip('/').partition('/')
            if device != self.name:
                raise DaqmxFault(-200220, f'Device identifier is invalid: {device}')
            known = {*self.held_v} if is_output else {
                *(f'ai{index}' for index in range(32)), *(f'_{ao}_vs_aognd' for ao in self.held_v)}
            if local not in known:
                raise DaqmxFault(-200170, f'Physical channel specified does not exist: {channel}')
            task.channels.append(local)
        if not -self.range_v <= lowest_v < highest_v <= self.range_v:
            raise DaqmxFault(-200077, f'{lowest_v} ... {highest_v} V is beyond the range')
        task.is_output, task.lowest_v, task.highest_v = is_output, lowest_v, highest_v

    def configure_clock(self, name, rate_hz, source, mode, samples):
        self._called('configure_clock', name)
        task = self._task(name)
        highest_hz = self.highest_output_rate_hz if task.is_output else (
            self.highest_input_rate_hz / max(1, len(task.channels)))
        if rate_hz > highest_hz:
            raise DaqmxFault(-200332, f'Sample rate {rate_hz} is above {highest_hz}')
        if mode == FINITE and samples < 2:
            raise DaqmxFault(-200077, f'{samples} samples are not supported, 2 is the least')
        divisor = max(1, round(TIMEBASE_HZ / rate_hz))
        task.rate_hz = TIMEBASE_HZ / divisor * self.faults.rate_factor
        task.source, task.mode, task.samples = source, mode, samples
        task.buffer_samples = task.buffer_samples or samples

    def start(self, name):
        self._called('start', name)
        task = self._task(name)
        if self.faults.reserved:
            raise DaqmxFault(-50103, 'The specified resource is reserved.')
        for other in self.tasks.values():
            if other is not task and other.running and other.is_output == task.is_output:
                raise DaqmxFault(-50103, f'The specified resource is reserved by {other.name}.')
        if task.is_output and task.mode:
            if task.source.lstrip('/') != f'{self.name}/ai/SampleClock':
                raise DaqmxFault(-200077, f'Clock {task.source!r}: not modelled by this emulator')
            if not task.taken:
                raise DaqmxFault(-200462, 'Generation cannot be started: the buffer is empty.')
        task.running, task.started_s = True, time.monotonic()
        if not task.is_output and task.mode:
            self.stage.at_rate(task.rate_hz, self.held_v['ao0'])
            if self.wall_clock_factor is None:
                self._advance(task, 1)

    def stop(self, name):
        self._called('stop', name)
        self._catch_up()
        self._task(name).running = False

    # Output

    def write(self, name, values_v, timeout_s, auto_start):
        self._called('write', name)
        task = self._task(name)
        values_v = np.asarray(values_v, dtype=float)
        allowed = (values_v >= task.lowest_v) & (values_v <= task.highest_v)
        if not allowed.all():
            raise DaqmxFault(
                -200561, f'Attempted writing analog data that is too large or small: '
                f'{values_v[np.argmin(allowed)]}')
        if not task.mode:
            self._write_on_demand(task, values_v)
            return values_v.size
        self._pass_by(self.faults.ticks_before_write)
        self._catch_up()
        deadline_s = time.monotonic() + timeout_s
        done = 0
        while True:
            if task.failed:
                raise task.failed
            room = task.buffer_samples - (task.taken - task.ticks)
            piece_v = values_v[done:done + max(0, room)]
            task.data_v = np.concatenate([task.data_v, piece_v])
            task.taken += piece_v.size
            done += piece_v.size
            if done == values_v.size:
                break
            if not self._wait_for_ticks(values_v.size - done, deadline_s):
                raise DaqmxFault(
                    -200292, 'Some or all of the samples to write could not be written yet', done)
        if auto_start and not task.running:
            self.start(name)
        return done

    def _write_on_demand(self, task, values_v):
        for other in self.tasks.values():
            if other.is_output and other.mode and other.running:
                raise DaqmxFault(-200963, 'Sample timing type of the AO tasks is different.')
        self._clock_is_free(is_output=True)
        for value_v in values_v:
            self._go_to(task.channels[0], np.array([value_v]))
            # Software takes its time: a period of the newest clock.
            if task.channels[0] == 'ao0':
                self.stage.hold_v(np.array([self.held_v['ao0']]))

    def generated(self, name):
        self._called('generated', name)
        self._catch_up()
        return self._task(name).ticks

    def is_done(self, name):
        self._called('is_done', name)
        self._catch_up()
        task = self._task(name)
        if task.failed:
            raise task.failed
        return task.done or not task.running

    def wait_until_done(self, name, timeout_s):
        self._called('wait_until_done', name)
        deadline_s = time.monotonic() + timeout_s
        task = self._task(name)
        self._catch_up()
        while not task.done:
            if task.failed:
                raise task.failed
            if not self._wait_for_ticks(1, deadline_s):
                raise DaqmxFault(-200560, 'Wait until done: the task is not done in time.')

    # Input

    def read(self, name, samples, timeout_s):
        """Return readings, shape (channels, N)."""
        self._called('read', name)
        task = self._task(name)
        if not task.mode:
            self._clock_is_free(is_output=False)
            return self._convert(task.channels, np.array([self.stage.measure_v()]))
        if not task.running:
            raise DaqmxFault(-200278, 'The task is not running.')
        self._pass_by(self.faults.ticks_before_read)
        self._catch_up()
        short = self.faults.short_reads.pop(0) if self.faults.short_reads else None
        wanted = samples if short is None else min(short, samples)
        if task.mode == FINITE and task.taken + samples > task.samples:
            raise DaqmxFault(-200278, 'Attempted to read a sample beyond the final one.', 0)
        deadline_s = time.monotonic() + timeout_s
        while task.ticks - task.taken < wanted and not task.failed:
            if not self._wait_for_ticks(wanted - (task.ticks - task.taken), deadline_s):
                break
        if task.failed:
            raise task.failed
        count = min(wanted, task.ticks - task.taken)
        readings_v, task.data_v = np.split(task.data_v, [count])
        task.taken += count
        readings_v = self._convert(task.channels, readings_v)
        if count < samples:
            raise DaqmxFault(
                -200284, 'Some or all of the samples requested have not yet been acquired.',
                count, readings_v)
        return readings_v

    def actual_rate_hz(self, name):
        self._called('actual_rate_hz', name)
        return self._task(name).rate_hz

    def reset(self):
        """Clear every task and set the outputs to 0 V, as M, C and X Series do."""
        self._called('reset')
        self.tasks.clear()
        for channel in self.held_v:
            self._go_to(channel, np.zeros(1))

    # Time

    def _clock(self):
        return next((
            task for task in self.tasks.values()
            if task.running and task.mode and not task.is_output), None)

    def _catch_up(self):
        clock = self._clock()
        if clock is not None and self.wall_clock_factor is not None:
            due = int(
                (time.monotonic() - clock.started_s) * self.wall_clock_factor * clock.rate_hz)
            self._advance(clock, due - clock.ticks)

    def _pass_by(self, ticks):
        clock = self._clock()
        if clock is not None:
            self._advance(clock, ticks)

    def _wait_for_ticks(self, ticks, deadline_s):
        """Let time go on; return whether there is hope for what was waited for."""
        clock = self._clock()
        if clock is None or clock.done or self.faults.clock_stands:
            return False
        if self.wall_clock_factor is None:
            self._advance(clock, ticks)
            return True
        if time.monotonic() > deadline_s:
            return False
        time.sleep(POLL_S)
        self._catch_up()
        return True

    def _advance(self, clock, ticks):
        """Let the clock of the input tick: convert, then move the output."""
        if clock.mode == FINITE:
            ticks = min(ticks, clock.samples - clock.ticks)
        if ticks <= 0 or self.faults.clock_stands:
            return
        output = next((
            task for task in self.tasks.values() if task.running and task.mode and task.is_output),
            None)
        before_v = self.held_v['ao0']
        moved_v = self._moved(output, ticks)
        # What is held in the period before each tick; none has passed before the first.
        held_v = np.concatenate([[before_v], moved_v[:-1]])
        if clock.ticks == 0:
            readings_v = np.concatenate([
                [self.stage.measure_v()],
                self.stage.hold_v(held_v[1:]) if ticks > 1 else np.empty(0)])
        else:
            readings_v = self.stage.hold_v(held_v)
        clock.ticks += ticks
        clock.data_v = np.concatenate([clock.data_v, readings_v])
        clock.done = clock.mode == FINITE and clock.ticks == clock.samples
        if clock.mode == CONTINUOUS and clock.ticks - clock.taken > clock.buffer_samples:
            clock.failed = DaqmxFault(
                -200279, 'The application is not able to keep up: samples were overwritten.', 0)

    def _moved(self, output, ticks):
        """Return what the output has after each of the next ticks, and move it there."""
        before_v = self.held_v['ao0']
        if output is None or output.failed or output.done:
            return np.full(ticks, before_v)
        first = output.ticks
        if output.regeneration == ALLOW_REGENERATION:
            due = np.resize(output.data_v, first + ticks)[first:] if output.data_v.size else (
                np.empty(0))
        else:
            # What has gone out is not kept.
            due, output.data_v = np.split(output.data_v, [min(ticks, output.data_v.size)])
        if output.mode == FINITE:
            due = due[:output.samples - first]
        output.ticks += due.size
        if due.size < ticks:
            if output.mode == FINITE and output.ticks == output.samples:
                output.done = True
            else:
                output.failed = DaqmxFault(
                    -200290, 'The generation has stopped to prevent the regeneration of old '
                    'samples.', 0)
        moved_v = self._go_to(output.channels[0], due) if due.size else np.empty(0)
        if output.channels[0] != 'ao0':
            return np.full(ticks, before_v)
        return np.concatenate([
            moved_v, np.full(ticks - due.size, moved_v[-1] if due.size else before_v)])

    def _go_to(self, channel, values_v):
        if self.dac_bits:
            step_v = 2.0 * self.range_v / 2**self.dac_bits
            values_v = np.floor(values_v / step_v + 0.5) * step_v
        self.held_v[channel] = float(values_v[-1])
        if channel == 'ao0':
            self.outputs_v.append(np.array(values_v))
        return values_v

    def _convert(self, channels, sensor_v):
        """Return what each channel of a task shows, in the order of its names."""
        rows = []
        for channel in channels:
            if channel == 'ai0':
                row = sensor_v if self.faults.stuck_v is None else np.full(
                    sensor_v.size, self.faults.stuck_v)
            elif channel.startswith('_'):
                row = np.full(sensor_v.size, self.held_v[channel[1:4]])
            else:
                row = np.full(sensor_v.size, float(channel[2:]))
            if self.adc_bits:
                step_v = 2.0 * self.range_v / 2**self.adc_bits
                row = np.floor(row / step_v + 0.5) * step_v
            rows.append(np.clip(row, -self.range_v, self.range_v))
        return np.array(rows)

    # Common

    def _called(self, what, name=None):
        self.calls.append(what)
        if self.faults.gone:
            raise DaqmxFault(-201003, 'Device cannot be accessed. It may be unplugged.')

    def _task(self, name):
        if name not in self.tasks:
            raise DaqmxFault(-200088, 'Task specified is invalid or does not exist.')
        return self.tasks[name]

    def _clock_is_free(self, *, is_output):
        if self.faults.reserved or any(
                task.running and task.mode and task.is_output == is_output
                for task in self.tasks.values()):
            raise DaqmxFault(-50103, 'The specified resource is reserved.')

    def require(self, device):
        """Refuse the name of another device."""
        if device != self.name:
            raise DaqmxFault(-200220, f'Device identifier is invalid: {device}')
