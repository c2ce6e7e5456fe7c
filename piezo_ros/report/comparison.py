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

"""Runs grouped by what they tracked, and how they compare with the published numbers."""

import statistics
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from piezo_ros.report.score import ScoredRun

__all__ = ['Agreement', 'Case', 'agreement', 'cases', 'scheme_label', 'series_label']

_SCHEME_LABELS: Final = {'fb': 'FB', 'ff': 'FF', 'fbff': 'FBFF', 'open_loop': 'open loop'}


class Case(NamedTuple):
    """
    The runs that tracked one and the same reference.

    Attributes
    ----------
    waveform : str
        ``'triangle'``, ``'sine'``, …
    amplitude_um, frequency_hz : float
        Peak amplitude, micrometres, and fundamental frequency, hertz.
    runs : tuple of ScoredRun
        In the order they were given.

    """

    waveform: str
    amplitude_um: float
    frequency_hz: float
    runs: tuple[ScoredRun, ...]

    @property
    def title(self) -> str:
        """What was tracked, for a heading."""
        return f'{self.waveform.capitalize()}, {self.amplitude_um:g} µm, {self.frequency_hz:g} Hz'


class Agreement(NamedTuple):
    """
    How the runs compare with Table 4 in Liu 2015.

    Attributes
    ----------
    numbers : int
        Runs for which the paper has a number.
    median_deviation_percent : float or None
        Median |NRMSE / published - 1|, percent; None without a published number.
    pairs : int
        Cases with one published FF and one published FBFF run.
    same_winner : int
        Pairs in which the better of the two is the published one.

    """

    numbers: int
    median_deviation_percent: float | None
    pairs: int
    same_winner: int


def cases(runs: Iterable[ScoredRun]) -> tuple[Case, ...]:
    """
    Group runs by waveform, amplitude and frequency.

    Parameters
    ----------
    runs : iterable of ScoredRun
        The runs.

    Returns
    -------
    tuple of Case
        In the order of their first run.

    """
    groups: dict[tuple[str, float, float], list[ScoredRun]] = {}
    for run in runs:
        key = run.waveform, run.amplitude_um, run.frequency_hz
        groups.setdefault(key, []).append(run)
    return tuple(Case(*key, tuple(members)) for key, members in groups.items())


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


def scheme_label(scheme: str) -> str:
    """Return the name of a scheme as the paper prints it."""
    return _SCHEME_LABELS.get(scheme, scheme)


def series_label(run: ScoredRun, among: Sequence[ScoredRun]) -> str:
    """
    Return the shortest name that tells a run from others in one picture.

    Parameters
    ----------
    run : ScoredRun
        The run.
    among : sequence of ScoredRun
        All runs of the picture.

    Returns
    -------
    str
        The scheme; with the harmonics, and then the bag, where that is not enough.

    """
    rivals = [other for other in among if other is not run and other.scheme == run.scheme]
    label = scheme_label(run.scheme)
    if not rivals:
        return label
    label = f'{label}, m = {run.harmonics}'
    if all(other.harmonics != run.harmonics for other in rivals):
        return label
    return f'{label}, {run.bag}'


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
