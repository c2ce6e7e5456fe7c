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

"""``piezo plan``: a scan at the limits of the amplifier, for the nodes to play."""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED, EXIT_POOR, EXIT_USAGE
from piezo_ros.cli.shared.given_options import refuse_named_option, refuse_without_effect
from piezo_ros.cli.shared.model_trust import chosen_sample_period_s, poor_model
from piezo_ros.cli.shared.option_types import (
    AMPLITUDE_UM,
    FREQUENCY_HZ,
    OFFSET_UM,
    SAMPLE_PERIOD_S,
    SHARE,
    SLEW_V_PER_S,
    Number,
)
from piezo_ros.cli.shared.outputs import OutputFile
from piezo_ros.experiment.model_file import read_bound, read_model
from piezo_ros.experiment.motion_files import MOTION_SUFFIX
from piezo_ros.model import DynamicsParameters, HysteresisParameters, ParameterError, RigParameters
from piezo_ros.parameters.errors import PlanError, failure_text
from piezo_ros.parameters.parameter_file import read_parameter_set

if TYPE_CHECKING:
    from piezo_ros.planning.periodic_plan import PeriodicPlan
    from piezo_ros.planning.scan import ScanRequest

__all__ = ['add_arguments']

_EXAMPLES: Final = """\
examples:
  piezo plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml \\
      --amplitude-um 2 --frequency-hz 600 -o scan.yaml
  piezo plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml \\
      --amplitude-um 2 --frequency-hz 600 --free-turn 0.2 -o scan.yaml
  piezo plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml --bound bound.yaml \\
      --amplitude-um 2 --frequency-hz 600 -o scan.yaml
  piezo plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml \\
      --motion spiral_x.csv -o spiral.yaml
"""
_OF_SCANS: Final = (
    'amplitude_um', 'frequency_hz', 'waveform', 'offset_um', 'turn_fraction', 'flyback_fraction',
    'free_turn', 'band_hz', 'bound', 'uncertainty', 'ramp_periods')
_FREE_TURN: Final = Number(0.0, 0.9)
_UNCERTAINTY: Final = Number(0.0, 1e6)
_RAMP_PERIODS: Final = Number(0.0, 1e3)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument(
        'model', type=Path, metavar='MODEL', help='what identify dynamics wrote')
    parser.add_argument(
        '--compensator', type=Path, required=True, metavar='FILE',
        help='what identify hysteresis wrote; the compensator of the scan must have it too')
    parser.add_argument(
        '--plant', type=Path, required=True, metavar='FILE',
        help='data sheet of the rig: slew limit, rails, travel')
    parser.add_argument(
        '--amplitude-um', type=AMPLITUDE_UM, metavar='A', help='of a periodic scan')
    parser.add_argument(
        '--frequency-hz', type=FREQUENCY_HZ, metavar='F', help='of a periodic scan')
    parser.add_argument(
        '--motion', type=Path, metavar='FILE',
        help='any motion, from 0 on, in place of a periodic scan: CSV or NPZ with reference_um')
    parser.add_argument(
        '--waveform', choices=('triangle', 'sine', 'sawtooth'), default='triangle',
        help='(default: triangle)')
    parser.add_argument(
        '--offset-um', type=OFFSET_UM, default=0.0, metavar='O',
        help='mean of the scan (default: 0)')
    parser.add_argument(
        '--turn-fraction', type=SHARE, default=0.0, metavar='SHARE',
        help='share of each line of a triangle or sawtooth that is spent in parabolic turns '
        '(default: 0)')
    parser.add_argument(
        '--flyback-fraction', type=SHARE, default=0.1, metavar='SHARE',
        help='share of the period in which a sawtooth goes back (default: 0.1)')
    parser.add_argument(
        '--free-turn', type=_FREE_TURN, default=0.0, metavar='SHARE',
        help='share of each line about its ends in which the error hardly counts (default: 0)')
    parser.add_argument(
        '--band-hz', type=FREQUENCY_HZ, default=0.0, metavar='F',
        help='highest frequency of the voltage (default: six times the fastest pole pair, at most '
        '15 %% of the sampling frequency)')
    parser.add_argument(
        '--average-slew-v-per-s', type=SLEW_V_PER_S, metavar='S',
        help='mean absolute slope that the average current of the amplifier allows (default: '
        'average_slew_limit_v_per_s of the rig)')
    uncertainty = parser.add_mutually_exclusive_group()
    uncertainty.add_argument(
        '--bound', type=Path, metavar='FILE',
        help='what identify uncertainty wrote: narrows the band to where W(s) is at most 0.5, and '
        'tells the uncertainty of prediction and certificate')
    uncertainty.add_argument(
        '--uncertainty', type=_UNCERTAINTY, default=0.0, metavar='W',
        help='largest relative error of the model in the band, for the certificate')
    parser.add_argument(
        '--ramp-periods', type=_RAMP_PERIODS, default=2.0, metavar='N',
        help='soft start (default: 2)')
    parser.add_argument(
        '--sample-period-s', type=SAMPLE_PERIOD_S, metavar='TS',
        help='(default: that of the record of MODEL, where it tells one; else 1e-5)')
    parser.add_argument(
        '--accept-poor', action='store_true',
        help='plan also with a model of which the verdict is "do not trust" (else exit 4)')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputFile, beside=(MOTION_SUFFIX,), required=True,
        metavar='FILE',
        help='parameter file of the trajectory to write; its motion lies beside it (.npz)')
    parser.add_argument('--force', action='store_true', help='replace the files')
    parser.set_defaults(function=_plan)


