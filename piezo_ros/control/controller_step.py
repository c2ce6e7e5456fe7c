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
The controller: PI with anti-windup, and the schemes fb, ff, fbff and open_loop.

::

    fb: v = K e      ff: v = u_ff      fbff: v = K e + u_ff      open_loop: v = y_d

The scheme auto stands for fbff or ff. K(s) = kP + kI/s, (8) in Liu 2015, sampled with the backward
rectangle rule for the integral I, d being ``measurement_delay_samples`` and r
``reference_delay_samples``::

    e[k] = y_d[k-r] - y[k-d]
    I[k] = I[k-1] + kI Ts e[k]
    v[k] = clip(u_ff[k] + kP e[k] + I[k], v_min, v_max)

While v is at a limit, the integral is kept from winding up::

    clamping          I[k] = I[k-1] where e drives v further beyond the limit
    back_calculation  I[k] = that value at which v just reaches the limit

A bumpless transfer presets it: I[k] = v[k-1] - u_ff[k] - kP e[k], so that v[k] = v[k-1].

A lead section, z = exp(-wz Ts) of its zero and p = exp(-wp Ts) of its pole, makes the error that
gains and integral act on out of e; its gain is 1 at low frequencies::

    e'[k] = p e'[k-1] + (1 - p)/(1 - z) (e[k] - z e[k-1])

With r = 0, as in the paper, a measurement is compared with a later reference, and feedback works
against a feedforward that is right. With r = d it sees such a feedforward without error.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from piezo_ros import paper
from piezo_ros.control.feedback_condition import feedback_acceptable_below_hz
from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.step import Vector, step

__all__ = [
    'ANTI_WINDUP',
    'AUTO',
    'SCHEMES',
    'ControllerConstants',
    'ControllerParameters',
    'ControllerState',
    'controller_constants',
    'controller_step',
    'initial_state',
    'lead_coefficients',
    'prepare_transfer',
    'recall_measurement',
]

SCHEMES = ('fb', 'ff', 'fbff', 'open_loop')
AUTO = 'auto'
ANTI_WINDUP = ('clamping', 'back_calculation', 'none')
CLAMPING, BACK_CALCULATION, NONE = range(3)
_INTEGRAL_UM, _LAST_COMMAND_UM, _TRANSFER = range(3)
_ERROR_UM, _LED_ERROR_UM, _HAS_ERROR = range(3, 6)


