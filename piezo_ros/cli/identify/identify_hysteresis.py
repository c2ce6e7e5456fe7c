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
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import Recording
from piezo_ros.cli.identify.common import (
    Identified,
    add_common_arguments,
    add_verdict_arguments,
    identify,
    source,
    with_picture,
)
from piezo_ros.cli.shared.option_types import COUNT, VOLTAGE_V, NumberOrWord, Whole
from piezo_ros.cli.shared.progress import working
from piezo_ros.identification.hysteresis.hysteresis_result import HysteresisFit
from piezo_ros.identification.hysteresis.records import Record, record_of_blocks
from piezo_ros.parameters.provenance import software_versions

if TYPE_CHECKING:
    from piezo_ros.identification.hysteresis.models.model_comparison import ModelScore

__all__ = ['ReducedRun', 'add_kind', 'reduced_run']

_ELEMENTS: Final = NumberOrWord(Whole(1, 160), 'auto')
_BLOCK_SAMPLES: Final = 500_000


class ReducedRun(NamedTuple):
    """
    The hysteresis record of a bag, in a memory that does not grow with the bag.

    Attributes
    ----------
    path : Path
        The bag.
    sample_period_s : float
        Sample period of the bag, seconds.
    lost : tuple of str
        Sentences that name the losses.
    record : Record
        Voltage and displacement.
    waveform : str
        What the bag says of its waveform, '' where it does not.

    """

    path: Path
    sample_period_s: float
    lost: tuple[str, ...]
    record: Record
    waveform: str = ''


def add_kind(kinds: Any) -> None:
    """Describe the arguments of this kind."""
    kind = kinds.add_parser(
        'hysteresis', help='MRC elements, from voltage and displacement of a slow triangle of '
        'decreasing amplitude')
    kind.add_argument(
        '--elements', type=_ELEMENTS, metavar='N',
        help="number of voltage-limited elements, or 'auto': the smallest that is as good as any "
        '(default: 10, and 24 or 40 where these leave clearly less of loops that are held out)')
    kind.add_argument(
        '--used', action='store_true', help='the stage was not virgin at the start')
    kind.add_argument(
        '--range-v', type=VOLTAGE_V, nargs=2, metavar=('LOW', 'HIGH'),
        help='voltages at which the model will be used; warns of what the bags do not cover')
    kind.add_argument(
        '--every', type=COUNT, default=1, metavar='N',
        help='average over N samples, but at turns of the voltage: of a slow triangle single '
        'samples tell little more')
    kind.add_argument(
        '--compare', action='store_true', help='also fit other models to the same bags')
    add_common_arguments(kind, report=True)
    add_verdict_arguments(kind)
    kind.set_defaults(function=lambda options: identify(
        _make, options, hysteresis=True,
        next_step='piezo identify dynamics BAG --compensator {model} -o trajectory.yaml',
        read=lambda recording, start, stop: reduced_run(
            recording, start, stop, virgin=not options.used, every=options.every)))


def reduced_run(
    recording: Recording, start: int, stop: int, *, virgin: bool, every: int,
    answered: bool = False,
) -> ReducedRun:
    """
    Read voltage and displacement of a part of a recording block by block.

    Parameters
    ----------
    recording : Recording
        The bag.
    start, stop : int
        First sample, and one past the last.
    virgin, every
        As for `record_of_blocks`.
    answered : bool, optional
        Whether to pair each displacement with the voltage that it answers, that of the sample
        before; before the first sample of a run that is 0 V.

    Raises
    ------
    ValueError
        As `record_of_blocks`; it names the bag.

    """
    lost = list(recording.lost)
    last_v = np.zeros(1)

    def blocks() -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        nonlocal last_v
        for first in range(start, stop, _BLOCK_SAMPLES):
            run = recording.part(
                first, min(first + _BLOCK_SAMPLES, stop), streams=('voltage', 'displacement'))
            lost.extend(sentence for sentence in run.lost if sentence not in lost)
            voltage_v = run.voltage_v
            if answered:
                if first == start and start + recording.start_index > 0:
                    last_v = voltage_v[:1]
                before_v = last_v
                last_v = voltage_v[-1:]
                voltage_v = np.concatenate([before_v, voltage_v[:-1]])
            yield voltage_v, run.displacement_um[:voltage_v.size]
    try:
        record = record_of_blocks(
            blocks(), stop - start, virgin=virgin, every=every)
    except ValueError as error:
        raise ValueError(f'{recording.path}: {error}') from None
    return ReducedRun(
        recording.path, recording.sample_period_s, tuple(lost), record,
        recording.metadata.get('waveform', ''))


