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
Desired trajectories as scalar functions of the sample's index.

With n = f Ts k, the periods since the start, and the phase p = n - floor(n)::

    triangle             4 p  (p < 1/4),   2 - 4 p  (p < 3/4),   4 p - 4
    sine                 sin(2 pi p)
    decreasing_triangle  triangle times max(0, 1 - floor(n) / periods)
    lissajous            sin(2 pi (c n + phase)),   c the cycles of its axis, phase that of axis 2
    spiral               n/periods times sin(2 pi p) (axis 1) or cos(2 pi p) (axis 2)

A triangle with parabolic turns, the sawtooth and the staircase are in
`piezo_ros.control.shapes.periodic_shapes`. To each times the amplitude the offset is added, and in
the first ``ramp_periods`` r all of it is multiplied by the soft start (1 - cos(pi n / r)) / 2.
Stepped sine and multisine are tables, see `piezo_ros.control.tables.excitation`, and so is a motion
out of a file, see `piezo_ros.control.tables.motion_table`.

Nothing is accumulated from sample to sample: any sample can be computed alone, in any order, with
the same bits.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from piezo_ros.control.shapes.periodic_shapes import (
    TurningShape,
    staircase_step,
    straight_triangle_step,
    turning_shape,
    turning_step,
)
from piezo_ros.control.tables.excitation import Excitation, multisine, stepped_sine
from piezo_ros.control.tables.motion_table import MotionTable, MotionTableError, read_motion_table
from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.step import step

__all__ = [
    'DECREASING_TRIANGLE',
    'EXCITATIONS',
    'FILE',
    'REPEATING',
    'SINE',
    'SPIRAL',
    'TRIANGLE',
    'WAVEFORMS',
    'WaveformConstants',
    'WaveformParameters',
    'abrupt_step',
    'cycle_step',
    'excitation_of',
    'motion_of',
    'ramp_step',
    'reference_step',
    'soft_table_step',
    'turns_step',
    'waveform_constants',
]

WAVEFORMS = (
    'triangle', 'sine', 'decreasing_triangle', 'stepped_sine', 'multisine', 'file', 'sawtooth',
    'staircase', 'lissajous', 'spiral')
TRIANGLE, SINE, DECREASING_TRIANGLE = range(3)
SAWTOOTH, STAIRCASE, LISSAJOUS, SPIRAL = range(6, 10)
FILE = WAVEFORMS[5]
REPEATING = (*WAVEFORMS[:2], *WAVEFORMS[6:9])  # one period like the other
EXCITATIONS = WAVEFORMS[3:5]  # tables of samples, see piezo_ros.control.tables.excitation
_TURNING = ('triangle', 'decreasing_triangle', 'sawtooth', 'staircase')
TURN_RAD = 2.0 * math.pi
MOST_SAMPLES = 2**53  # an index is exact in a float64
MOST_TABLE_SAMPLES = 10**8


