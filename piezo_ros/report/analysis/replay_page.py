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

"""The page of a replay: the recorded run beside the replayed one, and their difference."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.report.analysis.panel_figure import chart_picture
from piezo_ros.report.analysis.replayed_run import ReplayedRun
from piezo_ros.report.figures.style import INK, SERIES
from piezo_ros.report.page.chart import Panel, Trace
from piezo_ros.report.page.content import Column, Facts, Paragraph, Picture, Section, Table
from piezo_ros.report.page.page_writer import write_page

__all__ = ['write_replay_page']

_TIME: Final = 'time (ms)'
_RECORDED: Final[dict[str, Any]] = {'colour': INK, 'style': 'solid', 'width_px': 2.2}
_REPLAYED: Final[dict[str, Any]] = {'colour': SERIES[3], 'style': 'dashed', 'width_px': 1.6}


def write_replay_page(
    directory: Path, *, title: str, run: ReplayedRun, remarks: Sequence[str],
    software: Mapping[str, str], command: str = '',
) -> Path:
    """
    Write report.html, report.json, tables/ and figures/ of a replay.

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading.
    run : ReplayedRun
        Both runs.
    remarks : sequence of str
        What was replaced, where the rig is from, and whether the replay is faithful.
    software, command
        As for `write_page`.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If the reference is constant, or a sample is not finite.
    OSError
        If a file cannot be written.

    """
    names = ('recorded', 'replayed')
    figures = {
        'nrmse_percent': run.nrmse_percent(), 'max_error_um': run.max_error_um(),
        'max_voltage_v': run.max_voltage_v()}
    difference_um = run.displacement_um[1] - run.displacement_um[0]
    facts = [
        (f'{percent:.3g} %', f'NRMSE, {name}')
        for name, percent in zip(names, figures['nrmse_percent'], strict=True)]
    facts.append((f'{1e3 * np.sqrt(np.mean(difference_um ** 2)):.3g} nm', 'rms of the difference'))
    return write_page(
        directory, title=title, lead=[Facts(facts), *map(Paragraph, remarks)], software=software,
        command=command,
        data={name: {key: values[k] for key, values in figures.items()}
              for k, name in enumerate(names)},
        sections=[
            Section('scores', 'Errors', [Table(
                [Column('run'), Column('NRMSE', '%', '.3f'), Column('largest error', 'µm', '.4f'),
                 Column('largest voltage', 'V', '.4f')],
                [[name, *(values[k] for values in figures.values())]
                 for k, name in enumerate(names)],
                f'From {run.time_s[run.scored][0]:.6g} s to {run.time_s[run.scored][-1]:.6g} s, '
                'behind the transients of the start.')]),
            Section('runs', 'Recorded beside replayed', [_tracking(run)]),
            Section('difference', 'What the replay changes', [_difference(run)])])


def _tracking(run: ReplayedRun) -> Picture:
    time_ms = 1e3 * run.time_s
    displacement, voltage, error = [
        Trace('reference', time_ms, run.reference_um, SERIES[0], 'dotted')], [], []
    for k, (name, look) in enumerate((('recorded', _RECORDED), ('replayed', _REPLAYED))):
        displacement.append(Trace(name, time_ms, run.displacement_um[k], **look))
        error.append(Trace(
            name, time_ms, 1e3 * (run.reference_um - run.displacement_um[k]), **look))
        voltage.append(Trace(name, time_ms, run.voltage_v[k], **look))
    return chart_picture(
        'tracking', 'Displacement with the reference, tracking error, and voltage of both runs.', [
            Panel(_TIME, 'displacement (µm)', displacement), Panel(_TIME, 'error (nm)', error),
            Panel(_TIME, 'voltage (V)', voltage)])


def _difference(run: ReplayedRun) -> Picture:
    time_ms = 1e3 * run.time_s
    return chart_picture(
        'difference', 'Replayed less recorded displacement and voltage; zero throughout where '
        'nothing was replaced and the rig is that of the recording.', [
            Panel(_TIME, 'displacement (nm)', [Trace(
                'replayed − recorded', time_ms,
                1e3 * (run.displacement_um[1] - run.displacement_um[0]), SERIES[2])]),
            Panel(_TIME, 'voltage (V)', [Trace(
                'replayed − recorded', time_ms, run.voltage_v[1] - run.voltage_v[0],
                SERIES[0], 'dashed')])])
