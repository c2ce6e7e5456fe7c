"""
Desired trajectories as scalar functions of the sample's index.

Nothing is accumulated from sample to sample: any sample can be computed alone, in any order, with
the same bits.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.step import step

__all__ = [
    'DECREASING_TRIANGLE',
    'SINE',
    'TRIANGLE',
    'WAVEFORMS',
    'WaveformConstants',
    'WaveformParameters',
    'ramp_step',
    'reference_step',
    'turns_step',
    'waveform_constants',
]

WAVEFORMS = ('triangle', 'sine', 'decreasing_triangle')
TRIANGLE, SINE, DECREASING_TRIANGLE = range(3)
TURN_RAD = 2.0 * math.pi
MOST_SAMPLES = 2**53  # an index is exact in a float64


@dataclass(frozen=True, kw_only=True)
class WaveformParameters(ParameterSet):
    """The desired trajectory."""

    waveform: str = parameter(
        'triangle', '', 'shape of the desired displacement', choices=WAVEFORMS)
    amplitude_um: float = parameter(
        1.0, 'um', 'peak amplitude around the operating point', minimum=0.0, maximum=1e4)
    output: str = parameter(
        'displacement', '', 'displacement, or voltage: the waveform itself drives the amplifier, '
        'without controller and compensator', choices=('displacement', 'voltage'))
    amplitude_v: float = parameter(
        3.0, 'V', 'peak amplitude where the output is voltage', minimum=0.0, maximum=1e3)
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
        nyquist_hz = 0.5 / self.sample_period_s
        if self.frequency_hz >= nyquist_hz:
            raise ParameterError(
                f'frequency_hz is {self.frequency_hz} Hz, it must be below the Nyquist frequency '
                f'{nyquist_hz:g} Hz of sample_period_s {self.sample_period_s:g} s')
        if self.samples < 2:
            raise ParameterError(
                f'periods is {self.periods}, which makes {self.samples} samples; at least 2 are '
                'needed')
        if self.samples > MOST_SAMPLES:
            raise ParameterError(
                f'periods is {self.periods}, which makes {self.samples} samples; indices end at '
                f'{MOST_SAMPLES}')

    @property
    def amplitude(self) -> float:
        """Peak amplitude of the output, micrometres or volts."""
        return self.amplitude_v if self.output == 'voltage' else self.amplitude_um

    @property
    def samples(self) -> int:
        """Number of samples of the whole run."""
        return round(self.periods / (self.frequency_hz * self.sample_period_s))


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
    """Return the desired displacement, micrometres (or the voltage, volts)."""
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
    return constants.amplitude * ramp_step(constants, turns) * value
