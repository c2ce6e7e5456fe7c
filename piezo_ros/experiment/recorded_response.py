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

"""Frequency responses out of recorded runs, for identification."""

import dataclasses
import math
from typing import Final

from piezo_ros.bag import BagError, Run
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.excitation import Window
from piezo_ros.control.waveform import excitation_of
from piezo_ros.identification import Amplifier, FrequencyResponse, frequency_response
from piezo_ros.identification.response.frequency_response import ExcludedPoint
from piezo_ros.model import (
    HysteresisParameters,
    MaxwellResistiveCapacitor,
    RigParameters,
)

__all__ = ['recorded_response']

_NOT_RECORDED: Final = 'the record does not hold it as a whole'


def recorded_response(
    run: Run, *, bare: bool = False, closed_loop: bool = False,
    slew_limit_v_per_s: float | None = None, trajectory: TrajectoryParameters | None = None,
    hysteresis: HysteresisParameters | None = None,
) -> FrequencyResponse:
    """
    Return the frequency response of the compensated (or the bare) actuator in a run.

    Parameters
    ----------
    run : Run
        A stepped sine or multisine.
    bare : bool, optional
        From voltage to displacement; from command to displacement by default.
    closed_loop : bool, optional
        From reference to displacement.
    slew_limit_v_per_s : float, optional
        Of the amplifier; what the plant of the bag says by default, or none.
    trajectory : TrajectoryParameters, optional
        What was played; what the trajectory node of the bag says by default.
    hysteresis : HysteresisParameters, optional
        The command is what this hysteresis makes of the recorded voltage: for runs of the bare
        actuator, from a virgin stage on, or of another compensator.

    Returns
    -------
    FrequencyResponse
        Micrometres per micrometre (or per volt); points where the amplifier slews or saturates, or
        that the record does not contain as a whole, are left out and listed.

    Raises
    ------
    BagError
        If the bag lacks a stream or the parameters of the trajectory, or contains no whole point.
    ParameterError
        If the trajectory was no excitation.
    ValueError
        If the record is not one of this excitation, or no point is left.

    """
    if trajectory is None:
        if recorded_node(run, 'trajectory', anywhere=True) is None:
            raise BagError(
                f'{run.path} does not say which trajectory was played, which must be told '
                '(piezo identify: --trajectory FILE)')
        trajectory = recorded_parameters(run, 'trajectory', TrajectoryParameters)
    if trajectory.sample_period_s != run.sample_period_s:
        raise BagError(
            f'{run.path} has the sample period {run.sample_period_s:g} s, its trajectory '
            f'{trajectory.sample_period_s:g} s')
    windows, lost = _windows(run, excitation_of(trajectory).windows)
    if bare:
        input_ = run.voltage_v
    elif hysteresis is not None:
        if run.start_index != 0:
            raise BagError(
                f'{run.path} begins at sample {run.start_index}: what the hysteresis remembers of '
                'the samples before is not known')
        input_ = MaxwellResistiveCapacitor.of(hysteresis).forward(run.voltage_v)[0]
    else:
        input_ = run.reference_um if closed_loop else run.command_um
    response = frequency_response(
        input_, run.displacement_um, run.sample_period_s, excitation=windows,
        voltage_v=run.voltage_v, amplifier=_amplifier(run, slew_limit_v_per_s))
    missing = tuple(
        ExcludedPoint(frequency_hz, trajectory.amplitude, trajectory.offset, _NOT_RECORDED)
        for window in lost for frequency_hz in window.frequency_hz.tolist())
    return dataclasses.replace(response, excluded=response.excluded + missing)


def _windows(run: Run, windows: tuple[Window, ...]) -> tuple[list[Window], list[Window]]:
    """Return the windows inside the record, by its first sample, and those that are not."""
    kept: list[Window] = []
    lost: list[Window] = []
    for window in windows:
        moved = window._replace(
            start=window.start - run.start_index, stop=window.stop - run.start_index)
        (kept if 0 <= moved.start and moved.stop <= run.samples else lost).append(moved)
    if not kept:
        raise BagError(
            f'{run.path} has the samples {run.start_index} … {run.start_index + run.samples - 1}, '
            f'the first frequency of its trajectory needs {windows[0].start} … '
            f'{windows[0].stop - 1}')
    return kept, lost


def _amplifier(run: Run, slew_limit_v_per_s: float | None) -> Amplifier:
    if recorded_node(run, 'plant', anywhere=True) is None:
        return Amplifier(slew_limit_v_per_s or math.inf)
    plant = recorded_parameters(run, 'plant', RigParameters)
    return Amplifier(
        slew_limit_v_per_s or plant.slew_limit_v_per_s or math.inf,
        plant.voltage_minimum_v - plant.operating_point_v,
        plant.voltage_maximum_v - plant.operating_point_v)
