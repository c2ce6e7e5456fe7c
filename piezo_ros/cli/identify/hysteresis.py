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

"""``piezo identify hysteresis``: a slow triangle of decreasing amplitude to MRC elements."""

import argparse
import sys
from typing import Any

from piezo_ros.bag import Run
from piezo_ros.cli.identify.common import (
    Identified,
    add_common_arguments,
    identify,
    source,
    with_picture,
)

__all__ = ['add_kind']


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'hysteresis', help='MRC elements, from voltage and displacement of a slow triangle of '
        'decreasing amplitude')
    kind.add_argument(
        '--elements', default='10', metavar='N',
        help="number of voltage-limited elements, or 'auto' (default: 10)")
    kind.add_argument(
        '--used', action='store_true', help='the stage was not virgin at the start')
    kind.add_argument(
        '--range-v', type=float, nargs=2, metavar=('LOW', 'HIGH'),
        help='voltages at which the model will be used; warns of what the bags do not cover')
    kind.add_argument(
        '--every', type=_positive, default=1, metavar='N',
        help='take one of N samples: of a slow triangle the others tell little more')
    kind.add_argument(
        '--compare', action='store_true', help='also fit other models to the same bags')
    add_common_arguments(kind)
    kind.set_defaults(function=lambda options: identify(
        _make, options, every=options.every, hysteresis=True))


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f'{text} is below 1')
    return value


def _make(options: argparse.Namespace, runs: list[Run]) -> Identified:
    import numpy as np

    from piezo_ros.identification import compare_hysteresis_models, fit_hysteresis
    if options.elements != 'auto' and not options.elements.isdigit():
        raise ValueError(f"--elements is {options.elements!r}, allowed is a number or 'auto'")
    elements = 'auto' if options.elements == 'auto' else int(options.elements)
    voltage_v = [run.voltage_v for run in runs]
    displacement_um = [run.displacement_um for run in runs]
    for run in runs:
        missing = int((~np.isfinite(run.displacement_um)).sum())
        if missing:
            print(f'left out of {run.path.name}: {missing} samples that are no numbers')
    fit = fit_hysteresis(
        voltage_v, displacement_um, elements=elements,  # type: ignore[arg-type]
        virgin=not options.used, range_v=tuple(options.range_v) if options.range_v else None)
    print(f'{fit.elements} elements, residual {fit.rms_um * 1e3:.3f} nm rms')
    if fit.coverage.warning:
        print(f'piezo: warning: {fit.coverage.warning}', file=sys.stderr)
    if options.compare:
        print(f'{"model":28}{"parameters":>11}{"rms nm":>10}{"cross-validated nm":>20}')
        for row in compare_hysteresis_models(
                voltage_v, displacement_um, elements=fit.elements, virgin=not options.used):
            print(
                f'{row.name:28}{row.parameters_count:>11}{row.rms_um * 1e3:>10.2f}'
                f'{row.cross_validated_rms_um * 1e3:>20.2f}')
    files = {options.output: fit.to_parameter_yaml(source=source(runs))}
    return Identified(with_picture(files, options, 'residual_figure', fit))