@dataclass(frozen=True, kw_only=True)
class WaveformParameters(ParameterSet):
    """The desired trajectory."""

    waveform: str = parameter(
        'triangle', '', 'shape of the desired displacement', choices=WAVEFORMS)
    file: str = parameter(
        '', '', 'CSV or NPZ file of the waveform file: reference_um, and command_um, which the '
        'scheme ff sends; what is repeated is played for periods / frequency_hz; piezo bag motion '
        'makes it of the streams of a bag', change='running')
    amplitude_um: float = parameter(
        1.0, 'um', 'peak amplitude around the operating point', minimum=0.0, maximum=1e4)
    output: str = parameter(
        'displacement', '', 'displacement, or voltage: the waveform itself drives the amplifier, '
        'without controller and compensator', choices=('displacement', 'voltage'),
        change='configuration')
    amplitude_v: float = parameter(
        3.0, 'V', 'peak amplitude where the output is voltage', minimum=0.0, maximum=1e3)
    offset_um: float = parameter(
        0.0, 'um', 'mean of the waveform, reached in the soft start', minimum=-1e4, maximum=1e4)
    offset_v: float = parameter(
        0.0, 'V', 'mean of the waveform where the output is voltage', minimum=-1e3, maximum=1e3)
    turn_fraction: float = parameter(
        0.0, '', 'share of each line of a triangle or sawtooth that is spent in parabolic turns, '
        'half of it at each end; of a staircase, share of each stair that the smooth step takes',
        minimum=0.0, maximum=1.0)
    flyback_fraction: float = parameter(
        0.1, '', 'share of the period in which a sawtooth goes back', minimum=0.01, maximum=0.99)
    stairs: int = parameter(
        8, '', 'steps of a staircase from its middle to its peak', minimum=1, maximum=10**6)
    # A number, as a bare y in a parameter file is a truth value for ROS.
    axis: int = parameter(
        1, '', 'axis of a lissajous figure or a spiral: 1 is x, 2 is y', minimum=1, maximum=2)
    lissajous_cycles: tuple[float, ...] = parameter(
        (1.0, 2.0), '', 'periods of axes 1 and 2 in a period of the whole lissajous figure, '
        'that of frequency_hz', minimum=1.0, maximum=1e6)
    lissajous_phase: float = parameter(
        0.0, '', 'phase of axis 2 of a lissajous figure at its start, in turns',
        minimum=-1.0, maximum=1.0)
    frequencies_hz: tuple[float, ...] = parameter(
        (100.0, 200.0, 500.0, 1000.0), 'Hz',
        'frequencies of a stepped sine; of a multisine, the nearest odd or even multiples of '
        'frequency_hz', minimum=1e-6, maximum=1e9)
    dwell_s: float = parameter(
        0.1, 's', 'time that a stepped sine is evaluated at each frequency, at least 8 periods',
        minimum=0.0, maximum=1e6)
    settle_s: float = parameter(
        0.01, 's', 'time that a stepped sine lets pass before, at least 3 periods; longer than the '
        'slowest resonance rings', minimum=0.0, maximum=1e6)
    frequency_hz: float = parameter(
        300.0, 'Hz', 'fundamental frequency', minimum=1e-6, maximum=1e9)
    periods: float = parameter(
        15.0, '', 'number of periods', minimum=1e-6, maximum=1e9)
    ramp_periods: float = parameter(
        0.0, '', 'periods of soft start, 0 for the abrupt one of the paper; stepped sine and '
        'multisine, and files with commands, have a start of their own',
        minimum=0.0, maximum=1e9)
    sample_period_s: float = parameter(
        1e-5, 's', 'simulated sample period', minimum=1e-9, maximum=1e3)

    def check_together(self) -> None:
        """Refuse what cannot be sampled."""
        super().check_together()
        if (self.waveform == FILE) != bool(self.file):
            raise ParameterError(
                f'file is {self.file!r} and waveform {self.waveform!r}: a file belongs to the '
                'waveform file, and to no other')
        if self.waveform == FILE and self.output == 'voltage':
            raise ParameterError(
                'output is voltage: the waveform file has displacements, allowed is displacement')
        if self.turn_fraction and self.waveform not in _TURNING:
            raise ParameterError(
                f'turn_fraction is {self.turn_fraction} and waveform {self.waveform!r}: allowed is '
                f'0, only {", ".join(_TURNING)} have turns')
        cycles = self.lissajous_cycles
        if len(cycles) != 2 or not all(each.is_integer() for each in cycles):
            raise ParameterError(
                f'lissajous_cycles is {list(cycles)}, it must be two integers, of axes 1 and 2')
        nyquist_hz = 0.5 / self.sample_period_s
        # A stepped sine has frequencies of its own.
        if self.waveform != 'stepped_sine' and self.fundamental_hz >= nyquist_hz:
            axis = f' (of axis {self.axis}: {self.fundamental_hz:g} Hz)' * (self.cycles > 1)
            raise ParameterError(
                f'frequency_hz is {self.frequency_hz} Hz{axis}, it must be below the Nyquist '
                f'frequency {nyquist_hz:g} Hz of sample_period_s {self.sample_period_s:g} s')
        if self.waveform != FILE and self.samples < 2:
            raise ParameterError(
                f'periods is {self.periods}, which makes {self.samples} samples; at least 2 are '
                'needed')
        if self.waveform != FILE and self.samples > MOST_SAMPLES:
            raise ParameterError(
                f'periods is {self.periods}, which makes {self.samples} samples; indices end at '
                f'{MOST_SAMPLES}')

    @property
    def amplitude(self) -> float:
        """Peak amplitude of the output, micrometres or volts."""
        return self.amplitude_v if self.output == 'voltage' else self.amplitude_um

    @property
    def offset(self) -> float:
        """Mean of the output, micrometres or volts."""
        return self.offset_v if self.output == 'voltage' else self.offset_um

    @property
    def cycles(self) -> float:
        """Periods of the axis in a period of the waveform: those of a lissajous figure, else 1."""
        return self.lissajous_cycles[self.axis - 1] if self.waveform == 'lissajous' else 1.0

    @property
    def fundamental_hz(self) -> float:
        """Frequency of the first harmonic, hertz."""
        return self.cycles * self.frequency_hz

    @property
    def flyback(self) -> float:
        """Share of the period from the positive to the negative peak."""
        return self.flyback_fraction if self.waveform == 'sawtooth' else 0.5

    @property
    def samples(self) -> int:
        """Number of samples of the whole run."""
        if self.waveform in EXCITATIONS:
            return int(excitation_of(self).command.size)
        if self.waveform == FILE and (motion := motion_of(self)).repeat_from is None:
            return motion.reference_um.size
        return round(self.periods / (self.frequency_hz * self.sample_period_s))


