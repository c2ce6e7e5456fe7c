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

"""``piezo identify creep``: the slow motion after a change of the voltage to its share a decade."""

import argparse
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import BagError, Recording
from piezo_ros.bag.recorded_node import recorded_node, recorded_parameters
from piezo_ros.cli.identify.common import (
    Identified,
    add_common_arguments,
    add_verdict_arguments,
    identify,
    source,
    with_picture,
)
from piezo_ros.cli.identify.identify_hysteresis import ReducedRun, reduced_run
from piezo_ros.cli.shared.option_types import TIME_S
from piezo_ros.cli.shared.progress import working
from piezo_ros.experiment.model_file import read_model
from piezo_ros.identification.creep.creep_fit import CreepFit, fit_creep
from piezo_ros.model import HysteresisParameters

__all__ = ['add_kind']

_MOST_POINTS: Final = 8000


class _CreepRun(ReducedRun):
    """A reduced run with the hysteresis that its compensator inverted, where there was one."""

    hysteresis: HysteresisParameters | None = None


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'creep', help='creep, from voltage and displacement after steps or of a long record: what '
        'the compensator inverts for the scheme ff; feedback makes it unnecessary')
    kind.add_argument(
        '--compensator', type=Path, metavar='FILE',
        help='hysteresis that tells the displacement without creep (default: none where the '
        'voltage is held for half of the record, else that of the compensator in the bag)')
    kind.add_argument(
        '--settle-s', type=TIME_S, default=0.02, metavar='T',
        help='left out after each change of a held voltage (default: 0.02)')
    kind.add_argument(
        '--settled', action='store_true',
        help='the stage had rested at the first voltage for long (default: at 0 V)')
    add_common_arguments(kind, bags=1)
    add_verdict_arguments(kind)
    kind.set_defaults(function=lambda options: identify(
        _make, options, hysteresis=True, read=_read))


def _read(recording: Recording, start: int, stop: int) -> ReducedRun:
    run = _CreepRun(*reduced_run(
        recording, start, stop, virgin=True, every=max((stop - start) // _MOST_POINTS, 1),
        answered=True))
    trajectory = recorded_node(recording, 'trajectory', anywhere=True) or {}
    if trajectory.get('output') != 'voltage' and recorded_node(
            recording, 'compensator', anywhere=True) is not None:
        run.hysteresis = recorded_parameters(recording, 'compensator', HysteresisParameters)
    return run


def _make(options: argparse.Namespace, runs: list[ReducedRun]) -> Identified:
    run = runs[0]
    told = None
    if options.compensator:
        told = read_model(options.compensator, HysteresisParameters)
    try:
        fit = _fit(options, run, told)
    except ValueError as error:
        of_bag = getattr(run, 'hysteresis', None)
        if told is not None or of_bag is None:
            raise BagError(f'{run.path}: {error}') from None
        fit = _fit(options, run, of_bag)
    _print(fit)
    files = {options.output: fit.to_parameter_yaml(source=source(runs))}
    return Identified(with_picture(files, options, 'creep_figure', fit), fit.verdict)


def _fit(
    options: argparse.Namespace, run: ReducedRun, hysteresis: HysteresisParameters | None,
) -> CreepFit:
    with working('fitting the creep'):
        return fit_creep(
            run.record, run.sample_period_s, hysteresis=hysteresis, settle_s=options.settle_s,
            is_settled=options.settled)


def _print(fit: CreepFit) -> None:
    p = fit.parameters
    print(
        f'creep {100.0 * p.creep_per_decade:.4g} % a decade, standard error '
        f'{100.0 * fit.standard_error:.2g} %, from {p.creep_start_s:.3g} s to '
        f'{p.creep_end_s:.3g} s')
    print(
        f'drift {1e3 * fit.drift_um_per_s:.3g} nm/s, standard error '
        f'{1e3 * fit.drift_standard_error_um_per_s:.2g} nm/s')
    print(
        f'from {fit.method}; residual {1e3 * fit.rms_um:.3g} nm rms of {fit.points} points, '
        f'{fit.held_out_percent:.3g} % of the last half decade predicted by a fit without it')
