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
from typing import Any

import yaml

from piezo_ros.bag import Run
from piezo_ros.cli.identify.common import (
    TABLE_SUFFIX,
    Identified,
    add_common_arguments,
    identify,
    with_picture,
)
from piezo_ros.cli.identify.placing import add_place_arguments, placed_model
from piezo_ros.cli.identify.responses import (
    add_response_arguments,
    add_table_arguments,
    response_source,
    responses,
)
from piezo_ros.experiment.model_file import FORMAT_VERSION, RATIONAL_KIND
from piezo_ros.identification.response.dynamics_fit import DynamicsFit

__all__ = ['add_kind']


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'dynamics', help='G(s) of (6), from command and displacement of a stepped sine or '
        'multisine')
    kind.add_argument(
        '--maximum-frequency-hz', type=float, default=math.inf, metavar='F',
        help='leave out what is above')
    kind.add_argument(
        '--orders', type=int, nargs=2, metavar=('NUM', 'DEN'),
        help='fit a stable rational G(s) of these orders in place of (6); for piezo tune, the '
        'nodes know (6) only')
    kind.add_argument(
        '--delay-samples', type=float, default=0.0, metavar='D', help='known delay (default: 0)')
    kind.add_argument(
        '--fit-delay', action='store_true', help='fit a delay too, with --orders')
    add_common_arguments(kind, bags='*')
    add_response_arguments(kind)
    add_table_arguments(kind)
    add_place_arguments(kind)
    kind.set_defaults(function=lambda options: identify(
        _make, options, further_suffixes=(TABLE_SUFFIX,)))


def _make(options: argparse.Namespace, runs: list[Run]) -> Identified:
    from piezo_ros.identification import fit_dynamics, merge
    from piezo_ros.identification.response.response_csv import response_csv
    response = merge(responses(options, runs))
    structure: dict[str, Any] = {}
    if options.orders:
        numerator, denominator = options.orders
        structure = {
            'structure': 'rational', 'numerator_order': numerator,
            'denominator_order': denominator, 'fit_delay': options.fit_delay}
    elif options.fit_delay:
        raise ValueError('--fit-delay belongs to --orders: (6) has no delay to fit')
    fit = fit_dynamics(
        response, maximum_frequency_hz=options.maximum_frequency_hz,
        delay_samples=options.delay_samples, **structure)
    for name, error in fit.standard_errors.items():
        print(f'{name:32}{fit.values[name]:14.6g} ± {error:.2g}')
    source = response_source(options, runs)
    text = _rational_yaml(fit, source) if options.orders else fit.to_parameter_yaml(source=source)
    files = {
        options.output: placed_model(options, text, runs),
        options.output.with_suffix(TABLE_SUFFIX): response_csv(response)}
    return Identified(with_picture(files, options, 'fitted_response_figure', response, fit))


def _rational_yaml(fit: DynamicsFit, source: str) -> str:
    numerator, denominator = fit.polynomials
    return yaml.safe_dump({
        'format_version': FORMAT_VERSION, 'kind': RATIONAL_KIND, 'source': source,
        'numerator': numerator.tolist(), 'denominator': denominator.tolist(),
        'delay_s': fit.delay_s, 'sample_period_s': fit.sample_period_s,
        'standard_errors': dict(fit.standard_errors)}, sort_keys=False)
