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

"""``piezo identify``: models out of bags, as parameter files that the nodes load unchanged."""

import argparse
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml

from piezo_ros.bag import BagError, Run, open_recording
from piezo_ros.cli.bag_options import add_bag_options, bag_options
from piezo_ros.control import TrajectoryParameters
from piezo_ros.experiment.model_file import BOUND_KIND, FORMAT_VERSION, RATIONAL_KIND
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    ParameterError,
)
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.report.files import write_atomically

if TYPE_CHECKING:
    from piezo_ros.identification import DynamicsFit, FrequencyResponse

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo identify hysteresis bags/bare_triangle -o compensator.yaml --compare
  piezo identify dynamics bags/stepped_sine -o trajectory.yaml
  piezo identify dynamics bags/bare_sine --compensator compensator.yaml -o trajectory.yaml
  piezo identify dynamics bags/multisine --orders 4 7 --fit-delay -o model.yaml
  piezo identify dynamics recorded_by_ros2_bag --trajectory played.yaml -o trajectory.yaml
  piezo identify uncertainty bags/grid_* --model trajectory.yaml -o bound.yaml
"""
_PLOT_SUFFIX: Final = '.svg'
_TABLE_SUFFIX: Final = '.csv'
# What a kind makes of its bags: each file's name with its text.
_Files = Mapping[Path, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    kinds = parser.add_subparsers(dest='kind', required=True, metavar='KIND')
    hysteresis = kinds.add_parser(
        'hysteresis', help='MRC elements, from voltage and displacement of a slow triangle of '
        'decreasing amplitude')
    hysteresis.add_argument(
        '--elements', default='10', metavar='N',
        help="number of voltage-limited elements, or 'auto' (default: 10)")
    hysteresis.add_argument(
        '--used', action='store_true', help='the stage was not virgin at the start')
    hysteresis.add_argument(
        '--range-v', type=float, nargs=2, metavar=('LOW', 'HIGH'),
        help='voltages at which the model will be used; warns of what the bags do not cover')
    hysteresis.add_argument(
        '--every', type=_positive, default=1, metavar='N',
        help='take one of N samples: of a slow triangle the others tell little more')
    hysteresis.add_argument(
        '--compare', action='store_true', help='also fit other models to the same bags')
    dynamics = kinds.add_parser(
        'dynamics', help='G(s) of (6), from command and displacement of a stepped sine or '
        'multisine')
    dynamics.add_argument(
        '--maximum-frequency-hz', type=float, default=math.inf, metavar='F',
        help='leave out what is above')
    dynamics.add_argument(
        '--orders', type=int, nargs=2, metavar=('NUM', 'DEN'),
        help='fit a stable rational G(s) of these orders in place of (6); for piezo tune, the '
        'nodes know (6) only')
    dynamics.add_argument(
        '--delay-samples', type=float, default=0.0, metavar='D', help='known delay (default: 0)')
    dynamics.add_argument(
        '--fit-delay', action='store_true', help='fit a delay too, with --orders')
    uncertainty = kinds.add_parser(
        'uncertainty', help='W(s) above every measured deviation from a model')
    uncertainty.add_argument(
        '--model', type=Path, required=True, metavar='FILE', help='what identify dynamics wrote')
    uncertainty.add_argument('--order', type=int, default=2, help='of W(s) (default: 2)')
    for kind in (hysteresis, dynamics, uncertainty):
        kind.add_argument('bags', type=Path, nargs='+', metavar='BAG')
        kind.add_argument(
            '-o', '--output', type=Path, required=True, metavar='FILE', help='model file to write')
        kind.add_argument('--force', action='store_true', help='replace the file')
        add_bag_options(kind)
        kind.add_argument(
            '--from-s', type=float, default=0.0, metavar='T',
            help='leave out what was before this simulated time')
        kind.add_argument(
            '--to-s', type=float, default=math.inf, metavar='T',
            help='leave out what was from this simulated time on')
    for kind in (dynamics, uncertainty):
        kind.add_argument(
            '--trajectory', type=Path, action='append', metavar='FILE',
            help='parameters of the trajectory that was played, where the bag does not say them: '
            'once for all bags or once for each, in their order')
        kind.add_argument(
            '--compensator', type=Path, metavar='FILE',
            help='take the command from the voltage by the hysteresis of this file: for runs of '
            'the bare actuator')
        kind.add_argument(
            '--slew-limit-v-per-s', type=float, metavar='S',
            help='of the amplifier, where the bag does not say it')
    hysteresis.set_defaults(function=lambda options: _guarded(_hysteresis, options))
    dynamics.set_defaults(function=lambda options: _guarded(_dynamics, options))
    uncertainty.set_defaults(function=lambda options: _guarded(_uncertainty, options))


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f'{text} is below 1')
    return value


def _guarded(
    identify: Callable[[argparse.Namespace, list[Run]], _Files], options: argparse.Namespace,
) -> int:
    outputs = [options.output, options.output.with_suffix(_PLOT_SUFFIX)]
    if options.kind == 'dynamics':
        outputs.append(options.output.with_suffix(_TABLE_SUFFIX))
    for path in outputs:
        if path.exists() and not options.force:
            print(f'piezo: {path} exists; --force replaces it', file=sys.stderr)
            return 2
    try:
        runs = [_read(path, options) for path in options.bags]
        _refuse_different_periods(runs)
        files = identify(options, runs)
        for path, text in files.items():
            write_atomically(path, text)
    except (BagError, PlanError, ParameterError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return 1
    print(f'model: {", ".join(map(str, files))}')
    lost = [f'{run.path}: {loss}' for run in runs for loss in run.lost]
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    return 3 if lost else 0


def _read(path: Path, options: argparse.Namespace) -> Run:
    """Read what is wanted of a bag, of which the rest may be longer than the memory."""
    hysteresis = options.kind == 'hysteresis'
    recording = open_recording(
        path, **bag_options(options), keep_not_finite=hysteresis)  # its fit leaves them out
    start, stop = (
        math.ceil(time_s / recording.sample_period_s) - recording.start_index
        if math.isfinite(time_s) else recording.samples
        for time_s in (options.from_s, options.to_s))
    start, stop = max(start, 0), min(stop, recording.samples)
    if start >= stop:
        first_s = recording.start_index * recording.sample_period_s
        last_s = first_s + (recording.samples - 1) * recording.sample_period_s
        raise BagError(
            f'{path} has no sample from --from-s {options.from_s:g} to --to-s {options.to_s:g}, '
            f'it lasts from {first_s:g} s to {last_s:g} s')
    if hysteresis:
        return recording.part(
            start, stop, every=options.every, streams=('voltage', 'displacement'))
    return recording.part(start, stop)


def _refuse_different_periods(runs: list[Run]) -> None:
    first, *others = runs
    for run in others:
        if run.sample_period_s != first.sample_period_s:
            raise BagError(
                f'{run.path} has the sample period {run.sample_period_s:g} s, {first.path} '
                f'{first.sample_period_s:g} s: they cannot be identified together')


def _source(runs: list[Run]) -> str:
    return ', '.join(str(run.path) for run in runs)


def _hysteresis(options: argparse.Namespace, runs: list[Run]) -> _Files:
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
    files = {options.output: fit.to_parameter_yaml(source=_source(runs))}
    return _with_picture(files, options, 'residual_figure', fit)


def _with_picture(
    files: dict[Path, str], options: argparse.Namespace, figure: str, *arguments: Any,
) -> _Files:
    """Add a picture beside the model; without matplotlib the model is all the same."""
    try:
        from piezo_ros.report.figures import identification as identification_figures
        from piezo_ros.report.figures.export import svg
    except ImportError:
        return files
    files[options.output.with_suffix(_PLOT_SUFFIX)] = svg(
        getattr(identification_figures, figure)(*arguments), options.kind)
    return files


def _responses(options: argparse.Namespace, runs: list[Run]) -> 'list[FrequencyResponse]':
    from piezo_ros.experiment.recorded_response import recorded_response
    played = options.trajectory or [None]
    if len(played) not in (1, len(runs)):
        raise ValueError(
            f'--trajectory is given {len(played)} times for {len(runs)} bags, allowed is once or '
            'once for each')
    hysteresis = None
    if options.compensator:
        hysteresis = read_parameter_set(options.compensator, 'compensator', HysteresisParameters)
    responses = []
    for run, path in zip(runs, played * (len(runs) // len(played)), strict=True):
        trajectory = None if path is None else read_parameter_set(
            path, 'trajectory', TrajectoryParameters, {'sample_period_s': run.sample_period_s})
        response = recorded_response(
            run, slew_limit_v_per_s=options.slew_limit_v_per_s, trajectory=trajectory,
            hysteresis=hysteresis)
        for point in response.excluded:
            print(f'left out of {run.path.name}: {point.frequency_hz:g} Hz: {point.reason}')
        responses.append(response)
    return responses


def _dynamics(options: argparse.Namespace, runs: list[Run]) -> _Files:
    from piezo_ros.identification import fit_dynamics, merge
    from piezo_ros.identification.response.response_csv import response_csv
    response = merge(_responses(options, runs))
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
    text = _rational_yaml(fit, runs) if options.orders else fit.to_parameter_yaml(
        source=_source(runs))
    files = {
        options.output: text,
        options.output.with_suffix(_TABLE_SUFFIX): response_csv(response)}
    return _with_picture(files, options, 'fitted_response_figure', response, fit)


def _rational_yaml(fit: 'DynamicsFit', runs: list[Run]) -> str:
    numerator, denominator = fit.polynomials
    return yaml.safe_dump({
        'format_version': FORMAT_VERSION, 'kind': RATIONAL_KIND, 'source': _source(runs),
        'numerator': numerator.tolist(), 'denominator': denominator.tolist(),
        'delay_s': fit.delay_s, 'sample_period_s': fit.sample_period_s,
        'standard_errors': dict(fit.standard_errors)}, sort_keys=False)


def _uncertainty(options: argparse.Namespace, runs: list[Run]) -> _Files:
    import numpy as np

    from piezo_ros.identification import uncertainty_bound
    model = LinearDynamics(read_parameter_set(options.model, 'trajectory', DynamicsParameters))
    period_s = runs[0].sample_period_s
    bound = uncertainty_bound(
        _responses(options, runs),
        lambda frequency_hz: model.sampled_response(frequency_hz, period_s),
        order=options.order)
    print(
        f'|W| is above every one of {bound.frequency_hz.size} points, on average '
        f'{bound.mean_excess_db:.2f} dB above their maximum at each frequency')
    numerator, denominator = (
        np.atleast_1d(part[0][0]).tolist()
        for part in (bound.transfer_function.num, bound.transfer_function.den))
    files = {options.output: yaml.safe_dump({
        'format_version': FORMAT_VERSION, 'kind': BOUND_KIND, 'source': _source(runs),
        'numerator': numerator, 'denominator': denominator}, sort_keys=False)}
    return _with_picture(files, options, 'bound_figure', bound)