@dataclass(frozen=True, kw_only=True)
class ControllerParameters(ParameterSet):
    """Gains and scheme, Table 2 in Liu 2015 by default."""

    scheme: str = parameter(
        'fbff', '', 'control scheme; auto: fbff where feedback is acceptable at amplitude and '
        'frequency of the scan, else ff',
        choices=(*SCHEMES, AUTO), change='running')
    proportional_gain: float = parameter(
        paper.TABLE_2['proportional_gain'], 'um/um', 'kP', minimum=0.0, maximum=1e6,
        change='running')
    integral_gain_per_s: float = parameter(
        paper.TABLE_2['integral_gain_per_s'], '1/s', 'kI', minimum=0.0, maximum=1e9,
        change='running')
    lead_zero_hz: float = parameter(
        0.0, 'Hz', 'zero of the lead section before the gains, for instance the pole of the '
        'sensor; 0: no lead', minimum=0.0, maximum=1e9, change='running')
    lead_pole_hz: float = parameter(
        0.0, 'Hz', 'pole of the lead section, above its zero; 0: no lead', minimum=0.0,
        maximum=1e9, change='running')
    measurement_delay_samples: int = parameter(
        1, 'samples', 'age d of the measurement in e[k] = y_d[k] - y[k-d]: conversion, computing',
        minimum=0, maximum=1000)
    reference_delay_samples: int = parameter(
        0, 'samples', 'age r of the reference in e[k] = y_d[k-r] - y[k-d]; equal to '
        'measurement_delay_samples, feedback does not work against a feedforward that is right',
        minimum=0, maximum=1000)
    command_minimum_um: float = parameter(
        -8.0, 'um', 'lowest command', minimum=-1e4, maximum=0.0, change='running')
    command_maximum_um: float = parameter(
        8.0, 'um', 'highest command', minimum=0.0, maximum=1e4, change='running')
    anti_windup: str = parameter(
        'clamping', '', 'what the integral does while the command is at a limit',
        choices=ANTI_WINDUP, change='running')
    bumpless_start: bool = parameter(
        True, '', 'preset the integral so that the first command continues the one before')
    feedback_acceptable_frequency_hz: tuple[float, ...] = parameter(
        (0.0,), 'Hz', 'for the scheme auto: frequencies below which feedback lessens the error of '
        'feedforward, one for each of feedback_acceptable_amplitude_um; 0: nowhere, or unknown',
        minimum=0.0, maximum=1e9)
    feedback_acceptable_amplitude_um: tuple[float, ...] = parameter(
        (0.0,), 'um', 'amplitudes at which these hold, ascending; between them straight lines, '
        'beyond them the nearest; one alone holds for all', minimum=0.0, maximum=1e4)
    scan_frequency_hz: float = parameter(
        0.0, 'Hz', 'frequency of the scan, for the scheme auto; 0: unknown',
        minimum=0.0, maximum=1e9)
    scan_amplitude_um: float = parameter(
        0.0, 'um', 'peak amplitude of the scan, for the scheme auto; 0: unknown',
        minimum=0.0, maximum=1e4)

    def check_together(self) -> None:
        """Refuse limits that leave no room, and auto where nothing is known to decide by."""
        if self.command_minimum_um >= self.command_maximum_um:
            raise ParameterError(
                f'command_minimum_um is {self.command_minimum_um} um, it must be below '
                f'command_maximum_um {self.command_maximum_um} um')
        has_pole, has_zero = self.lead_pole_hz > 0.0, self.lead_zero_hz > 0.0
        if has_pole != has_zero or (has_zero and self.lead_pole_hz <= self.lead_zero_hz):
            raise ParameterError(
                f'lead_zero_hz is {self.lead_zero_hz} Hz and lead_pole_hz {self.lead_pole_hz} Hz; '
                'the pole must be above the zero, or both 0')
        amplitudes_um = self.feedback_acceptable_amplitude_um
        frequencies_hz = self.feedback_acceptable_frequency_hz
        if not amplitudes_um or len(amplitudes_um) != len(frequencies_hz):
            raise ParameterError(
                f'feedback_acceptable_amplitude_um has {len(amplitudes_um)} values and '
                f'feedback_acceptable_frequency_hz {len(frequencies_hz)}; there must be as many, '
                'one at least')
        if any(low >= high for low, high in itertools.pairwise(amplitudes_um)):
            raise ParameterError(
                f'feedback_acceptable_amplitude_um is {list(amplitudes_um)} um, the values must '
                'ascend')
        if self.scheme == AUTO:
            self._check_known()

    def _check_known(self) -> None:
        if not any(self.feedback_acceptable_frequency_hz):
            raise ParameterError(
                'scheme is auto, and feedback_acceptable_frequency_hz is 0 Hz at every amplitude: '
                'where feedback is acceptable is not known (piezo tune predicts it), or it is '
                'nowhere, and the scheme is ff')
        needed = ['scan_frequency_hz']
        if len(self.feedback_acceptable_amplitude_um) > 1:
            needed.append('scan_amplitude_um')
        for name in needed:
            if getattr(self, name) == 0.0:
                raise ParameterError(
                    f'scheme is auto, and {name} is 0, which is unknown; with auto it must be '
                    'above 0')

    @property
    def feedback_acceptable_below_hz(self) -> float:
        """Frequency below which feedback is acceptable at the amplitude of the scan."""
        return feedback_acceptable_below_hz(
            self.feedback_acceptable_amplitude_um, self.feedback_acceptable_frequency_hz,
            self.scan_amplitude_um)

    @property
    def concrete_scheme(self) -> str:
        """The scheme, one of `SCHEMES`: what auto stands for at the operating point."""
        if self.scheme != AUTO:
            return self.scheme
        return 'fbff' if self.scan_frequency_hz < self.feedback_acceptable_below_hz else 'ff'

    @property
    def uses_feedback(self) -> bool:
        """Whether the scheme closes the loop."""
        return self.concrete_scheme in ('fb', 'fbff')

    @property
    def uses_feedforward(self) -> bool:
        """Whether the scheme adds the feedforward."""
        return self.concrete_scheme in ('ff', 'fbff')