def _plan(options: argparse.Namespace) -> int:
    is_scan = options.amplitude_um is not None and options.frequency_hz is not None
    if is_scan == (options.motion is not None):
        print(
            'piezo: what is wanted is either --amplitude-um and --frequency-hz, or --motion',
            file=sys.stderr)
        return EXIT_USAGE
    _refuse_what_has_no_effect(options)
    models = (options.model, options.compensator)
    if not options.accept_poor and (poor := poor_model(models)):
        print(f'piezo: {poor}; --accept-poor plans all the same', file=sys.stderr)
        return EXIT_POOR
    try:
        plant = read_parameter_set(options.plant, 'plant', RigParameters)
        dynamics = read_model(options.model, DynamicsParameters)
        hysteresis = read_model(options.compensator, HysteresisParameters)
        options.sample_period_s = chosen_sample_period_s(models, options.sample_period_s)
        notes = (f'models: {options.model}, {options.compensator}; limits: {options.plant}',)
        files = (_plan_scan if is_scan else _plan_motion)(
            options, plant, dynamics, hysteresis, notes)
    except PlanError:
        raise
    except (ValueError, OSError, ModuleNotFoundError) as error:
        refuse_named_option(options, error)
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    print(f'scan: {", ".join(map(str, files))}')
    return EXIT_DONE


def _refuse_what_has_no_effect(options: argparse.Namespace) -> None:
    if options.motion is not None:
        refuse_without_effect(options, _OF_SCANS, 'on a --motion')
    elif options.waveform != 'sawtooth':
        refuse_without_effect(
            options, ['flyback_fraction'], f'on a {options.waveform}, but on a sawtooth')
    if options.waveform == 'sine':
        refuse_without_effect(options, ['turn_fraction'], 'on a sine')


