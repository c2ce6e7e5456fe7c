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

each times the amplitude and, in the first ``ramp_periods`` r, times the soft start
(1 - cos(pi n / r)) / 2. Stepped sine and multisine are tables, see
`piezo_ros.control.tables.excitation`, and so is a motion out of a file, see
`piezo_ros.control.tables.motion_table`.

Nothing is accumulated from sample to sample: any sample can be computed alone, in any order, with
the same bits.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

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
    'TRIANGLE',
    'WAVEFORMS',
    'WaveformConstants',
    'WaveformParameters',
    'abrupt_step',
    'excitation_of',
    'motion_of',
    'ramp_step',
    'reference_step',
    'turns_step',
    'waveform_constants',
]

WAVEFORMS = ('triangle', 'sine', 'decreasing_triangle', 'stepped_sine', 'multisine', 'file')
TRIANGLE, SINE, DECREASING_TRIANGLE = range(3)
FILE = WAVEFORMS[5]
REPEATING = WAVEFORMS[:2]  # one period like the other
EXCITATIONS = WAVEFORMS[3:5]  # tables of samples, see piezo_ros.control.tables.excitation
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
        'scheme ff sends; what is repeated is played for periods / frequency_hz',
        change='running')
    amplitude_um: float = parameter(
        1.0, 'um', 'peak amplitude around the operating point', minimum=0.0, maximum=1e4)
    output: str = parameter(
        'displacement', '', 'displacement, or voltage: the waveform itself drives the amplifier, '
        'without controller and compensator', choices=('displacement', 'voltage'),
        change='configuration')
    amplitude_v: float = parameter(
        3.0, 'V', 'peak amplitude where the output is voltage', minimum=0.0, maximum=1e3)
    offset_um: float = parameter(
        0.0, 'um', 'mean of a stepped sine or multisine', minimum=-1e4, maximum=1e4)
    offset_v: float = parameter(
        0.0, 'V', 'mean of a stepped sine or multisine where the output is voltage',
        minimum=-1e3, maximum=1e3)
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
        0.0, '', 'periods of soft start, 0 for the abrupt one of the paper',
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
        nyquist_hz = 0.5 / self.sample_period_s
        # A stepped sine has frequencies of its own.
        if self.waveform != 'stepped_sine' and self.frequency_hz >= nyquist_hz:
            raise ParameterError(
                f'frequency_hz is {self.frequency_hz} Hz, it must be below the Nyquist frequency '
                f'{nyquist_hz:g} Hz of sample_period_s {self.sample_period_s:g} s')
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


def waveform_constants(parameters: WaveformParameters) -> WaveformConstants:
    """Return the constants of the steps."""
    p = parameters
    return WaveformConstants(
        shape=WAVEFORMS.index(p.waveform),
        amplitude=p.amplitude,
        turns_per_sample=p.frequency_hz * p.sample_period_s,
        ramp_turns=p.ramp_periods,
        levels=float(math.ceil(p.periods)))


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
def abrupt_step(constants: WaveformConstants, turns: float) -> float:
    """Return what `reference_step` would without soft start."""
    period = math.floor(turns)
    phase = turns - period
    if constants.shape == SINE:
        value = math.sin(TURN_RAD * phase)
    elif phase < 0.25:
        value = 4.0 * phase
    elif phase < 0.75:
        value = 2.0 - 4.0 * phase
    else:
        value = 4.0 * phase - 4.0
    if constants.shape == DECREASING_TRIANGLE:
        # One period at each level; the level changes where the triangle crosses zero.
        value *= max(0.0, 1.0 - period / constants.levels)
    return constants.amplitude * value