class ControllerConstants(NamedTuple):
    """What the step needs of the parameters."""

    uses_feedback: bool
    uses_feedforward: bool
    proportional_gain: float
    integral_gain: float  # kI Ts
    minimum_um: float
    maximum_um: float
    anti_windup: int
    measurements: int  # d + 1, how many are remembered
    lead_gain: float  # (1 - p)/(1 - z); 0 for no lead
    lead_zero: float  # z
    lead_pole: float  # p


class ControllerState(NamedTuple):
    """Everything the controller remembers; lists in a node, arrays in a kernel."""

    # (6,) integral, last command, whether a bumpless transfer is due; of the sample before: the
    # error, the error behind the lead, whether these are known
    memory: Vector
    measured_um: Vector  # (d + 1,) the last measurements, by index modulo d + 1
    reference_um: Vector  # (r + 1,) the last references, by index modulo r + 1


def controller_constants(
    parameters: ControllerParameters, sample_period_s: float,
) -> ControllerConstants:
    """Return the constants of the step."""
    p = parameters
    lead_gain, lead_zero, lead_pole = 0.0, 0.0, 0.0
    if p.lead_zero_hz > 0.0:
        lead_gain, lead_zero, lead_pole = lead_coefficients(
            p.lead_zero_hz, p.lead_pole_hz, sample_period_s)
    return ControllerConstants(
        p.uses_feedback, p.uses_feedforward, p.proportional_gain,
        p.integral_gain_per_s * sample_period_s, p.command_minimum_um, p.command_maximum_um,
        ANTI_WINDUP.index(p.anti_windup), p.measurement_delay_samples + 1,
        lead_gain, lead_zero, lead_pole)


def lead_coefficients(
    zero_hz: float, pole_hz: float, sample_period_s: float,
) -> tuple[float, float, float]:
    """
    Return gain, zero z and pole p of a sampled lead section.

    Parameters
    ----------
    zero_hz, pole_hz : float
        Its zero and its pole, above 0.
    sample_period_s : float
        Sample period, seconds.

    Examples
    --------
    The gain at the Nyquist frequency is nearly the ratio of pole and zero where both are far below:

    >>> gain, zero, pole = lead_coefficients(100.0, 300.0, 1e-5)
    >>> round(gain * (1.0 + zero) / (1.0 + pole), 2)
    3.0

    """
    turn_s = -2.0 * math.pi * sample_period_s
    # expm1 where the zero is so slow that 1 - z would round to nothing.
    return (
        math.expm1(turn_s * pole_hz) / math.expm1(turn_s * zero_hz),
        math.exp(turn_s * zero_hz), math.exp(turn_s * pole_hz))


def initial_state(
    parameters: ControllerParameters, vector: Callable[[list[float]], Any] = list,
) -> ControllerState:
    """
    Return the state before the first sample: no integral, last command zero.

    Parameters
    ----------
    parameters : ControllerParameters
        The controller.
    vector : callable, optional
        Makes the vectors: ``list`` for a node, ``numpy.array`` for a kernel.

    """
    due = 1.0 if parameters.bumpless_start else 0.0
    return ControllerState(
        vector([0.0, 0.0, due, 0.0, 0.0, 0.0]),
        vector([0.0] * (parameters.measurement_delay_samples + 1)),
        vector([0.0] * (parameters.reference_delay_samples + 1)))


def prepare_transfer(state: ControllerState) -> None:
    """Make the transfer at the next sample bumpless, whatever gains and scheme it will have."""
    state.memory[_TRANSFER] = 1.0


