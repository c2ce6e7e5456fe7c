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

"""``piezo identify uncertainty``: W(s) above every measured deviation from a model."""

import argparse
from pathlib import Path
from typing import Any, Final

import yaml

from piezo_ros.bag import Run
from piezo_ros.cli.identify.common import (
    Identified,
    add_common_arguments,
    identify,
    source,
    with_picture,
)
from piezo_ros.cli.identify.responses import add_response_arguments, responses
from piezo_ros.cli.shared.option_types import Whole
from piezo_ros.cli.shared.progress import working
from piezo_ros.experiment.model_file import BOUND_KIND, FORMAT_VERSION, read_model
from piezo_ros.model import DynamicsParameters, LinearDynamics

__all__ = ['add_kind']

_ORDER: Final = Whole(1, 20)


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'uncertainty', help='W(s) above every measured deviation from a model')
    kind.add_argument(
        '--model', type=Path, required=True, metavar='FILE', help='what identify dynamics wrote')
    kind.add_argument('--order', type=_ORDER, default=2, help='of W(s) (default: 2)')
    add_common_arguments(kind)
    add_response_arguments(kind)
    kind.set_defaults(function=lambda options: identify(_make, options))


def _make(options: argparse.Namespace, runs: list[Run]) -> Identified:
    import numpy as np

    from piezo_ros.identification import uncertainty_bound
    model = LinearDynamics(read_model(options.model, DynamicsParameters))
    period_s = runs[0].sample_period_s
    measured = responses(options, runs)
    with working('bounding the uncertainty'):
        bound = uncertainty_bound(
            measured, lambda frequency_hz: model.sampled_response(frequency_hz, period_s),
            order=options.order)
    print(
        f'|W| is above every one of {bound.frequency_hz.size} points, on average '
        f'{bound.mean_excess_db:.2f} dB above their maximum at each frequency')
    numerator, denominator = (
        np.atleast_1d(part[0][0]).tolist()
        for part in (bound.transfer_function.num, bound.transfer_function.den))
    files = {options.output: yaml.safe_dump({
        'format_version': FORMAT_VERSION, 'kind': BOUND_KIND, 'source': source(runs),
        'numerator': numerator, 'denominator': denominator}, sort_keys=False)}
    return Identified(with_picture(files, options, 'bound_figure', bound))
