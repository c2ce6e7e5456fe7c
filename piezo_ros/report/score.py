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

"""
Scores a run: its tracking error over the last periods, its condition, the published number.

    NRMSE = RMS(y_d - y) / (max y_d - min y_d)      Section 5 in Liu 2015
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import Recording, Run
from piezo_ros.paper import HARMONICS, table_4
from piezo_ros.parameters.roles import parameters_by_role
from piezo_ros.report.metrics import nrmse, tail
from piezo_ros.report.run_condition import RunCondition, run_condition
from piezo_ros.report.run_setup import RunSetup, RunStart, run_setup, run_start
from piezo_ros.report.settling import settling_periods

__all__ = ['ScoredRun', 'score']

_MS_PER_S: Final = 1e3
_PERCENT: Final = 100.0


@dataclass(frozen=True)
class ScoredRun:
    """
    The scores of one run and the samples that were scored.

    Attributes
    ----------
    scheme : str
        ``'fb'``, ``'ff'``, ``'fbff'`` or ``'open_loop'``.
    waveform : str
        ``'triangle'``, ``'sine'``, …
    amplitude_um, frequency_hz : float
        Peak amplitude, micrometres, and fundamental frequency, hertz.
    harmonics : int
        Highest harmonic m of the feedforward, (13) in Liu 2015.
    nrmse_percent, max_error_um : float
        Tracking error of the scored window: NRMSE, percent of the peak-to-peak reference, and the
        largest |y_d - y|, micrometres.
    bag : str
        Path of the bag, relative to the report's directory.
    samples : int
        Samples of the whole run.
    wall_seconds : float
        Wall time of the run, seconds; 0 when it was not measured.
    paper_nrmse_percent : float or None
        The published NRMSE (Table 4 in Liu 2015); None where the paper has none.
    time_s, reference_um, displacement_um, voltage_v : ndarray, shape (n,)
        The scored window; the time is that of the run.
    offset_um : float
        Mean of the reference, micrometres, as the trajectory was told; 0 where that is not known.
    condition : RunCondition
        Whether the run is stable, settled and within the limits of the amplifier.
    setup : RunSetup
        Gains, amplifier and date, as far as they are known.
    start : RunStart or None
        The first periods of the run; None where the scored window begins before their end.

    """

    scheme: str
    waveform: str
    amplitude_um: float
    frequency_hz: float
    harmonics: int
    nrmse_percent: float
    max_error_um: float
    bag: str
    samples: int
    wall_seconds: float
    paper_nrmse_percent: float | None
    time_s: NDArray[np.float64] = field(repr=False, compare=False)
    reference_um: NDArray[np.float64] = field(repr=False, compare=False)
    displacement_um: NDArray[np.float64] = field(repr=False, compare=False)
    voltage_v: NDArray[np.float64] = field(repr=False, compare=False)
    offset_um: float = 0.0
    condition: RunCondition = field(default_factory=RunCondition)
    setup: RunSetup = field(default_factory=RunSetup, compare=False)
    start: RunStart | None = field(default=None, repr=False, compare=False)

    @property
    def error_um(self) -> NDArray[np.float64]:
        """Tracking error y_d - y of the scored window, micrometres."""
        return self.reference_um - self.displacement_um

    @property
    def window_ms(self) -> NDArray[np.float64]:
        """Time since the first sample of the scored window, milliseconds."""
        elapsed_s: NDArray[np.float64] = self.time_s - self.time_s[0]
        return elapsed_s * _MS_PER_S

    @property
    def deviation_percent(self) -> float | None:
        """Deviation of the NRMSE from the published one, percent of it; None without one."""
        if self.paper_nrmse_percent is None:
            return None
        return (self.nrmse_percent / self.paper_nrmse_percent - 1.0) * _PERCENT

    @property
    def samples_per_wall_second(self) -> float | None:
        """Samples per second of wall time; None where no wall time was measured."""
        if self.wall_seconds <= 0.0:
            return None
        return self.samples / self.wall_seconds

    def record(self) -> dict[str, str | int | float]:
        """
        Return the run as the flat record of report.json.

        Returns
        -------
        dict
            Every scalar attribute under its own name; `paper_nrmse_percent` only where the paper
            has the number, `offset_um` where there is one, and the entries of
            `RunCondition.record`.

        """
        record: dict[str, str | int | float] = {
            'scheme': self.scheme,
            'waveform': self.waveform,
            'amplitude_um': self.amplitude_um,
            'frequency_hz': self.frequency_hz,
            'harmonics': self.harmonics,
            'nrmse_percent': self.nrmse_percent,
            'max_error_um': self.max_error_um,
            'bag': self.bag,
            'samples': self.samples,
            'wall_seconds': self.wall_seconds,
        }
        if self.paper_nrmse_percent is not None:
            record['paper_nrmse_percent'] = self.paper_nrmse_percent
        if self.offset_um:
            record['offset_um'] = self.offset_um
        return record | self.condition.record()


def score(
    run: Run | Recording, *, periods: float = 4, bag: str, wall_seconds: float,
) -> ScoredRun:
    """
    Score the last periods of a run.

    Parameters
    ----------
    run : piezo_ros.bag.Run or piezo_ros.bag.Recording
        The run, of which only the last periods are read. Its metadata has scheme, waveform,
        amplitude_um, frequency_hz and harmonics.
    periods : float, optional
        Periods of the fundamental to score: the last floor(periods * fs / f) samples.
    bag : str
        Path of the bag, relative to the report's directory.
    wall_seconds : float
        Wall time of the run, seconds; 0 when it was not measured.

    Returns
    -------
    ScoredRun
        The scored window and its scores.

    Raises
    ------
    ValueError
        If the metadata lacks a key or contains an unreadable value, if the run is shorter than the
        window, if a sample is not finite, or if `wall_seconds` is negative or not finite.

    """
    if not (math.isfinite(wall_seconds) and wall_seconds >= 0):
        raise ValueError(f'wall_seconds is {wall_seconds}, it must be finite and at least 0')
    scheme, waveform = _entry(run.metadata, 'scheme'), _entry(run.metadata, 'waveform')
    amplitude_um = _number(run.metadata, 'amplitude_um')
    frequency_hz = _number(run.metadata, 'frequency_hz')
    harmonics = _number(run.metadata, 'harmonics')
    if harmonics != int(harmonics):
        raise ValueError(f'harmonics of the run is {harmonics}, it must be an integer')
    window = tail(run.samples, frequency_hz, run.sample_period_s, periods)
    # What comes before the window tells whether the run has settled in it.
    before = min(window.start, math.ceil(
        2 * settling_periods(periods) / (frequency_hz * run.sample_period_s)))
    end = run.part(window.start - before, window.stop)
    streams = {
        name: np.asarray(getattr(end, name), dtype=np.float64)
        for name in ('reference_um', 'displacement_um', 'voltage_v')}
    scored = {name: values[before:] for name, values in streams.items()}
    reference_um, displacement_um = scored['reference_um'], scored['displacement_um']
    nrmse_percent = nrmse(reference_um, displacement_um) * _PERCENT
    trajectory = parameters_by_role(run.parameters).get('trajectory', {})
    offset_um = _told(trajectory, 'offset_um')
    published = (
        waveform == 'triangle' and harmonics == HARMONICS and not offset_um
        and not _told(trajectory, 'turn_fraction'))
    return ScoredRun(
        scheme=scheme,
        waveform=waveform,
        amplitude_um=amplitude_um,
        frequency_hz=frequency_hz,
        harmonics=int(harmonics),
        nrmse_percent=nrmse_percent,
        max_error_um=float(np.max(np.abs(reference_um - displacement_um))),
        bag=bag,
        samples=run.samples,
        wall_seconds=float(wall_seconds),
        paper_nrmse_percent=table_4(scheme, amplitude_um, frequency_hz) if published else None,
        time_s=end.time_s[before:],
        **scored,
        offset_um=offset_um,
        condition=run_condition(
            run.parameters, **streams, frequency_hz=frequency_hz,
            sample_period_s=run.sample_period_s, scored_periods=periods,
            scored_samples=reference_um.size, samples=run.start_index + run.samples),
        setup=run_setup(run, scheme),
        start=run_start(run, frequency_hz, before=window.start))


def _told(parameters: Mapping[str, Any], name: str) -> float:
    """Return a number among the parameters of a node, 0 where a foreign node has none."""
    value = parameters.get(name, 0.0)
    return float(value) if isinstance(value, int | float) else 0.0


def _entry(metadata: Mapping[str, str], key: str) -> str:
    if key not in metadata:
        present = ', '.join(sorted(metadata)) or 'none'
        raise ValueError(f'the metadata of the run lacks {key!r}, it has {present}')
    return metadata[key]


def _number(metadata: Mapping[str, str], key: str) -> float:
    text = _entry(metadata, key)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f'{key} of the run is {text!r}, it must be a finite number')
    return value
