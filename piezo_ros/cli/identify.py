"""``piezo identify``: models out of bags, as parameter files that the nodes load unchanged."""

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from piezo_ros.bag import BagError, Run, read
from piezo_ros.experiment.errors import PlanError
from piezo_ros.experiment.model_file import BOUND_KIND, FORMAT_VERSION, read_node_model
from piezo_ros.model import DynamicsParameters, LinearDynamics, ParameterError

__all__ = ['add_command']

_EXAMPLES = """\
examples:
  piezo identify hysteresis bags/bare_triangle -o compensator.yaml --compare
  piezo identify dynamics bags/stepped_sine -o trajectory.yaml
  piezo identify uncertainty bags/grid_* --model trajectory.yaml -o bound.yaml
"""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'identify', help='hysteresis, dynamics or uncertainty from bags', epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
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
        '--compare', action='store_true', help='also fit other models to the same bags')
    dynamics = kinds.add_parser(
        'dynamics', help='G(s) of (6), from command and displacement of a stepped sine or '
        'multisine')
    dynamics.add_argument(
        '--maximum-frequency-hz', type=float, default=math.inf, metavar='F',
        help='leave out what is above')
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
        kind.add_argument('--namespace', metavar='NS', help='the rig, where a bag holds several')
        kind.add_argument(
            '--allow-loss', action='store_true',
            help='take what is whole of a damaged bag; exit 3')
    for kind in (dynamics, uncertainty):
        kind.add_argument(
            '--slew-limit-v-per-s', type=float, metavar='S',
            help='of the amplifier, where the bag does not say it')
    hysteresis.set_defaults(function=lambda options: _guarded(_hysteresis, options))
    dynamics.set_defaults(function=lambda options: _guarded(_dynamics, options))
    uncertainty.set_defaults(function=lambda options: _guarded(_uncertainty, options))


def _guarded(
    identify: Callable[[argparse.Namespace, list[Run]], str], options: argparse.Namespace,
) -> int:
    if options.output.exists() and not options.force:
        print(f'piezo: {options.output} exists; --force replaces it', file=sys.stderr)
        return 2
    try:
        runs = [
            read(path, namespace=options.namespace, allow_loss=options.allow_loss)
            for path in options.bags]
        text = identify(options, runs)
        options.output.write_text(text, encoding='utf-8')
    except (BagError, PlanError, ParameterError, ValueError, OSError) as error:
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    print(f'model: {options.output}')
    lost = [f'{run.path}: {loss}' for run in runs for loss in run.lost]
    for loss in lost:
        print(f'piezo: {loss}', file=sys.stderr)
    return 3 if lost else 0


def _source(runs: list[Run]) -> str:
    return ', '.join(str(run.path) for run in runs)


def _hysteresis(options: argparse.Namespace, runs: list[Run]) -> str:
    from piezo_ros.identification import compare_hysteresis_models, fit_hysteresis
    if options.elements != 'auto' and not options.elements.isdigit():
        raise ValueError(f"--elements is {options.elements!r}, allowed is a number or 'auto'")
    elements = 'auto' if options.elements == 'auto' else int(options.elements)
    voltage_v = [run.voltage_v for run in runs]
    displacement_um = [run.displacement_um for run in runs]
    fit = fit_hysteresis(
        voltage_v, displacement_um, elements=elements,  # type: ignore[arg-type]
        virgin=not options.used)
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
    return fit.to_parameter_yaml(source=_source(runs))


def _responses(options: argparse.Namespace, runs: list[Run]) -> list[Any]:
    from piezo_ros.experiment.recorded_models import recorded_response
    responses = []
    for run in runs:
        response = recorded_response(run, slew_limit_v_per_s=options.slew_limit_v_per_s)
        for point in response.excluded:
            print(f'left out of {run.path.name}: {point.frequency_hz:g} Hz: {point.reason}')
        responses.append(response)
    return responses


def _dynamics(options: argparse.Namespace, runs: list[Run]) -> str:
    from piezo_ros.identification import fit_dynamics, merge
    fit = fit_dynamics(
        merge(_responses(options, runs)), maximum_frequency_hz=options.maximum_frequency_hz)
    for name, error in fit.standard_errors.items():
        print(f'{name:32}{fit.values[name]:14.6g} ± {error:.2g}')
    return fit.to_parameter_yaml(source=_source(runs))


def _uncertainty(options: argparse.Namespace, runs: list[Run]) -> str:
    import numpy as np

    from piezo_ros.identification import uncertainty_bound
    model = LinearDynamics(read_node_model(options.model, 'trajectory', DynamicsParameters))
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
    return yaml.safe_dump({
        'format_version': FORMAT_VERSION, 'kind': BOUND_KIND, 'source': _source(runs),
        'numerator': numerator, 'denominator': denominator}, sort_keys=False)