@lru_cache(maxsize=16)
def excitation_of(parameters: WaveformParameters) -> Excitation:
    """
    Return the samples of a stepped sine or multisine and the windows to evaluate.

    The same parameters give the same windows: those in a bag tell how to read it.

    Parameters
    ----------
    parameters : WaveformParameters
        The trajectory.

    Raises
    ------
    ParameterError
        If the waveform is another one, or a frequency is not below Nyquist.

    """
    p = parameters
    longest_s = p.periods / p.frequency_hz
    if p.waveform == 'stepped_sine':
        longest_s = sum(
            max(p.dwell_s, 8.0 / frequency_hz) + max(p.settle_s, 3.0 / frequency_hz)
            for frequency_hz in p.frequencies_hz)
    if longest_s / p.sample_period_s > MOST_TABLE_SAMPLES:
        raise ParameterError(
            f'a {p.waveform} of {longest_s:g} s has more than {MOST_TABLE_SAMPLES} samples of '
            f'{p.sample_period_s:g} s')
    try:
        if p.waveform == 'stepped_sine':
            return stepped_sine(
                p.frequencies_hz, p.amplitude, p.sample_period_s, offset=p.offset,
                dwell_s=p.dwell_s, settle_s=p.settle_s)
        if p.waveform == 'multisine':
            lines = sorted({max(1, round(f / p.frequency_hz)) for f in p.frequencies_hz})
            return multisine(
                p.frequency_hz, lines, p.amplitude, p.sample_period_s, offset=p.offset,
                periods=max(1, round(p.periods)))
    except ValueError as error:
        raise ParameterError(str(error)) from None
    raise ParameterError(f'waveform is {p.waveform!r}, allowed are {", ".join(EXCITATIONS)}')


