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

"""Groups runs by their reference and compares them with the published errors."""

import statistics
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from piezo_ros.report.score import ScoredRun

__all__ = ['Agreement', 'Case', 'agreement', 'cases']


class Case(NamedTuple):
    """
    The runs that tracked the same reference.

    Attributes
    ----------
    waveform : str
        ``'triangle'``, ``'sine'``, …
    amplitude_um, frequency_hz : float
        Peak amplitude, micrometres, and fundamental frequency, hertz.
    runs : tuple of ScoredRun
        In their given order.
    offset_um : float
        Mean of the reference, micrometres.

    """

    waveform: str
    amplitude_um: float
    frequency_hz: float
    runs: tuple[ScoredRun, ...]
    offset_um: float = 0.0

    @property
    def name(self) -> str:
        """Its reference in the names of files, unique among the cases of a report."""
        about = f'-about-{self.offset_um:g}um' if self.offset_um else ''
        return f'{self.waveform}-{self.amplitude_um:g}um{about}-{self.frequency_hz:g}Hz'

    @property
    def title(self) -> str:
        """Waveform, amplitude, offset and frequency of the reference, for a heading."""
        about = f' about {self.offset_um:g} µm' if self.offset_um else ''
        return (
            f'{self.waveform.capitalize()}, {self.amplitude_um:g} µm{about}, '
            f'{self.frequency_hz:g} Hz')


class Agreement(NamedTuple):
    """
    Agreement of a set of runs with Table 4 in Liu 2015.

    Attributes
    ----------
    numbers : int
        Runs for which the paper has a number.
    median_deviation_percent : float or None
        Median |NRMSE / published - 1|, percent; None without a published number.
    pairs : int
        Cases with one published FF and one published FBFF run.
    same_winner : int
        Pairs in which the better scheme is the same as in the paper.

    """

    numbers: int
    median_deviation_percent: float | None
    pairs: int
    same_winner: int


def cases(runs: Iterable[ScoredRun]) -> tuple[Case, ...]:
    """
    Group runs by waveform, amplitude, frequency and offset.

    Parameters
    ----------
    runs : iterable of ScoredRun
        The runs.

    Returns
    -------
    tuple of Case
        In the order of their first run.

    """
    groups: dict[tuple[str, float, float, float], list[ScoredRun]] = {}
    for run in runs:
        key = run.waveform, run.amplitude_um, run.frequency_hz, run.offset_um
        groups.setdefault(key, []).append(run)
    return tuple(
        Case(*key[:3], tuple(members), key[3]) for key, members in groups.items())


def agreement(runs: Sequence[ScoredRun]) -> Agreement:
    """
    Compare runs with the published numbers.

    Parameters
    ----------
    runs : sequence of ScoredRun
        The runs; those without a published number are left out.

    Returns
    -------
    Agreement
        Counts and the median deviation.

    """
    published = [run for run in runs if run.paper_nrmse_percent is not None]
    deviations = [abs(run.deviation_percent or 0.0) for run in published]
    pairs = [pair for case in cases(published) if (pair := _ff_and_fbff(case.runs)) is not None]
    return Agreement(
        numbers=len(published),
        median_deviation_percent=statistics.median(deviations) if deviations else None,
        pairs=len(pairs),
        same_winner=sum(_same_winner(*pair) for pair in pairs))


def _ff_and_fbff(runs: Sequence[ScoredRun]) -> tuple[ScoredRun, ScoredRun] | None:
    by_scheme = {run.scheme: run for run in runs}
    if len(runs) != 2 or by_scheme.keys() != {'ff', 'fbff'}:
        return None
    return by_scheme['ff'], by_scheme['fbff']


def _same_winner(ff: ScoredRun, fbff: ScoredRun) -> bool:
    assert ff.paper_nrmse_percent is not None
    assert fbff.paper_nrmse_percent is not None
    ours = ff.nrmse_percent < fbff.nrmse_percent
    return ours == (ff.paper_nrmse_percent < fbff.paper_nrmse_percent)
