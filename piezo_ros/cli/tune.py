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

"""``piezo tune``: PI gains for an identified model, margins beside those of the published ones."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from piezo_ros import paper
from piezo_ros.cli.shared.exit_codes import EXIT_FAILED, EXIT_POOR
from piezo_ros.cli.shared.given_options import refuse_named_option, refuse_without_effect
from piezo_ros.cli.shared.model_trust import chosen_sample_period_s, poor_model
from piezo_ros.cli.shared.option_types import (
    AMPLITUDE_UM,
    DELAY_SAMPLES,
    FREQUENCY_HZ,
    OFFSET_UM,
    SAMPLE_PERIOD_S,
    SHARE,
    Number,
    NumberOrWord,
    Whole,
)
from piezo_ros.cli.shared.outputs import OutputDirectory, OutputFile
from piezo_ros.cli.shared.progress import working
from piezo_ros.control import TrajectoryParameters
from piezo_ros.control.shapes.fourier_series import PERIODIC
from piezo_ros.experiment.model_file import read_bound, read_dynamics, read_evidence
from piezo_ros.experiment.output_directory import prepare_directory
from piezo_ros.experiment.plan.automatic import AUTO
from piezo_ros.model import LinearDynamics
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.report.files import write_atomically

if TYPE_CHECKING:
    from piezo_ros.identification.prediction.operating_points import OperatingPoint
    from piezo_ros.identification.tuning.linear_plant import Bound, Model
    from piezo_ros.identification.tuning.loop_shape import LoopShape
    from piezo_ros.identification.tuning.pi_tuning import PiTuning

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo tune config/trajectory.yaml -o controller.yaml --report out/tuning
  piezo tune model.yaml --bound bound.yaml --max-sensitivity 1.5 -o controller.yaml
  piezo tune trajectory.yaml --compensator compensator.yaml --plant rig.yaml -o controller.yaml
  piezo tune model.yaml --lead --objective feedback_band --max-sensitivity 1.6 -o controller.yaml
  piezo tune slow_stage.yaml --sample-period-s 1e-4 --no-operating-points -o controller.yaml
"""
_ABOVE_ONE: Final = Number(1.0, 1e6, is_above=True)
_ABOVE_ZERO: Final = Number(0.0, 1e6, is_above=True)
_HARMONICS: Final = NumberOrWord(Whole(1, 1000), AUTO)
_OF_POINTS: Final = (
    'compensator', 'plant', 'waveform', 'offset_um', 'turn_fraction', 'amplitudes_um',
    'frequencies_hz', 'harmonics')
_GAINS: Final = (
    ('kP', 'proportional_gain', ''),
    ('kI', 'integral_gain_per_s', '1/s'),
    ('zero of the lead', 'lead_zero_hz', 'Hz'),
    ('pole of the lead', 'lead_pole_hz', 'Hz'),
)
# What means nothing where the loop is not stable.
_FIGURES: Final = (
    ('gain margin', 'gain_margin', ''),
    ('phase margin', 'phase_margin_deg', 'deg'),
    ('delay margin', 'delay_margin_s', 's'),
    ('bandwidth', 'bandwidth_hz', 'Hz'),
    ('feedback acceptable below', 'feedback_acceptable_frequency_hz', 'Hz'),
    ('max |S|', 'max_sensitivity', ''),
    ('max |W T|', 'weighted_peak', ''),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'model', type=Path, metavar='MODEL', help='what identify dynamics wrote')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputFile, required=True, metavar='FILE',
        help='parameter file of the controller to write')
    parser.add_argument('--force', action='store_true', help='replace the file')
    parser.add_argument(
        '--report', type=Path, action=OutputDirectory, metavar='DIR',
        help='draw Bode and Nyquist diagram, |S| and |T|, step and scan, and the map of schemes: '
        'a page in this directory')
    parser.add_argument(
        '--bound', type=Path, metavar='FILE',
        help="what identify uncertainty wrote, or 'none' (default: (19) of the paper)")
    parser.add_argument(
        '--objective', choices=('itae_step', 'itae_scan', 'feedback_band'), default='itae_step',
        help='ITAE of a unit step, or of the scan in MODEL, or the highest frequency below which '
        '|S| < 1 (default: itae_step)')
    parser.add_argument(
        '--lead', action='store_true', help='tune a lead section as well')
    parser.add_argument(
        '--lead-ratio', type=_ABOVE_ONE, default=10.0, metavar='R',
        help='pole over zero of the lead, by which it amplifies noise (default: 10)')
    parser.add_argument(
        '--max-sensitivity', type=_ABOVE_ONE, default=2.0, metavar='M',
        help='limit on |S| (default: 2)')
    parser.add_argument(
        '--uncertainty-limit', type=_ABOVE_ZERO, default=1.0, metavar='L',
        help='limit on |W T| (default: 1)')
    parser.add_argument(
        '--measurement-delay-samples', type=DELAY_SAMPLES, default=1, metavar='D',
        help='(default: 1)')
    parser.add_argument(
        '--sample-period-s', type=SAMPLE_PERIOD_S, metavar='TS',
        help='(default: that of the record of MODEL, where it tells one; else 1e-5)')
    parser.add_argument(
        '--accept-poor', action='store_true',
        help='tune also on a model of which the verdict is "do not trust" (else exit 4)')
    _add_operating_points(parser)
    parser.set_defaults(function=_tune)


