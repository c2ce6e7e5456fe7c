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
What a lab does with a stage that it does not know, by the commands of the package.

Record a decreasing triangle and a stepped sine, identify, tune; then scan the true stage with what
was identified, and compare what was promised with what came.
"""

import contextlib
import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from foreign_stages import ForeignStage, StageDescription

from piezo_ros.bag import BagWriter
from piezo_ros.cli.main import main
from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.control.trajectory_blocks import trajectory_blocks
from piezo_ros.model import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_set

__all__ = ['Flow', 'compensated_nonlinearity_percent', 'nrmse_percent', 'scan']

_BLOCK = 2000


def record(directory, sample_period_s, voltage_v, displacement_um):
    """Write a bag with a voltage and what came of it, and nothing else."""
    streams = {'voltage': np.asarray(voltage_v), 'displacement': np.asarray(displacement_um)}
    with BagWriter(directory, topics={stream: f'/{stream}' for stream in streams}) as writer:
        for start in range(0, displacement_um.size, _BLOCK):
            for stream, values in streams.items():
                if values[start:start + _BLOCK].size:
                    writer.write_block(
                        stream, start, sample_period_s, values[start:start + _BLOCK])
        for stream, values in streams.items():
            writer.write_block(stream, values.size, sample_period_s, values[:0])


@dataclass
class Flow:
    """One stage and a directory in which everything about it is kept."""

    description: StageDescription
    directory: Path
    seed: int = 0
    printed: dict = field(default_factory=dict)
    exit_codes: dict = field(default_factory=dict)

    @property
    def period_s(self):
        """Sample period, seconds."""
        return self.description.sample_period_s

    @property
    def resonance_hz(self):
        """The slowest pole of the stage."""
        poles = [*self.description.before[1], *self.description.behind[1]]
        return min(abs(pole) for pole in poles) / (2.0 * np.pi)

    def file(self, name):
        """Return the path of a file of this flow."""
        return self.directory / name

    def piezo(self, step, *arguments):
        """Do a command; keep its output and its exit code."""
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            self.exit_codes[step] = main([str(argument) for argument in arguments])
        self.printed[step] = output.getvalue()
        return self.exit_codes[step]

    def drive(self, name, trajectory):
        """Record the bare stage under a voltage."""
        voltage_v, _ = trajectory_blocks(trajectory, compiled=True)(0, trajectory.samples)
        stage = ForeignStage(self.description, self.seed + len(self.printed) + 1)
        first_um = stage.read(np.zeros(1))
        record(self.file(name), self.period_s, voltage_v,
               np.concatenate([first_um, stage.run(voltage_v)]))

    def data_sheet(self):
        """Write what a lab knows of the stage before it is driven."""
        d = self.description
        self.file('rig.yaml').write_text(parameters_yaml('/**', {'plant': {
            'travel_um': d.travel_um, 'operating_point_um': 0.5 * d.travel_um,
            'operating_point_v': d.reach_v, 'voltage_minimum_v': 0.0,
            'voltage_maximum_v': 2.0 * d.reach_v, 'slew_limit_v_per_s': d.slew_limit_v_per_s,
            'noise_rms_um': float(np.hypot(d.noise_um, d.sensor_step_um / np.sqrt(12.0))),
            'dac_bits': 0, 'adc_bits': 0}}))

    def identify_hysteresis(self, *options):
        """Drive a slow decreasing triangle and identify."""
        slow_hz = min(self.resonance_hz / 100.0, 4.0)
        triangle = TrajectoryParameters(
            output='voltage', waveform='decreasing_triangle', harmonics=0,
            amplitude_v=0.95 * self.description.reach_v, frequency_hz=slow_hz, periods=12,
            sample_period_s=self.period_s)
        self.drive('triangle', triangle)
        return self.piezo(
            'hysteresis', 'identify', 'hysteresis', self.file('triangle'),
            '-o', self.file('compensator.yaml'), *options)

    def stepped(self, amplitude_v, offset_v=0.0, number=70):
        """Return a stepped sine about all poles of the stage."""
        d = self.description
        poles = [*d.before[1], *d.behind[1]]
        top_hz = min(3.0 * max(abs(p) for p in poles) / (2.0 * np.pi), 0.4 / d.sample_period_s)
        grid = list(np.geomspace(self.resonance_hz / 20.0, top_hz, number // 2))
        for pole in poles:
            centre_hz = abs(pole) / (2.0 * np.pi)
            grid += list(centre_hz * np.linspace(0.8, 1.25, 12))
        grid = sorted({round(f, 2) for f in grid if f < top_hz})
        ring_s = 8.0 / min(-p.real if isinstance(p, complex) else abs(p) for p in poles)
        return TrajectoryParameters(
            output='voltage', waveform='stepped_sine', harmonics=0, amplitude_v=amplitude_v,
            offset_v=offset_v, frequencies_hz=tuple(grid), dwell_s=max(8.0 / grid[0] * 0.2, 0.05),
            settle_s=ring_s, frequency_hz=min(300.0, 0.1 / d.sample_period_s),
            sample_period_s=d.sample_period_s)

    def identify_dynamics(self, *options):
        """Drive a small stepped sine and identify."""
        played = self.stepped(0.04 * self.description.reach_v)
        self.drive('stepped', played)
        values = {name: value for name, value in played.to_mapping().items()
                  if name in ('output', 'waveform', 'harmonics', 'amplitude_v', 'offset_v',
                              'frequencies_hz', 'dwell_s', 'settle_s', 'frequency_hz')}
        self.file('played.yaml').write_text(parameters_yaml('/**', {'trajectory': values}))
        return self.piezo(
            'dynamics', 'identify', 'dynamics', self.file('stepped'),
            '--compensator', self.file('compensator.yaml'), '--trajectory',
            self.file('played.yaml'), '-o', self.file('trajectory.yaml'), *options)

    def identify_uncertainty(self):
        """Drive the stepped sine at other amplitudes and offsets and bound the deviations."""
        bags = []
        for amplitude, offset in ((0.1, 0.0), (0.04, 0.4), (0.04, -0.4)):
            played = self.stepped(
                amplitude * self.description.reach_v, offset * self.description.reach_v)
            bags.append(f'grid_{len(bags)}')
            self.drive(bags[-1], played)
        return self.piezo(
            'uncertainty', 'identify', 'uncertainty', *map(self.file, bags), '--model',
            self.file('trajectory.yaml'), '--compensator', self.file('compensator.yaml'),
            '--trajectory', self.file('played.yaml'), '-o', self.file('bound.yaml'))

    def tune(self, *options):
        """Find gains and predict the errors of scans."""
        self.data_sheet()
        return self.piezo(
            'tune', 'tune', self.file('trajectory.yaml'), '--compensator',
            self.file('compensator.yaml'), '--plant', self.file('rig.yaml'), '--bound',
            self.file('bound.yaml') if self.exit_codes.get('uncertainty') == 0 else 'none',
            '--sample-period-s', self.period_s, '-o', self.file('controller.yaml'), *options)

    @property
    def compensator(self):
        """What was identified of the hysteresis."""
        return read_parameter_set(
            self.file('compensator.yaml'), 'compensator', HysteresisParameters)

    @property
    def controller(self):
        """What was tuned."""
        reach_um = 0.5 * self.description.travel_um
        return read_parameter_set(
            self.file('controller.yaml'), 'controller', ControllerParameters,
            {'command_minimum_um': -reach_um, 'command_maximum_um': reach_um})

    def trajectory(self, **given):
        """Return a scan with the identified dynamics."""
        return read_parameter_set(
            self.file('trajectory.yaml'), 'trajectory', TrajectoryParameters,
            {'sample_period_s': self.period_s, 'harmonics': 0, **given})


def scan(description, compensator, controller, trajectory, seed=99):
    """Run the elements of the package about the true stage; return reference, displacement."""
    reference_um, feedforward_um = map(np.asarray, trajectory_blocks(
        trajectory, compiled=True)(0, trajectory.samples))
    stage = ForeignStage(description, seed)
    law = PiController(controller, trajectory.sample_period_s)
    inverse = InverseHysteresis(compensator)
    displacement_um = np.empty(reference_um.size + 1)
    displacement_um[0] = stage.read(np.zeros(1))[0]
    low_v, high_v = -description.reach_v, description.reach_v
    if controller.scheme in ('ff', 'open_loop'):
        command_um = law.answer(0, reference_um, feedforward_um, np.zeros(reference_um.size))
        voltage_v = inverse.answer(0, command_um)
        displacement_um[1:] = stage.run(np.clip(voltage_v, low_v, high_v))
        return reference_um, displacement_um[:-1]
    for k in range(reference_um.size):
        one = slice(k, k + 1)
        command_um = law.answer(k, reference_um[one], feedforward_um[one], displacement_um[one])
        voltage_v = inverse.answer(k, command_um)
        displacement_um[k + 1] = stage.run(np.clip(voltage_v, low_v, high_v))[0]
    return reference_um, displacement_um[:-1]


def nrmse_percent(reference_um, displacement_um, samples):
    """Return the root mean square error over the span of the reference, of the last samples."""
    error_um = (reference_um - displacement_um)[-samples:]
    return 100.0 * float(np.sqrt(np.mean(error_um**2)) / np.ptp(reference_um[-samples:]))


def compensated_nonlinearity_percent(description, compensator, amplitude_um, seed=7):
    """Return the deviation of a slow compensated scan from a line, rms, percent of its span."""
    stage = ForeignStage(description, seed)
    poles = [*description.before[1], *description.behind[1]]
    slow_hz = min(min(abs(p) for p in poles) / (2.0 * np.pi) / 200.0, 2.0)
    samples = round(1.0 / (slow_hz * description.sample_period_s))
    turns = np.arange(2 * samples) / samples
    command_um = amplitude_um * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))
    displacement_um = stage.drive(InverseHysteresis(compensator).answer(0, command_um))
    last = slice(-samples, None)
    line = np.polyfit(command_um[last], displacement_um[last], 1)
    deviation_um = displacement_um[last] - np.polyval(line, command_um[last])
    return 100.0 * float(np.sqrt(np.mean(deviation_um**2)) / np.ptp(displacement_um[last]))