def recall_measurement(state: ControllerState, index: int, displacement_um: float) -> None:
    """Keep a measurement of a sample at which the scheme did not use it."""
    measured = state.measured_um
    if index == 0:
        for i in range(len(measured)):
            measured[i] = displacement_um
    measured[index % len(measured)] = displacement_um


@step
def _through(ring_um: Vector, index: int, value_um: float) -> float:
    """Keep the value of a sample and return the oldest one that is kept."""
    slots = len(ring_um)
    if slots == 1:  # nothing is delayed: a division of integers takes as long as all the rest
        ring_um[0] = value_um
        return value_um
    ring_um[index % slots] = value_um
    oldest_um: float = ring_um[(index + 1) % slots]
    return oldest_um


@step
def controller_step(
    state: ControllerState, constants: ControllerConstants, index: int, reference_um: float,
    feedforward_um: float, displacement_um: float,
) -> float:
    """
    Return the command of one sample, micrometres.

    Parameters
    ----------
    state : ControllerState
        What the controller remembers; it moves on by a sample.
    constants : ControllerConstants
        Gains and scheme.
    index : int
        Index of the sample, from the start of the run.
    reference_um, feedforward_um, displacement_um : float
        y_d[k], u_ff[k] and y[k], micrometres.

    Examples
    --------
    An error of 1 um: the proportional part, and an integral that grows by kI Ts each sample.

    >>> law = ControllerParameters(
    ...     scheme='fb', proportional_gain=0.5, integral_gain_per_s=1000.0, bumpless_start=False)
    >>> constants, state = controller_constants(law, 1e-3), initial_state(law)
    >>> [controller_step(state, constants, k, 1.0, 0.0, 0.0) for k in range(3)]
    [1.5, 2.5, 3.5]

    """
    measured = state.measured_um
    reference = state.reference_um
    if index == 0:
        # Before the first sample stage and reference were where they are now.
        for i in range(len(measured)):
            measured[i] = displacement_um
        for i in range(len(reference)):
            reference[i] = reference_um
    measured_um = _through(measured, index, displacement_um)
    aimed_um = _through(reference, index, reference_um)
    memory = state.memory
    base_um = 0.0
    if constants.uses_feedforward:
        base_um = feedforward_um
    elif not constants.uses_feedback:
        base_um = reference_um
    if constants.uses_feedback:
        error_um = aimed_um - measured_um
        raw_um = error_um
        if constants.lead_gain > 0.0 and memory[_HAS_ERROR] > 0.0:
            error_um = constants.lead_pole * memory[_LED_ERROR_UM] + constants.lead_gain * (
                raw_um - constants.lead_zero * memory[_ERROR_UM])
        # Without a sample before, the error counts as one that has always been there.
        memory[_ERROR_UM] = raw_um
        memory[_LED_ERROR_UM] = error_um
        memory[_HAS_ERROR] = 1.0
        base_um += constants.proportional_gain * error_um
        if memory[_TRANSFER] > 0.0:
            held_um = memory[_LAST_COMMAND_UM] - base_um
            integral_um = held_um
        else:
            held_um = memory[_INTEGRAL_UM]
            integral_um = held_um + constants.integral_gain * error_um
        wanted_um = base_um + integral_um
    else:
        error_um = 0.0
        held_um = 0.0
        integral_um = 0.0
        wanted_um = base_um
        memory[_HAS_ERROR] = 0.0
    memory[_TRANSFER] = 0.0
    command_um = wanted_um
    if wanted_um > constants.maximum_um:
        command_um = constants.maximum_um
    elif wanted_um < constants.minimum_um:
        command_um = constants.minimum_um
    if command_um != wanted_um:
        if constants.anti_windup == BACK_CALCULATION:
            integral_um += command_um - wanted_um
        elif constants.anti_windup == CLAMPING and error_um * (wanted_um - command_um) > 0.0:
            integral_um = held_um
    memory[_INTEGRAL_UM] = integral_um
    memory[_LAST_COMMAND_UM] = command_um
    return command_um