def _plan_scan(
    options: argparse.Namespace, plant: RigParameters, dynamics: DynamicsParameters,
    hysteresis: HysteresisParameters, notes: tuple[str, ...],
) -> tuple[Path, ...]:
    from piezo_ros.experiment.planned_scan import (
        ScanRequest,
        limits_of,
        write_planned_scan,
    )
    from piezo_ros.identification.tuning.linear_plant import bound_magnitude
    from piezo_ros.planning.scan import plan_for_rig, with_bound
    nyquist_hz = 0.5 / options.sample_period_s
    if options.band_hz and not options.frequency_hz <= options.band_hz < nyquist_hz:
        raise PlanError(
            f'--band-hz is {options.band_hz:g}, allowed is from --frequency-hz, '
            f'{options.frequency_hz:g} Hz, to below the Nyquist frequency, {nyquist_hz:g} Hz')
    most_um = plant.reach_um - abs(options.offset_um)
    if most_um <= 0.0:
        raise PlanError(
            f'--offset-um is {options.offset_um:g}, allowed is within {plant.reach_um:g} um to '
            'either side, the reach of the stage')
    if not 0.0 < options.amplitude_um <= most_um:
        beside = f', beside the offset of {options.offset_um:g} um' if options.offset_um else ''
        raise PlanError(
            f'--amplitude-um is {options.amplitude_um:g}, allowed is above 0 … '
            f'{most_um:g} um (the reach of the stage{beside})')
    request = ScanRequest(
        waveform=options.waveform, amplitude_um=options.amplitude_um,
        frequency_hz=options.frequency_hz, sample_period_s=options.sample_period_s,
        dynamics=dynamics, hysteresis=hysteresis,
        limits=limits_of(plant, options.average_slew_v_per_s), band_hz=options.band_hz,
        free_turn=options.free_turn, ramp_periods=options.ramp_periods,
        uncertainty=options.uncertainty, noise_rms_um=plant.noise_rms_um,
        offset_um=options.offset_um, turn_fraction=options.turn_fraction,
        flyback_fraction=options.flyback_fraction)
    if options.bound is not None:
        request = with_bound(request, partial(bound_magnitude, read_bound(options.bound)))
    request, plan = plan_for_rig(request, plant)
    files = write_planned_scan(options.output, request, plan, (
        f'{request.waveform} of {request.amplitude_um:g} um at {request.frequency_hz:g} Hz',
        *notes))
    _tell(request, plan)
    return files


def _tell(request: 'ScanRequest', plan: 'PeriodicPlan') -> None:
    """Print what to expect of a plan."""
    known = (
        f'at most {plan.highest_nrmse_percent:.3f} % within the uncertainty of the model'
        if plan.accuracy.uncertainty_percent else
        'how wrong the model is was not told (--bound)')
    print(
        f'predicted NRMSE {plan.predicted_nrmse_percent:.3f} %, a run measures '
        f'{plan.measured_nrmse_percent:.3f} %; {known}')
    print(
        f'shares: band of {request.band:g} Hz {plan.truncation_percent:.3f} %, limits of the '
        f'amplifier {plan.limits_percent:.3f} %, noise {plan.noise_percent:.3f} %')
    print(f'amplifier: {100.0 * plan.limit_use:.1f} % of its limits')
    certificate = plan.certificate
    if not certificate.holds:
        learning = 'learning is not certain to lessen the error'
    elif plan.accuracy.uncertainty:
        learning = 'learning will lessen the error'
    else:
        learning = 'learning will lessen the error if the model is right'
    print(f'certificate: gamma {certificate.gamma:.2f}, {learning}')


def _plan_motion(
    options: argparse.Namespace, plant: RigParameters, dynamics: DynamicsParameters,
    hysteresis: HysteresisParameters, notes: tuple[str, ...],
) -> tuple[Path, ...]:
    from piezo_ros.control.tables.motion_table import read_motion_table
    from piezo_ros.experiment.planned_motion import planned_motion
    from piezo_ros.experiment.planned_scan import limits_of, write_motion
    motion = read_motion_table(options.motion, options.sample_period_s)
    if motion.greatest_um > plant.reach_um:
        raise ParameterError(
            f'{options.motion}: it reaches {motion.greatest_um:g} um, the stage travels '
            f'{plant.reach_um:g} um to either side of its operating point')
    planned = planned_motion(
        motion, dynamics, hysteresis, limits_of(plant, options.average_slew_v_per_s),
        plant.average_slew_time_s)
    files = write_motion(
        options.output, planned.table, dynamics, motion.greatest_um, (
            f'motion of {options.motion}', *notes))
    print(
        f'predicted error {1e3 * planned.predicted_rms_um:.2f} nm rms, '
        f'{1e3 * planned.predicted_maximum_um:.2f} nm at most')
    print(f'amplifier: {100.0 * planned.limit_use:.1f} % of its limits')
    print(f'the motion begins {planned.latency} samples later')
    return files
