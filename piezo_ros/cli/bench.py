"""``piezo bench``: how fast the graph and the kernels are, as ratios within one run."""

import argparse
import datetime
import json
import os
import platform
import statistics
import sys
from pathlib import Path
from typing import Any, Final

from piezo_ros.cli.progress import Progress
from piezo_ros.experiment.errors import CampaignError
from piezo_ros.experiment.kernel_speed import kernel_speeds
from piezo_ros.experiment.node_parameters import check_node_parameters
from piezo_ros.experiment.plan import STAGES, PlannedRun
from piezo_ros.experiment.provenance import software_versions

__all__ = ['add_command']

FORMAT_VERSION: Final = 1
# name -> numerator, denominator
_RATIOS: Final = {
    'composed_over_ring': ('graph_composed', 'ring_composed'),
    'separate_over_ring': ('graph_separate', 'ring_separate'),
    'composed_recorded_over_unrecorded': ('graph_composed_recorded', 'graph_composed'),
    'separate_recorded_over_unrecorded': ('graph_separate_recorded', 'graph_separate'),
}
_EXAMPLES = """\
examples:
  piezo bench
  piezo bench --rounds 9 --json bench.json
  piezo bench --kernels
"""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'bench', help='loops/s composed and separate beside the bare transport; kernels',
        epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=5, metavar='N', help='rounds (default: 5)')
    parser.add_argument(
        '--kernels', action='store_true', help='the compiled kernels alone; needs no ROS')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all values here')
    parser.set_defaults(function=_bench)


def _bench(options: argparse.Namespace) -> int:
    if options.rounds < 1:
        print(f'piezo: --rounds is {options.rounds}, it must be at least 1', file=sys.stderr)
        return 2
    progress = Progress()
    values: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    try:
        for number in range(1, options.rounds + 1):
            for name, unit, value in _round(options, f'round {number}/{options.rounds}', progress):
                values.setdefault(name, []).append(value)
                units[name] = unit
    except (CampaignError, ImportError) as error:
        progress.end()
        print(f'piezo: {error}', file=sys.stderr)
        return 1
    progress.end()
    result = {
        'format_version': FORMAT_VERSION,
        'date': datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        'machine': {
            'processor': _processor(), 'cores': os.cpu_count(),
            'system': platform.platform(), 'python': platform.python_version()},
        'software': software_versions(),
        'rounds': options.rounds,
        'results': {
            name: {'unit': units[name], **_summary(values[name])} for name in values},
        # Pair by pair, so that a machine whose speed drifts compares like with like.
        'ratios': {
            name: _summary([
                a / b for a, b in zip(values[over], values[under], strict=True)])
            for name, (over, under) in _RATIOS.items() if over in values},
    }
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
    print(_table(result))
    return 0


def _round(options: argparse.Namespace, title: str, progress: Progress) -> Any:
    """Measure everything once; graph and ring take turns."""
    stage_defaults = {stage: check_node_parameters(stage, {}) for stage in STAGES}
    planned = PlannedRun('bench', stage_defaults)
    progress.announce(f'{title}: kernels')
    yield from kernel_speeds(planned.plant)
    if options.kernels:
        return
    from piezo_ros.nodes.graph_speed import graph_rate, ring_rate
    for label, composed, periods in (('composed', True, 120.0), ('separate', False, 60.0)):
        progress.announce(f'{title}: {label}')
        stage_defaults['trajectory'] = check_node_parameters('trajectory', {'periods': periods})
        planned = PlannedRun('bench', stage_defaults)
        samples = planned.trajectory.samples
        yield f'ring_{label}', 'loops/s', ring_rate(samples, composed=composed)
        yield f'graph_{label}', 'loops/s', graph_rate(
            planned, composed=composed, record=False, progress=progress.show)
        yield f'graph_{label}_recorded', 'loops/s', graph_rate(
            planned, composed=composed, record=True, progress=progress.show)


def _summary(values: list[float]) -> dict[str, Any]:
    return {
        'median': statistics.median(values), 'minimum': min(values), 'maximum': max(values),
        'values': values}


def _table(result: dict[str, Any]) -> str:
    lines = [f'{"":36}{"median":>12}{"minimum":>12}{"maximum":>12}']
    for name, row in result['results'].items():
        numbers = ''.join(f'{row[key]:12.4g}' for key in ('median', 'minimum', 'maximum'))
        lines.append(f'{name:36}{numbers}  {row["unit"]}')
    for name, row in result['ratios'].items():
        numbers = ''.join(f'{row[key]:12.2f}' for key in ('median', 'minimum', 'maximum'))
        lines.append(f'{name:36}{numbers}')
    return '\n'.join(lines)


def _processor() -> str:
    try:
        for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines():
            if line.startswith('model name'):
                return line.partition(':')[2].strip()
    except OSError:
        pass
    return platform.processor()