def motion_of(parameters: WaveformParameters) -> MotionTable:
    """
    Return the motion of the waveform file.

    It is read where it is needed: what is known of a run does not depend on a file being there.

    Raises
    ------
    MotionTableError
        If the file cannot be read or is no motion of this sample period.

    """
    path = Path(parameters.file)
    try:
        state = path.stat()
    except OSError as error:
        raise MotionTableError(f'{path}: {error.strerror or error}') from None
    return _motion(path, parameters.sample_period_s, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _motion(path: Path, sample_period_s: float, modified_ns: int, size: int) -> MotionTable:
    return read_motion_table(path, sample_period_s)


class WaveformConstants(NamedTuple):
    """What the steps need of the parameters."""

    shape: int
    amplitude: float  # micrometres or volts
    turns_per_sample: float
    ramp_turns: float
    levels: float  # periods over which a decreasing triangle vanishes
    offset: float  # micrometres or volts
    cycles: float  # of the axis in a period
    phase: float  # of the axis at the start, in turns
    growth_per_turn: float  # of a spiral, as a share of its amplitude
    turning: TurningShape
    stairs: float
    turn_fraction: float


def waveform_constants(parameters: WaveformParameters) -> WaveformConstants:
    """Return the constants of the steps."""
    p = parameters
    return WaveformConstants(
        shape=WAVEFORMS.index(p.waveform),
        amplitude=p.amplitude,
        turns_per_sample=p.frequency_hz * p.sample_period_s,
        ramp_turns=0.0 if p.waveform in EXCITATIONS else p.ramp_periods,
        levels=float(math.ceil(p.periods)),
        offset=0.0 if p.waveform in EXCITATIONS else p.offset,
        cycles=p.cycles,
        phase=_phase(p),
        growth_per_turn=1.0 / p.periods,
        turning=turning_shape(p.flyback, p.turn_fraction),
        stairs=float(p.stairs),
        turn_fraction=p.turn_fraction)


def _phase(parameters: WaveformParameters) -> float:
    if parameters.axis == 1:
        return 0.0
    return {'lissajous': parameters.lissajous_phase, 'spiral': 0.25}.get(parameters.waveform, 0.0)


@step
def turns_step(constants: WaveformConstants, index: int) -> float:
    """Return the number of periods since the start of the run."""
    return constants.turns_per_sample * index


@step
def ramp_step(constants: WaveformConstants, turns: float) -> float:
    """Return the factor of the soft start: a raised cosine from 0 to 1."""
    if turns >= constants.ramp_turns:
        return 1.0
    return 0.5 - 0.5 * math.cos(0.5 * TURN_RAD * turns / constants.ramp_turns)


@step
def reference_step(constants: WaveformConstants, turns: float) -> float:
    """
    Return the desired displacement, micrometres (or the voltage, volts).

    Examples
    --------
    >>> constants = waveform_constants(WaveformParameters(waveform='triangle', amplitude_um=2.0))
    >>> [reference_step(constants, turns) for turns in (0.0, 0.125, 0.25, 0.5, 0.75, 1.0)]
    [0.0, 1.0, 2.0, 0.0, -2.0, 0.0]

    """
    return ramp_step(constants, turns) * abrupt_step(constants, turns)


@step
def soft_table_step(constants: WaveformConstants, turns: float, value: float) -> float:
    """Return a sample of a table without commands, with its offset and its soft start."""
    if constants.offset != 0.0:
        value += constants.offset
    if constants.ramp_turns > 0.0:
        value *= ramp_step(constants, turns)
    return value


@step
def cycle_step(constants: WaveformConstants, turns: float) -> float:
    """Return the number of periods of the axis since its phase 0."""
    return constants.cycles * turns + constants.phase


@step
def abrupt_step(constants: WaveformConstants, turns: float) -> float:
    """Return what `reference_step` would without soft start."""
    cycle = cycle_step(constants, turns)
    period = math.floor(cycle)
    phase = cycle - period
    shape = constants.shape
    if shape in (SINE, LISSAJOUS, SPIRAL):
        value = math.sin(TURN_RAD * phase)
    elif shape == STAIRCASE:
        value = staircase_step(
            constants.stairs, constants.turn_fraction, straight_triangle_step(phase))
    elif shape == SAWTOOTH or constants.turn_fraction > 0.0:
        value = turning_step(constants.turning, phase)
    else:
        value = straight_triangle_step(phase)
    if shape == DECREASING_TRIANGLE:
        # One period at each level; the level changes where the triangle crosses zero.
        value *= max(0.0, 1.0 - period / constants.levels)
    elif shape == SPIRAL:
        value *= constants.growth_per_turn * turns
    value *= constants.amplitude
    return value + constants.offset if constants.offset != 0.0 else value