def _add_operating_points(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        'operating points', 'which scheme to use at each amplitude and frequency, predicted from '
        'model, W(s), hysteresis, rails and slew limit; also written for scheme auto')
    group.add_argument(
        '--compensator', type=Path, metavar='FILE',
        help='what identify hysteresis wrote (default: Table 1 of the paper)')
    group.add_argument(
        '--plant', type=Path, metavar='FILE',
        help='data sheet of the rig: rails, slew limit, travel (default: that of the paper)')
    group.add_argument(
        '--waveform', choices=PERIODIC, default='triangle', help='(default: triangle)')
    for name, allowed, unit, what in (
            ('offset-um', OFFSET_UM, 'Y', 'mean of the waveform'),
            ('turn-fraction', SHARE, 'SHARE', 'share of its lines that is spent in turns')):
        parser.add_argument(
            f'--{name}', type=allowed, metavar=unit, help=f'{what} (default: as in MODEL, else 0)')
    group.add_argument(
        '--amplitudes-um', type=AMPLITUDE_UM, action='extend', nargs='+', metavar='A',
        help='peak amplitudes (default: 1/12 … 5/12 of the reach)')
    group.add_argument(
        '--frequencies-hz', type=FREQUENCY_HZ, action='extend', nargs='+', metavar='F',
        help='frequencies (default: about the feedback-acceptable one)')
    group.add_argument(
        '--harmonics', type=_HARMONICS, default=AUTO, metavar='M',
        help="of the feedforward, a number or 'auto' (default: auto)")
    group.add_argument(
        '--no-operating-points', action='store_true', help='tune the gains, nothing else')


def _tune(options: argparse.Namespace) -> int:
    from piezo_ros.cli.shared.scheme_advice import operating_points_text, predicted_points
    from piezo_ros.identification.prediction.operating_points import feedback_table
    from piezo_ros.identification.tuning.lead_tuning import tune_pi_with_lead
    from piezo_ros.identification.tuning.loop_shape import loop_shape
    from piezo_ros.identification.tuning.pi_tuning import tune_pi
    _refuse_what_has_no_effect(options)
    try:
        models = (options.model, options.compensator)
        if not options.accept_poor and (poor := poor_model(models)):
            print(f'piezo: {poor}; --accept-poor tunes all the same', file=sys.stderr)
            return EXIT_POOR
        options.sample_period_s = chosen_sample_period_s(models, options.sample_period_s)
        model = read_dynamics(options.model)
        if not isinstance(model, LinearDynamics):
            refuse_without_effect(
                options, _OF_POINTS, f'where {options.model} is a rational model, of which no '
                'operating points are predicted')
        evidence = read_evidence(
            options.model, model, options.sample_period_s, trust_band=not options.accept_poor)
        bound = _bound(options.bound)
        limits: dict[str, Any] = {
            'bound': bound, 'objective': _objective(options, model),
            'max_sensitivity': options.max_sensitivity,
            'uncertainty_limit': options.uncertainty_limit,
            'measurement_delay_samples': options.measurement_delay_samples,
            'sample_period_s': options.sample_period_s, 'evidence': evidence}
        with working('tuning the gains'):
            tuning = without_lead = tune_pi(model, **limits)
            if options.lead:
                tuning = tune_pi_with_lead(model, ratio=options.lead_ratio, **limits)
        published = loop_shape(
            model, paper.TABLE_2['proportional_gain'], paper.TABLE_2['integral_gain_per_s'],
            sample_period_s=options.sample_period_s,
            measurement_delay_samples=options.measurement_delay_samples, bound=bound)
        # Predictions simulate the rig, which has poles before and behind its hysteresis.
        points: tuple[OperatingPoint, ...] = ()
        if isinstance(model, LinearDynamics) and not options.no_operating_points:
            with working('predicting the operating points'):
                points = predicted_points(options, tuning, bound)
        if options.report:
            prepare_directory(options.report, force=options.force)
        write_atomically(options.output, tuning.to_parameter_yaml(
            source=str(options.model), table=feedback_table(points) if points else None))
        report = None
        if options.report:
            from piezo_ros.cli.shared.tuning_report import write_tuning_report
            with working('drawing the report'):
                report = write_tuning_report(
                    options, model, tuning, published, evidence, bound, points)
    except PlanError:
        raise
    except (ValueError, OSError) as error:
        refuse_named_option(options, error)
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    print(
        f'sampled every {options.sample_period_s:g} s, measurement '
        f'{options.measurement_delay_samples * options.sample_period_s:g} s old, W(s): '
        f'{options.bound or "(19) of the paper"}')
    tuned = {'PI': without_lead.after, 'PI + lead': tuning.after} if options.lead else {
        'tuned': tuning.after}
    print(_table({'start': without_lead.before, **tuned, 'Table 2': published}))
    if options.lead:
        print(_lead_text(without_lead.after, tuning.after))
    print(f'active limits: {", ".join(tuning.active_limits) or "none"}')
    print(_sensitivity_text(tuning, len(evidence.frequency_hz), options))
    if points:
        print()
        print(operating_points_text(points, options))
    print(f'gains: {options.output}')
    if report is not None:
        print(f'report: {report}')
    print(
        f'next: name {options.output} in the parameter_files of a plan, or try it on a recording: '
        f'piezo replay BAG --controller {options.output}; --report DIR draws the loop')
    return 0


