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

"""``piezo identify dynamics --place-from``: which poles are before the hysteresis."""

import argparse
import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import BagError, Run, open_recording
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.cli.identify.responses import response_of
from piezo_ros.cli.shared.bag_options import bag_options
from piezo_ros.experiment.model_file import read_model
from piezo_ros.model import DynamicsParameters, HysteresisParameters

__all__ = ['PlacedFit', 'add_place_arguments', 'placed_fit']

if TYPE_CHECKING:
    from piezo_ros.identification.dynamics.identified_dynamics import DynamicsFit
    from piezo_ros.identification.place.hysteresis_place import HysteresisPlace, TimeRecord
    from piezo_ros.identification.place.linearised_fit import LinearisedFit
    from piezo_ros.identification.place.placed_stage import Factors
    from piezo_ros.identification.response.frequency_response import FrequencyResponse

_CLEARLY: Final = 0.9  # share of what other dynamics miss of the record in time
_AS_WELL: Final = 1.1  # factor by which a model misses more that is as good


def add_place_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe the bags that tell where the hysteresis is."""
    kind.add_argument(
        '--place-from', type=Path, action='append', metavar='BAG',
        help='find out which of the poles are before the hysteresis by voltage and displacement of '
        'this bag: of a virgin stage, at the frequencies of the poles and at amplitudes at which '
        'the hysteresis shows. The hysteresis is that of --compensator, else of the compensator in '
        'the bag (default: by the bags of the dynamics, where the hysteresis is known)')


class PlacedFit(NamedTuple):
    """
    A model of the dynamics with what is known of the place of the hysteresis.

    Attributes
    ----------
    fit : DynamicsFit
        The model.
    response : FrequencyResponse
        The points, without what a hysteresis behind poles does to them where that was found.
    place : HysteresisPlace or None
        None where nothing tells it.
    same_to_hz : float
        Up to where it does not matter which of its candidates is right.
    words : tuple of str
        What to print of it.

    """

    fit: 'DynamicsFit'
    response: 'FrequencyResponse'
    place: 'HysteresisPlace | None'
    words: tuple[str, ...]
    same_to_hz: float = math.inf


def placed_fit(
    options: argparse.Namespace, fit: 'DynamicsFit', response: 'FrequencyResponse',
    runs: list[Run],
) -> PlacedFit:
    """
    Find the place of the hysteresis among the poles.

    Where no model explains the points, poles before the hysteresis may be the reason. Those that
    explain them are taken if the records in time ask for poles before the hysteresis too.

    Parameters
    ----------
    options : argparse.Namespace
        The arguments of the command.
    fit : DynamicsFit
        The model of the points as they were measured.
    response : FrequencyResponse
        These points.
    runs : list of Run
        Where they are from.

    Raises
    ------
    BagError
        If a bag that is told cannot be read, does not begin with the run, or knows no hysteresis.
    ValueError
        If such bags are too short, or the trajectory node cannot have the dynamics.

    """
    points = response.below(options.maximum_frequency_hz)
    hysteresis = _known_hysteresis(options, runs)
    if hysteresis is None:
        return PlacedFit(fit, response, *_told_place(options, fit.parameters, runs))
    respond = _respond_of(options, runs)
    records = _time_records(runs)

    @cache
    def of_measured() -> 'tuple[HysteresisPlace | None, tuple[str, ...]]':
        return _told_place(options, fit.parameters, runs)
    if fit.candidates:  # the structure is free
        from piezo_ros.identification.place.linearised_fit import (
            fit_linearised,
            fit_with_poles_before,
        )
        found = fit_linearised(
            fit, points, records, hysteresis, respond, delay_samples=options.delay_samples)
        place = None
        if found and found.fit.parameters:
            place, _ = _told_place(options, found.fit.parameters, runs)
        if found and place and _is_borne_out(place, lambda: of_measured()[0]):
            place = place.decided_by_points()
            if place.is_decided:
                found, place = _with_refined_poles(
                    options, found, place, runs, partial(
                        fit_with_poles_before, points, records, hysteresis, respond,
                        delay_samples=options.delay_samples))
            return PlacedFit(found.fit, found.response, place, (
                f'{found} explains the points: its effect is taken out of them',
                f'place of the hysteresis: {place}'))
    place, words = of_measured()
    if place is None or place.is_decided:
        return PlacedFit(fit, response, place, words)
    from piezo_ros.identification.place.linearised_fit import same_to_hz
    return PlacedFit(fit, response, place, words, same_to_hz(
        points, records, hysteresis, respond,
        [each.before for each in place.candidates if each.has_poles_before]))


def _known_hysteresis(
    options: argparse.Namespace, runs: list[Run],
) -> HysteresisParameters | None:
    """Return the hysteresis behind all the points, None where they are not of runs alone."""
    if options.from_response or not runs or any(run.start_index != 0 for run in runs):
        return None
    try:
        return _hysteresis(options, runs[0])
    except BagError:
        return None


def _respond_of(
    options: argparse.Namespace, runs: list[Run],
) -> 'Callable[[Sequence[NDArray[np.float64]]], FrequencyResponse]':
    """Return what makes points of other displacements in the same runs."""
    def respond(displacements_um: 'Sequence[NDArray[np.float64]]') -> 'FrequencyResponse':
        return response_of(options, [
            run.with_stream('displacement', displacement_um)
            for run, displacement_um in zip(runs, displacements_um, strict=True)])
    return respond


def _told_place(
    options: argparse.Namespace, dynamics: DynamicsParameters | None, runs: list[Run],
) -> 'tuple[HysteresisPlace | None, tuple[str, ...]]':
    """Return the place by the bags that are told, else by the runs, and what to print of it."""
    if options.place_from:
        if dynamics is None:
            raise ValueError('--place-from needs dynamics that the trajectory node has')
        place = _place([_read(path, options) for path in options.place_from], options, dynamics)
    elif dynamics is None:
        return None, ()
    else:
        try:
            place = _place(runs, options, dynamics)
        except (BagError, ValueError) as error:
            return None, (f'place of the hysteresis: undecided, {error}',)
    return place, (f'place of the hysteresis: {place}',)


def _with_refined_poles(
    options: argparse.Namespace, found: 'LinearisedFit', place: 'HysteresisPlace',
    runs: list[Run], fit: 'Callable[[Factors], LinearisedFit | None]',
) -> 'tuple[LinearisedFit, HysteresisPlace]':
    """
    Return the model of the points behind the poles that the records in time put first.

    The points alone hardly tell a lag from a pair that is as slow, but what each does to the loops
    differs at high frequencies. The poles are taken where they explain points and records as well.
    """
    from piezo_ros.identification.place.linearised_fit import SMALLEST_ERROR
    again = fit(place.candidates[0].before)
    if again is None or again.fit.parameters is None:
        return found, place
    if again.fit.model_error > max(_AS_WELL * found.fit.model_error, SMALLEST_ERROR):
        return found, place
    other, _ = _told_place(options, again.fit.parameters, runs)
    if other is None or other.misfit_um > _AS_WELL * place.misfit_um:
        return found, place
    return again, other.decided_by_points()


def _is_borne_out(
    place: 'HysteresisPlace', of_measured: 'Callable[[], HysteresisPlace | None]',
) -> bool:
    """Return whether the records in time too ask for poles before the hysteresis."""
    if not place.candidates[0].has_poles_before:
        return False
    if place.is_decided:
        return True
    other = of_measured()
    return other is None or place.misfit_um < _CLEARLY * other.misfit_um


def _place(
    runs: list[Run], options: argparse.Namespace, dynamics: DynamicsParameters,
) -> 'HysteresisPlace':
    from piezo_ros.identification.place.hysteresis_place import decide_hysteresis_place
    if not runs:
        raise ValueError('as no bag is given')
    for run in runs:
        if run.start_index != 0:
            raise BagError(
                f'{run.path} begins at sample {run.start_index}: what the hysteresis remembers of '
                'the samples before is not known')
    return decide_hysteresis_place(
        _time_records(runs), _hysteresis(options, runs[0]), dynamics)


def _time_records(runs: list[Run]) -> 'list[TimeRecord]':
    from piezo_ros.identification.place.hysteresis_place import TimeRecord
    return [TimeRecord(run.voltage_v, run.displacement_um, run.sample_period_s) for run in runs]


def _read(path: Path, options: argparse.Namespace) -> Run:
    recording = open_recording(path, **bag_options(options), fill_gaps=True)
    return recording.part(0, recording.samples, streams=('voltage', 'displacement'))


def _hysteresis(options: argparse.Namespace, run: Run) -> HysteresisParameters:
    if options.compensator:
        return read_model(options.compensator, HysteresisParameters)
    trajectory = recorded_node(run, 'trajectory', anywhere=True) or {}
    # In a run of the bare actuator the compensator is idle, whatever its parameters are.
    is_bare = trajectory.get('output') == 'voltage'
    if is_bare or recorded_node(run, 'compensator', anywhere=True) is None:
        raise BagError(
            f'{run.path} does not say the hysteresis, which must be told (--compensator FILE)')
    return recorded_parameters(run, 'compensator', HysteresisParameters)
