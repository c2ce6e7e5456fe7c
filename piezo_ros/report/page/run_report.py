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

"""Writes the report of scored runs, as `piezo run`, `simulate` and `report` do."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from piezo_ros.report.page.content import Paragraph, Section
from piezo_ros.report.page.page_writer import write_page
from piezo_ros.report.page.run_sections import (
    harmonics_sections,
    loop_section,
    nrmse_sections,
    pictures_section,
    results_section,
    run_facts,
)
from piezo_ros.report.run_tables import csv_table
from piezo_ros.report.score import ScoredRun

__all__ = ['write_report']


def write_report(
    directory: str | Path,
    *,
    title: str,
    runs: Sequence[ScoredRun],
    software: Mapping[str, str],
    notes: Sequence[str] = (),
    predictions: Mapping[str, Mapping[str, Any]] | None = None,
    plan: str = '',
    command: str = '',
) -> Path:
    """
    Write report.html, report.json, runs.csv and figures/ (SVG and PNG).

    The same arguments give the same bytes. Each file is replaced atomically, report.html last.

    Parameters
    ----------
    directory : str or Path
        Where to write; made when missing.
    title : str
        Heading of the report.
    runs : sequence of ScoredRun
        The runs, in the order of the tables.
    software : mapping of str to str
        Name to version, of everything that the numbers may depend on.
    notes : sequence of str, optional
        Paragraphs for the reader, such as lost samples and warnings.
    predictions : mapping of str to mapping, optional
        Bag of a run -> prediction for this run: ``nrmse_percent`` and ``by_harmonics``, number of
        harmonics to NRMSE in percent.
    plan, command : str, optional
        Text of the plan and the command line that made the runs.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If there is no run, or a number is not finite.
    OSError
        If a file cannot be written.

    """
    if not runs:
        raise ValueError('runs is empty, a report needs at least one run')
    predictions = predictions or {}
    predicted_by_harmonics = {
        bag: {int(m): float(percent) for m, percent in prediction['by_harmonics'].items()}
        for bag, prediction in predictions.items()}
    note_sections = (
        [Section('notes', 'Notes', [Paragraph(note) for note in notes])] if notes else [])
    return write_page(
        directory, title=title, lead=[run_facts(runs)], software=software, command=command,
        plan=plan, data={'runs': [_record(run, predictions) for run in runs]},
        files={'runs.csv': csv_table(runs)},
        sections=[
            results_section(runs, 'runs.csv'), loop_section(), *nrmse_sections(runs),
            *harmonics_sections(runs, predicted_by_harmonics), pictures_section(runs),
            *note_sections])


def _record(
    run: ScoredRun, predictions: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    prediction = predictions.get(run.bag)
    return run.record() | ({} if prediction is None else {'prediction': dict(prediction)})
