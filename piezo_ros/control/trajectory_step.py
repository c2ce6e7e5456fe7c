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
The trajectory generator: reference and feedforward of every sample of a run.

With the waveform w, the soft start r and the feedforward F of (13) in Liu 2015, all functions of
the index k alone::

    y_d[k] = r[k] w[k],   u_ff[k] = r[k] F[k]

Where P periods are exactly M samples, w and F repeat every M samples; in a long run they are
computed once (`trajectory_blocks`).
"""

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final, NamedTuple, TypeVar

from piezo_ros.control.changes import parse_entries
from piezo_ros.control.feedforward import (
    FeedforwardConstants,
    feedforward_constants,
    feedforward_step,
    usual_harmonics,
)
from piezo_ros.control.tables.motion_table import place_step
from piezo_ros.control.tables.table_changes import TableChange, table_changes
from piezo_ros.control.waveform import (
    EXCITATIONS,
    FILE,
    REPEATING,
    WaveformConstants,
    WaveformParameters,
    abrupt_step,
    excitation_of,
    motion_of,
    ramp_step,
    soft_table_step,
    turns_step,
    waveform_constants,
)
from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.parameters import ParameterError, parameter
from piezo_ros.model.step import step

__all__ = [
    'TrajectoryConstants',
    'TrajectoryParameters',
    'trajectory_constants',
    'trajectory_step',
]

_Parameters = TypeVar('_Parameters', bound='TrajectoryParameters')
_USUAL: Final = -1
_MOST_REPEATED: Final = 4096  # samples
_ROUNDING: Final = 2.0**-50  # of the product of frequency and sample period, relative


@dataclass(frozen=True, kw_only=True)
class TrajectoryParameters(WaveformParameters, DynamicsParameters):
    """The desired trajectory and the model that its feedforward inverts."""

    harmonics: int = parameter(
        _USUAL, '', 'highest harmonic m of the feedforward (13); 0: the reference over the dc '
        'gain; -1: 9, or as many as waveform, sampling and model have', minimum=_USUAL,
        maximum=9999)

    model_response: str = parameter(
        'continuous', '', 'which response of the model the feedforward inverts: the continuous one '
        'of the paper, or the sampled one, behind the zero-order hold',
        choices=('continuous', 'sampled'))

    file_changes: str = parameter(
        '', '', 'files that are played from later samples on, a JSON list such as [{"at_sample": '
        '5000, "file": "learned.npz"}]; empty for none')

    def check_together(self) -> None:
        """Refuse harmonics that waveform, sampling or model do not have; put in the usual ones."""
        super().check_together()
        if self.table_changes and self.waveform != FILE:
            raise ParameterError(
                f'file_changes is given and waveform is {self.waveform!r}: only the waveform file '
                'has files that change')
        if self.harmonics == _USUAL:
            object.__setattr__(self, '_has_usual_harmonics', True)
            object.__setattr__(self, 'harmonics', usual_harmonics(
                self, LinearDynamics(self), sampled=self.model_response == 'sampled'))
        _feedforward(self)

    @property
    def table_changes(self) -> tuple[TableChange, ...]:
        """The changes of the file during the run."""
        return table_changes(parse_entries('file_changes', self.file_changes))

    def replaced(self: _Parameters, **values: Any) -> _Parameters:
        """Return a copy with some values replaced; harmonics not given are chosen anew."""
        if getattr(self, '_has_usual_harmonics', False):
            values.setdefault('harmonics', _USUAL)
        return super().replaced(**values)


class TrajectoryConstants(NamedTuple):
    """What the step needs of the parameters; lists in a node, arrays in a kernel."""

    waveform: WaveformConstants
    feedforward: FeedforwardConstants
    table: Any  # (N,) of a stepped sine, a multisine or a file, else empty
    table_feedforward_um: Any  # (N,) of a file with commands, else empty
    first_repeated: int  # sample of the table, see `MotionTable`
    # So many samples, their soft start aside, are repeated for ever; 0 where there is no such
    # number, or it has many digits.
    repeat: int
    repeated_reference_um: Any  # (repeat,), or empty: they need not be known in advance
    repeated_feedforward_um: Any  # as well


@lru_cache(maxsize=64)
def _feedforward(parameters: TrajectoryParameters) -> FeedforwardConstants:
    return feedforward_constants(
        parameters, parameters.harmonics, LinearDynamics(parameters),
        sampled=parameters.model_response == 'sampled')


def trajectory_constants(parameters: TrajectoryParameters) -> TrajectoryConstants:
    """Return the constants of the step as lists."""
    table: list[float] = []
    commands: list[float] = []
    first_repeated = 0
    if parameters.waveform in EXCITATIONS:
        table = excitation_of(parameters).command.tolist()
        first_repeated = len(table) - 1
    elif parameters.waveform == FILE:
        motion = motion_of(parameters)
        table = motion.reference_um.tolist()
        if motion.command_um is not None:
            if parameters.offset_um:
                raise ParameterError(
                    f'{parameters.file}: it has commands, which belong to its own reference: '
                    f'offset_um is {parameters.offset_um} um, allowed is 0')
            commands = motion.command_um.tolist()
        first_repeated = motion.first_repeated
    return TrajectoryConstants(
        waveform_constants(parameters),
        _feedforward(parameters),
        table,
        commands,
        first_repeated,
        _repetition(parameters),
        [], [])


def _repetition(parameters: WaveformParameters) -> int:
    """Return how many samples are repeated, see `TrajectoryConstants`."""
    turns_per_sample = parameters.frequency_hz * parameters.sample_period_s
    ratio = Fraction(turns_per_sample).limit_denominator(_MOST_REPEATED)
    repeats = (
        parameters.waveform in REPEATING
        and abs(float(ratio) - turns_per_sample) <= _ROUNDING * turns_per_sample)
    return ratio.denominator if repeats else 0


@step
def trajectory_step(constants: TrajectoryConstants, index: int) -> tuple[float, float]:
    """Return reference and feedforward of one sample, micrometres."""
    if len(constants.table) > 0:
        place = place_step(len(constants.table), constants.first_repeated, index)
        reference_um = constants.table[place]
        if len(constants.table_feedforward_um) > 0:
            return reference_um, constants.table_feedforward_um[place]
        reference_um = soft_table_step(
            constants.waveform, turns_step(constants.waveform, index), reference_um)
        return reference_um, constants.feedforward.dc_inverse * reference_um
    waveform = constants.waveform
    factor = ramp_step(waveform, turns_step(waveform, index))
    if constants.repeat > 0:
        index = index % constants.repeat
    if len(constants.repeated_reference_um) > 0:
        reference_um = constants.repeated_reference_um[index]
        feedforward_um = constants.repeated_feedforward_um[index]
    else:
        turns = turns_step(waveform, index)
        reference_um = abrupt_step(waveform, turns)
        feedforward_um = feedforward_step(constants.feedforward, turns, reference_um)
    return factor * reference_um, factor * feedforward_um
