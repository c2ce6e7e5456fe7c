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

"""``piezo identify dynamics``: a stepped sine or multisine to G(s)."""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.bag import Run
from piezo_ros.cli.identify.common import (
    TABLE_SUFFIX,
    Identified,
    add_common_arguments,
    add_verdict_arguments,
    identify,
    with_picture,
)
from piezo_ros.cli.identify.placing import add_place_arguments, placed_fit
from piezo_ros.cli.identify.responses import (
    add_response_arguments,
    add_table_arguments,
    response_source,
    responses,
)
from piezo_ros.cli.shared.option_types import FREQUENCY_HZ, Number, Whole
from piezo_ros.cli.shared.progress import working
from piezo_ros.experiment.model_file import read_accuracy
from piezo_ros.identification.dynamics.dynamics_fit import STRUCTURES, DynamicsFit
from piezo_ros.parameters.errors import PlanError
from piezo_ros.parameters.provenance import software_versions

__all__ = ['add_kind']

_ORDER: Final = Whole(0, 30)
_DELAY_SAMPLES: Final = Number(0.0, 1e6)
_MOST_CANDIDATES = 4  # that are printed
_NAMED_PERCENT = 1.0  # of a loop, left by the hysteresis model


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'dynamics', help='G(s), (6) or another one that the points ask for, from command and '
        'displacement of a stepped sine, multisine, noise or chirp, or from a table')
    kind.add_argument(
        '--maximum-frequency-hz', type=FREQUENCY_HZ, default=math.inf, metavar='F',
        help='leave out what is above')
    kind.add_argument(
        '--structure', choices=STRUCTURES,
        help='liu: (6); rational: the orders of --orders; auto: (6) where it explains the points '
        'as well as the best model, else the smallest that does (default)')
    kind.add_argument(
        '--orders', type=_ORDER, nargs=2, metavar=('NUM', 'DEN'),
        help='fit a stable rational G(s) of these orders; NUM below DEN')
    kind.add_argument(
        '--delay-samples', type=_DELAY_SAMPLES, default=0.0, metavar='D',
        help='known delay (default: 0)')
    kind.add_argument(
        '--fit-delay', action='store_true', help='fit a delay too, with --orders')
    add_common_arguments(kind, bags='*', report=True, beside=(TABLE_SUFFIX,))
    add_response_arguments(kind)
    add_table_arguments(kind)
    add_place_arguments(kind)
    add_verdict_arguments(kind)
    kind.set_defaults(function=lambda options: identify(
        _make, options, next_step='piezo tune {model} -o controller.yaml'))


def _make(options: argparse.Namespace, runs: list[Run]) -> Identified:
    from piezo_ros.identification import fit_dynamics, merge
    from piezo_ros.identification.place.placed_file import (
        placed_parameter_yaml,
        undecided_parameter_yaml,
    )
    from piezo_ros.identification.place.placed_verdict import with_place
    from piezo_ros.identification.response.response_csv import response_csv
    response = merge(responses(options, runs))
    structure = _structure(options)
    with working('fitting the dynamics'):
        fit = fit_dynamics(
            response, maximum_frequency_hz=options.maximum_frequency_hz,
            delay_samples=options.delay_samples, **structure)
    with working('finding which poles are before the hysteresis'):
        placed = placed_fit(options, fit, response, runs)
    fit, response, place = placed.fit, placed.response, placed.place
    _print(fit)
    for words in placed.words:
        print(words)
    verdict = with_place(
        fit.validation.verdict, place, fit.validation.usable_to_hz, placed.same_to_hz)
    verdict = replace(verdict, reasons=(*verdict.reasons, *_hysteresis_remarks(options, runs)))
    table = options.output.with_suffix(TABLE_SUFFIX)
    text = fit.to_parameter_yaml(response_source(options, runs), {
        'verdict': str(verdict), 'points_file': table.name,
        'samples_used': response.samples_used, 'samples_lost': response.samples_lost,
        'losses': '; '.join([
            *(loss for run in runs for loss in run.lost), *response.losses])})
    files = {
        options.output: placed_parameter_yaml(text, place) if place
        else undecided_parameter_yaml(text),
        table: response_csv(response)}

    def write_report(directory: Path) -> Path:
        from piezo_ros.report.analysis.identification_page import write_dynamics_page
        return write_dynamics_page(
            directory, title=f'Dynamics: {options.output.name}', response=response, fit=fit,
            verdict=verdict, software=software_versions(),
            command=' '.join(['piezo', *sys.argv[1:]]))

    return Identified(
        with_picture(files, options, 'fitted_response_figure', response, fit), verdict,
        write_report)


def _hysteresis_remarks(options: argparse.Namespace, runs: list[Run]) -> list[str]:
    """Return how far the hysteresis model is wrong at the amplitude of the runs, if that shows."""
    if not (options.compensator and runs):
        return []
    accuracy = read_accuracy([options.compensator])
    if not accuracy.level_v:
        return []
    amplitude_v = min(0.5 * float(np.nanmax(run.voltage_v) - np.nanmin(run.voltage_v))
                      for run in runs)
    percent = float(np.interp(amplitude_v, accuracy.level_v, accuracy.level_percent))
    if percent < _NAMED_PERCENT:
        return []
    return [(
        f'the hysteresis model leaves {percent:.2g} % of loops of this size, and the points may be '
        'off by as much')]


def _structure(options: argparse.Namespace) -> dict[str, Any]:
    structure = options.structure or ('rational' if options.orders else 'auto')
    if structure == 'rational':
        if not options.orders:
            raise PlanError('--structure rational needs --orders NUM DEN')
        numerator, denominator = options.orders
        return {
            'structure': structure, 'numerator_order': numerator,
            'denominator_order': denominator, 'fit_delay': options.fit_delay}
    if options.orders:
        raise PlanError(f'--orders belongs to --structure rational, not to {structure}')
    if options.fit_delay:
        raise PlanError(
            '--fit-delay belongs to --orders: (6) has no delay to fit, and --structure auto tries '
            'one by itself')
    return {'structure': structure}


def _print(fit: DynamicsFit) -> None:
    for name, error in fit.standard_errors.items():
        known = f'± {error:.2g}' if math.isfinite(error) else 'not determined'
        print(f'{name:32}{fit.values[name]:14.6g} {known}')
    for candidate in fit.candidates[:_MOST_CANDIDATES]:
        print(f'orders {candidate.name:16} BIC {candidate.criterion:12.1f}')
    validation = fit.validation
    print(
        f'points left out of the fit in turn are explained to '
        f'{validation.held_out_fit_percent:.4g} %, residuals are '
        f'{"" if validation.residual_is_white else "not "}white; usable up to '
        f'{validation.usable_to_hz:.4g} Hz')
