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

"""``piezo learn``: a planned scan improved by runs of the stage."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import BagError
from piezo_ros.cli.run import check_ros
from piezo_ros.cli.shared.exit_codes import EXIT_DONE, EXIT_FAILED
from piezo_ros.cli.shared.given_options import refuse_without_effect
from piezo_ros.cli.shared.option_types import Whole
from piezo_ros.cli.shared.outputs import OutputPath
from piezo_ros.cli.shared.progress import Progress
from piezo_ros.parameters.errors import CampaignError, PlanError, failure_text
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult

__all__ = ['add_arguments']

_Run = Callable[[PlannedRun, Path], RunResult]

_EXAMPLES: Final = """\
examples:
  piezo learn scan.yaml --parameters rig.yaml -o learned
  piezo learn scan.yaml --parameters rig.yaml -o learned --offline
  piezo learn scan.yaml --parameters rig.yaml --parameters feedback.yaml --scheme fbff -o learned
  piezo learn scan.yaml --parameters rig.yaml -o learned --resume --runs 10
  piezo learn scan.yaml --parameters rig.yaml -o learned --compare
"""
_RUNS: Final = Whole(1, 1000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments to its parser."""
    parser.epilog = _EXAMPLES
    parser.add_argument('scan', type=Path, metavar='SCAN', help='what piezo plan wrote')
    parser.add_argument(
        '--parameters', type=Path, action='append', default=[], metavar='FILE',
        help='parameter file of the nodes, for instance of the rig or the controller; may be given '
        'several times')
    parser.add_argument(
        '--runs', type=_RUNS, default=5, metavar='N', help='at most (default: 5)')
    parser.add_argument(
        '--scheme', choices=('ff', 'fbff'), default='ff',
        help='fbff: beside feedback; reference_delay_samples of the controller must equal '
        'measurement_delay_samples (default: ff)')
    parser.add_argument(
        '--compare', action='store_true',
        help='one run more, of the same scan under the feedforward of (13) in the paper with the '
        'number of harmonics that suits it best, and by which factor learning is better')
    parser.add_argument(
        '--offline', action='store_true', help='simulate the runs, without ROS')
    parser.add_argument(
        '--composed', action='store_true', help='the four nodes in one process')
    parser.add_argument(
        '--yes', action='store_true', help='drive a real device without asking')
    parser.add_argument('--resume', action='store_true', help='go on with what is in DIR')
    parser.add_argument(
        '-o', '--output', type=Path, action=OutputPath, required=True, metavar='DIR',
        help='output directory')
    parser.add_argument(
        '--force', action='store_true', help='replace an earlier output in DIR')
    parser.set_defaults(function=_learn)


def _learn(options: argparse.Namespace) -> int:
    from piezo_ros.experiment.feedforward_comparison import feedforward_comparison
    from piezo_ros.experiment.output_directory import prepare_directory, resume_directory
    from piezo_ros.experiment.planned_scan import read_planned_scan
    from piezo_ros.experiment.scan_learning import RECORD, ScanLearning
    if options.offline:
        refuse_without_effect(options, ['composed'], 'beside --offline')
    if options.resume:
        refuse_without_effect(options, ['force'], 'beside --resume, which keeps what is there')
    request, plan = read_planned_scan(options.scan)
    base = _base(options.parameters)
    if 'device' in base['plant']:
        _check_device(options, base['plant'])
    try:
        if not options.offline:
            check_ros('')
        learning = ScanLearning(request, plan, options.output, base, scheme=options.scheme)
        if not options.resume:
            prepare_directory(options.output, force=options.force)
        elif resume_directory(options.output, RECORD):
            print(f'{learning.resume()} runs are there already')
        with _engine(options) as run:
            while not learning.is_done and len(learning.runs) < options.runs:
                learned = learning.next_run(run)
                print(
                    f'run {learned.name}: NRMSE {learned.nrmse_percent:.3f} ± '
                    f'{learned.sigma_percent:.3f} %{", the best" if learned.is_best else ""}',
                    flush=True)
            if options.compare:
                print(feedforward_comparison(learning, base, run), flush=True)
    except PlanError:
        raise
    except (BagError, CampaignError, ValueError, OSError) as error:
        print(f'piezo: {failure_text(error)}', file=sys.stderr)
        return EXIT_FAILED
    why = 'no further run pays' if learning.is_done else 'as many runs as were asked for'
    print(f'{why}; the best scan: {options.output / "best.yaml"}')
    return EXIT_DONE


def _base(files: list[Path]) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes; of several files the last one counts."""
    base: dict[str, dict[str, Any]] = {node: {} for node in LOOP_NODES}
    for path in files:
        for node, values in read_parameter_file(path, LOOP_NODES).items():
            base[node].update(values)
    return base


def _check_device(options: argparse.Namespace, plant: dict[str, Any]) -> None:
    """Refuse what a device cannot do, and ask before a real one is driven."""
    from piezo_ros.cli.shared.drive_question import ask_to_drive
    from piezo_ros.parameters.hardware_parameters import SIMULATED
    if options.offline or options.composed:
        raise PlanError(
            f'device is {plant["device"]}: its runs are neither simulated (--offline) nor in one '
            'process (--composed)')
    if plant['device'] != SIMULATED and not options.yes:
        ask_to_drive(f'up to {options.runs + options.compare} runs on {plant["device"]}')


@contextmanager
def _engine(options: argparse.Namespace) -> Iterator[_Run]:
    """Yield what does a run: the simulation, or the live nodes."""
    if options.offline:
        from piezo_ros.experiment.offline import simulate_run
        yield simulate_run
        return
    from piezo_ros.live.graph_per_run import GraphPerRun
    from piezo_ros.live.supervisor import Supervisor
    progress = Progress()
    with Supervisor('') as supervisor:
        supervisor.exit_code = EXIT_FAILED
        yield GraphPerRun(
            supervisor, options.output, composed=options.composed, progress=progress.show)
        progress.end()
        supervisor.exit_code = EXIT_DONE