def _refuse_what_has_no_effect(options: argparse.Namespace) -> None:
    from piezo_ros.cli.shared.scheme_advice import NO_BOUND
    if not options.lead:
        refuse_without_effect(options, ['lead_ratio'], 'without --lead')
    if options.bound == NO_BOUND:
        refuse_without_effect(options, ['uncertainty_limit'], 'beside --bound none')
    if options.no_operating_points:
        refuse_without_effect(options, _OF_POINTS, 'beside --no-operating-points')


def _sensitivity_text(tuning: 'PiTuning', points: int, options: argparse.Namespace) -> str:
    """Return the largest |S| on the model, on the measured points and on its band."""
    on_points, on_band = tuning.point_sensitivity, tuning.band_sensitivity
    parts = [
        f'model {tuning.after.max_sensitivity:.4g}',
        f'measured points not known ({options.model} names no points_file)' if on_points is None
        else f'{points} measured points {on_points:.4g}',
        'band of the model not known' if on_band is None else f'band of the model {on_band:.4g}']
    return f'max |S| with the tuned gains: {", ".join(parts)}'


def _lead_text(without: 'LoopShape', with_lead: 'LoopShape') -> str:
    """Return what the lead gains."""
    before_hz = without.feedback_acceptable_frequency_hz
    after_hz = with_lead.feedback_acceptable_frequency_hz
    factor = f', {after_hz / before_hz:.3g} times' if 0.0 < before_hz < math.inf else ''
    return f'|S| = 1 at {after_hz:.5g} Hz, without the lead at {before_hz:.5g} Hz{factor}'


def _objective(options: argparse.Namespace, model: 'Model') -> str | TrajectoryParameters:
    if options.objective != 'itae_scan' or not isinstance(model, LinearDynamics):
        return str(options.objective)
    return read_parameter_set(
        options.model, 'trajectory', TrajectoryParameters,
        {'sample_period_s': options.sample_period_s}).replaced(
            sample_period_s=options.sample_period_s)


def _bound(path: Path | None) -> 'Bound | None':
    from piezo_ros.cli.shared.scheme_advice import NO_BOUND
    if path == NO_BOUND:
        return None
    return read_bound(path) if path else paper.uncertainty_magnitude


def _table(shapes: 'dict[str, LoopShape]') -> str:
    records = [shape.record() for shape in shapes.values()]
    lines = [f'{"":28}' + ''.join(f'{name:>12}' for name in shapes)]
    for title, key, unit in _GAINS:
        if key.startswith('lead') and not any(record[key] for record in records):
            continue
        lines.append(_line(title, [record[key] for record in records], unit))
    for title, key, unit in _FIGURES:
        values = [record[key] if record['stable'] else None for record in records]
        lines.append(_line(title, values, unit))
    lines.append(f'{"stable":28}' + ''.join(
        f'{"yes" if record["stable"] else "no":>12}' for record in records))
    return '\n'.join(lines)


def _line(title: str, values: list[float | bool | None], unit: str) -> str:
    columns = ''.join(f'{"–":>12}' if value is None else f'{value:12.5g}' for value in values)
    return f'{title:28}{columns} {unit}'.rstrip()
