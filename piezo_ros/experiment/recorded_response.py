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

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import BagError, Run, open_recording
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.tables.excitation import Window
from piezo_ros.control.waveform import EXCITATIONS, excitation_of
from piezo_ros.identification import Amplifier, FrequencyResponse, frequency_response
from piezo_ros.identification.response.broadband_response import broadband_response
from piezo_ros.identification.response.detected_excitation import detect_excitation
from piezo_ros.identification.response.frequency_response import ExcludedPoint
from piezo_ros.identification.response.welch_response import welch_response
from piezo_ros.model import (
    HysteresisParameters,
    MaxwellResistiveCapacitor,
    RigParameters,
)
from piezo_ros.series import bridged_series

__all__ = ['recorded_response']

_NOT_RECORDED: Final = 'the record does not hold it as a whole'


def recorded_response(
    run: Run, *, bare: bool = False, closed_loop: bool = False,
    slew_limit_v_per_s: float | None = None, trajectory: TrajectoryParameters | None = None,
    hysteresis: HysteresisParameters | None = None, excitation: str | None = None,
    estimator: str = 'local',
) -> FrequencyResponse:
    """
    Return the frequency response of the compensated (or the bare) actuator in a run.

    Parameters
    ----------
    run : Run
        A stepped sine, a multisine, or a run with any other input that excites all frequencies.
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
        actuator, from a virgin stage on, or of another compensator. Of a part of a bag it
        remembers the voltage before.
    excitation : str, optional
        ``'stepped'``, ``'multisine'``, ``'broadband'`` or ``'auto'``: find the frequencies in the
        record itself. By default they are those of the trajectory, or, where none is known or it is
        no excitation, ``'auto'``.
    estimator : str, optional
        Of a broadband input: ``'local'`` polynomials, or ``'h1'`` or ``'h2'`` over segments.

    Returns
    -------
    FrequencyResponse
        Micrometres per micrometre (or per volt); points where the amplifier slews or saturates, of
        which too many samples are lost, or that the record does not contain as a whole, are left
        out and listed.

    Raises
    ------
    BagError
        If the bag lacks a stream, or contains no whole point.
    ParameterError
        If the trajectory that is told is no excitation.
    ValueError
        If the record is not one of this excitation, or no point is left.

    """
    input_ = _input(run, bare, closed_loop, hysteresis)
    if excitation is None and trajectory is None:
        trajectory = _recorded_excitation(run)
    if trajectory is None or excitation is not None:
        response = _found_response(
            run, input_, excitation or 'auto', estimator, _amplifier(run, slew_limit_v_per_s))
    else:
        response = _told_response(
            run, input_, trajectory, _amplifier(run, slew_limit_v_per_s))
    return dataclasses.replace(response, input_unit='v' if bare else 'um')


def _recorded_excitation(run: Run) -> TrajectoryParameters | None:
    """Return the trajectory that the bag tells, None if there is none or it is no excitation."""
    if recorded_node(run, 'trajectory', anywhere=True) is None:
        return None
    trajectory = recorded_parameters(run, 'trajectory', TrajectoryParameters)
    return trajectory if trajectory.waveform in EXCITATIONS else None


def _input(
    run: Run, bare: bool, closed_loop: bool, hysteresis: HysteresisParameters | None,
) -> NDArray[np.float64]:
    if bare:
        return run.voltage_v
    if hysteresis is not None:
        before_v = _voltage_before(run)
        return _command_of(np.concatenate([before_v, run.voltage_v]), hysteresis)[before_v.size:]
    return run.reference_um if closed_loop else run.command_um


def _voltage_before(run: Run) -> NDArray[np.float64]:
    """Return the voltage from the first sample of a bag to a part of it, which remembers it."""
    if run.start_index == 0:
        return np.zeros(0)
    recording = open_recording(
        run.path, namespace=run.namespace, allow_loss=True, keep_not_finite=True, fill_gaps=True)
    if recording.start_index != 0 or recording.samples < run.start_index:
        raise BagError(
            f'{run.path} begins at sample {recording.start_index}: what the hysteresis remembers '
            'of the samples before is not known')
    return recording.part(0, run.start_index, streams=('voltage',)).voltage_v


