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

"""Frequency responses of the bags for ``piezo identify dynamics`` and ``uncertainty``."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from piezo_ros.bag import Run
from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import SAMPLE_PERIOD_S, Number
from piezo_ros.cli.shared.progress import working
from piezo_ros.control import TrajectoryParameters
from piezo_ros.experiment.model_file import read_model
from piezo_ros.experiment.recorded_response import recorded_response
from piezo_ros.identification.response.detected_excitation import EXCITATION_KINDS
from piezo_ros.identification.response.frequency_response import FrequencyResponse, merge
from piezo_ros.identification.response.response_csv import read_response
from piezo_ros.model import HysteresisParameters
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.parameter_file import read_parameter_set

__all__ = [
    'add_response_arguments', 'add_table_arguments', 'response_of', 'response_source',
    'responses']

_SLEW_LIMIT: Final = Number(0.0, 1e9, 'V/s')  # 0: none
_OF_BAGS: Final = (
    'from_s', 'to_s', 'trajectory', 'excitation', 'estimator', 'slew_limit_v_per_s')
_OF_PLACES: Final = ('namespace', 'run', 'allow_loss', 'compensator')


def add_response_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe what the bags may not say: the trajectory, the hysteresis, the amplifier."""
    kind.add_argument(
        '--trajectory', type=Path, action='append_any', metavar='FILE',
        help='parameters of the trajectory that was played, where the bag does not say them: '
        'once for all bags or once for each, in their order (default: the frequencies are found '
        'in the record)')
    kind.add_argument(
        '--excitation', choices=('auto', *EXCITATION_KINDS), metavar='KIND',
        help='find the frequencies in the record itself, whatever the trajectory says: auto, '
        'stepped (sine), multisine, or broadband (noise, chirp)')
    kind.add_argument(
        '--estimator', choices=('local', 'h1', 'h2'), default='local',
        help='of a broadband input: local polynomials over the spectrum of the whole record '
        '(default), or segments averaged by h1 (noise in the output) or h2 (in the input)')
    kind.add_argument(
        '--compensator', type=Path, metavar='FILE',
        help='take the command from the voltage by the hysteresis of this file: for runs of '
        'the bare actuator')
    kind.add_argument(
        '--slew-limit-v-per-s', type=_SLEW_LIMIT, metavar='S',
        help='of the amplifier, where the bag does not say it')


def add_table_arguments(kind: argparse.ArgumentParser) -> None:
    """Describe tables of a response that are taken in place of bags, or beside them."""
    kind.add_argument(
        '--from-response', type=Path, action='append', metavar='FILE',
        help='take a ready-made frequency response: CSV or another table with a header (Hz or '
        'rad/s; gain linear or in dB with phase_deg or phase_rad, or real and imaginary), '
        'Touchstone; no bag is needed then')
    kind.add_argument(
        '--sample-period-s', type=SAMPLE_PERIOD_S, metavar='T',
        help='of the record that such a response was made of, behind a zero-order hold '
        '(default: what the file says, else it is that of the continuous stage)')


def response_source(options: argparse.Namespace, runs: list[Run]) -> str:
    """Return where the points of a model are from, for its file."""
    return ', '.join([*(str(run.path) for run in runs), *map(str, options.from_response or [])])


def responses(options: argparse.Namespace, runs: list[Run]) -> list[FrequencyResponse]:
    """Return the response of each bag and table; what was left out of it is printed."""
    tables = getattr(options, 'from_response', None) or []
    if not (runs or tables):
        raise PlanError('no BAG is given, and no --from-response FILE')
    if not tables:
        refuse_without_effect(options, ['sample_period_s'], 'without --from-response')
    if not runs:
        refuse_without_effect(
            options, _OF_BAGS if options.place_from else (*_OF_BAGS, *_OF_PLACES),
            'where no BAG is given')
    if options.excitation:
        refuse_without_effect(options, ['trajectory'], 'beside --excitation')
    if options.excitation not in (None, 'auto', 'broadband'):
        refuse_without_effect(
            options, ['estimator'], f'on the excitation {options.excitation}, but on broadband')
    found = []
    for run, response in _recorded(options, runs) if runs else ():
        _tell(run.path.name, response)
        found.append(response)
    for path in tables:
        response = read_response(path, sample_period_s=options.sample_period_s)
        _tell(path.name, response)
        found.append(response)
    return found


def _tell(name: str, response: FrequencyResponse) -> None:
    """Print what was left out of a response, lost, or assumed of it."""
    for point in response.excluded:
        print(f'left out of {name}: {point.frequency_hz:g} Hz: {point.reason}')
    for loss in response.losses:
        print(f'lost of {name}: {loss}')
    for note in response.notes:
        print(f'{name}: {note}')


def response_of(options: argparse.Namespace, runs: list[Run]) -> FrequencyResponse:
    """Return the response of all bags together, without a word about it."""
    return merge([response for _, response in _recorded(options, runs)])


def _recorded(
    options: argparse.Namespace, runs: list[Run],
) -> Iterator[tuple[Run, FrequencyResponse]]:
    """Yield each bag with its response."""
    played = options.trajectory or [None]
    if len(played) not in (1, len(runs)):
        raise PlanError(
            f'--trajectory is given {len(played)} times for {len(runs)} bags, allowed is once or '
            'once for each')
    hysteresis = None
    if options.compensator:
        hysteresis = read_model(options.compensator, HysteresisParameters)
    for run, path in zip(runs, played * (len(runs) // len(played)), strict=True):
        trajectory = None if path is None else read_parameter_set(
            path, 'trajectory', TrajectoryParameters, {'sample_period_s': run.sample_period_s})
        with working(f'frequency response of {run.path.name}'):
            response = recorded_response(
                run, slew_limit_v_per_s=options.slew_limit_v_per_s, trajectory=trajectory,
                hysteresis=hysteresis, excitation=options.excitation,
                estimator=options.estimator)
        yield run, response