def _make(options: argparse.Namespace, runs: list[ReducedRun]) -> Identified:
    from piezo_ros.identification.hysteresis.hysteresis_fit import fit_hysteresis_records
    elements = options.elements
    if elements not in ('auto', None):
        elements = int(elements)
    records = [run.record for run in runs]
    for run in runs:
        if run.waveform not in ('', 'decreasing_triangle'):
            print(
                f'piezo: warning: {run.path} was recorded with the waveform {run.waveform}; a '
                'slow decreasing_triangle is wanted, of which every amplitude is passed once',
                file=sys.stderr)
        if run.record.lost:
            print(f'left out of {run.path.name}: {run.record.lost} samples that are no numbers')
    with working('fitting the hysteresis'):
        fit = fit_hysteresis_records(
            records, elements=elements,
            range_v=tuple(options.range_v) if options.range_v else None)
    _print(fit)
    compared = _compared(records, fit.elements) if options.compare else []
    files = {options.output: fit.to_parameter_yaml(
        source=source(runs), sample_period_s=runs[0].sample_period_s)}

    def write_report(directory: Path) -> Path:
        from piezo_ros.report.analysis.identification_page import write_hysteresis_page
        from piezo_ros.report.analysis.loop_deviation import ModelResidual
        return write_hysteresis_page(
            directory, title=f'Hysteresis: {options.output.name}', fit=fit,
            sample_period_s=runs[0].sample_period_s * options.every,
            compared=[ModelResidual(
                row.name, row.parameters_count, 1e3 * row.rms_um, 1e3 * row.cross_validated_rms_um)
                for row in compared],
            software=software_versions(), command=' '.join(['piezo', *sys.argv[1:]]))

    return Identified(
        with_picture(files, options, 'residual_figure', fit), fit.verdict, write_report)


def _print(fit: HysteresisFit) -> None:
    asymmetric = ' and an asymmetry' if fit.parameters.asymmetry_weight else ''
    print(f'{fit.elements} elements{asymmetric}, residual {fit.rms_um * 1e3:.3f} nm rms')
    print(
        f'samples: {fit.samples_used} used, {fit.samples_lost} lost; '
        f'fit {fit.validation.fit_percent:.3f} % on loops held out, '
        f'whiteness {fit.validation.whiteness:.2f}')
    print(f'{"amplitude V":>12}{"left of loop %":>16}')
    for level in fit.validation.levels:
        print(f'{level.amplitude_v:12.4g}{level.percent:16.3f}')
    if fit.coverage.warning:
        print(f'piezo: warning: {fit.coverage.warning}', file=sys.stderr)


def _compared(records: list[Record], elements: int) -> list['ModelScore']:
    """Fit other models, print how they do and return them."""
    from piezo_ros.identification.hysteresis.models.model_comparison import compare_records
    with working('fitting the other models'):
        rows = compare_records(records, elements=elements)
    print(f'{"model":28}{"parameters":>11}{"rms nm":>10}{"cross-validated nm":>20}')
    for row in rows:
        print(
            f'{row.name:28}{row.parameters_count:>11}{row.rms_um * 1e3:>10.2f}'
            f'{row.cross_validated_rms_um * 1e3:>20.2f}')
    return rows