def _told_response(
    run: Run, input_: NDArray[np.float64], trajectory: TrajectoryParameters, amplifier: Amplifier,
) -> FrequencyResponse:
    """Return the response at the frequencies of a trajectory."""
    if trajectory.sample_period_s != run.sample_period_s:
        raise BagError(
            f'{run.path} has the sample period {run.sample_period_s:g} s, its trajectory '
            f'{trajectory.sample_period_s:g} s')
    windows, lost = _windows(run, excitation_of(trajectory).windows)
    response = frequency_response(
        input_, run.displacement_um, run.sample_period_s, excitation=windows,
        voltage_v=run.voltage_v, amplifier=amplifier)
    missing = tuple(
        ExcludedPoint(frequency_hz, trajectory.amplitude, trajectory.offset, _NOT_RECORDED)
        for window in lost for frequency_hz in window.frequency_hz.tolist())
    return dataclasses.replace(response, excluded=response.excluded + missing)


def _found_response(
    run: Run, input_: NDArray[np.float64], excitation: str, estimator: str, amplifier: Amplifier,
) -> FrequencyResponse:
    """Return the response at the frequencies that the record itself shows."""
    try:
        found = detect_excitation(input_, run.sample_period_s, excitation)
        if found.kind != 'broadband':
            response = frequency_response(
                input_, run.displacement_um, run.sample_period_s, excitation=found.windows,
                voltage_v=run.voltage_v, amplifier=amplifier)
            words = f'{response.frequency_hz.size + len(response.excluded)} frequencies'
        elif estimator == 'local':
            response = broadband_response(
                input_, run.displacement_um, run.sample_period_s, voltage_v=run.voltage_v,
                amplifier=amplifier)
            words = 'evaluated over all of the record'
        else:
            response = welch_response(
                input_, run.displacement_um, run.sample_period_s, estimator=estimator)
            words = f'evaluated by {estimator}'
    except ValueError as error:
        raise BagError(f'{run.path}: {error}') from None
    return dataclasses.replace(
        response, notes=(f'excitation by the record itself: {found.kind}, {words}',
                         *response.notes))


def _command_of(
    voltage_v: NDArray[np.float64], hysteresis: HysteresisParameters,
) -> NDArray[np.float64]:
    """Return what a hysteresis makes of a voltage; NaN where the voltage is not known."""
    finite = np.isfinite(voltage_v)
    if not finite.any():
        return np.full(voltage_v.size, np.nan)
    # The hysteresis remembers what came before a lost sample, so that this must not end there.
    command_um = MaxwellResistiveCapacitor.of(hysteresis).forward(bridged_series(voltage_v))[0]
    return np.where(finite, command_um, np.nan)


def _windows(run: Run, windows: tuple[Window, ...]) -> tuple[list[Window], list[Window]]:
    """
    Return the windows inside the record, by its first sample, and those that are not.

    Of a multisine the whole periods inside the record are enough.
    """
    kept: list[Window] = []
    lost: list[Window] = []
    for window in windows:
        moved = window._replace(
            start=window.start - run.start_index, stop=window.stop - run.start_index)
        if len(moved.lines) > 1:
            moved = _clipped(moved, run)
        (kept if 0 <= moved.start and moved.stop <= run.samples else lost).append(moved)
    if not kept:
        raise BagError(
            f'{run.path} has the samples {run.start_index} … {run.start_index + run.samples - 1}, '
            f'the first frequency of its trajectory needs {windows[0].start} … '
            f'{windows[0].stop - 1}')
    return kept, lost


def _clipped(window: Window, run: Run) -> Window:
    """Return the part of a window inside the record, as it is if that is below two periods."""
    start, stop = max(window.start, 0), min(window.stop, run.samples)
    two_periods = 2.0 / (window.fundamental_hz * run.sample_period_s)
    return window._replace(start=start, stop=stop) if stop - start >= two_periods else window


def _amplifier(run: Run, slew_limit_v_per_s: float | None) -> Amplifier:
    if recorded_node(run, 'plant', anywhere=True) is None:
        return Amplifier(slew_limit_v_per_s or math.inf)
    plant = recorded_parameters(run, 'plant', RigParameters)
    return Amplifier(
        slew_limit_v_per_s or plant.slew_limit_v_per_s or math.inf,
        plant.voltage_minimum_v - plant.operating_point_v,
        plant.voltage_maximum_v - plant.operating_point_v)
