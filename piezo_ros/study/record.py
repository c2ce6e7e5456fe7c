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

"""The numbers of a study for programs: what report.json contains beside the page."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros import paper
from piezo_ros.identification import DynamicsFit, ExcludedPoint, FrequencyResponse
from piezo_ros.model import LinearDynamics
from piezo_ros.report import nrmse
from piezo_ros.report.metrics import tail
from piezo_ros.study.results import Crossing, HarmonicsTrial, PaperResults, StaticLoop
from piezo_ros.study.rig_calibration import HELD_OUT_ROWS_UM
from piezo_ros.study.table_3 import beyond_published_band_hz
from piezo_ros.study.table_4 import Agreement, agreement, published_errors

__all__ = [
    'agreement_of',
    'held_out',
    'left_out',
    'published_uncertainty',
    'recommendations',
    'rows_outside',
    'rows_within',
    'study_record',
    'within_published_band',
]

FORMAT_VERSION = 1
_PERCENT = 100.0
_BAND_TOLERANCE_HZ = 50.0


def study_record(results: PaperResults, bags: dict[str, str]) -> dict[str, Any]:
    """
    Return the content of report.json, without versions.

    Parameters
    ----------
    results : PaperResults
        The study.
    bags : dict of str to str
        Scheme to the bag of its scan, relative to the report.

    Returns
    -------
    dict
        runs, table3, table4 and its re-identified and automatic forms, harmonics, nonlinearity,
        margins, identified, agreement.

    """
    return {
        'format_version': FORMAT_VERSION,
        'runs': [_scan(results, scheme, bags.get(scheme, '')) for scheme in results.scans],
        'table3': [_crossing(crossing) for crossing in results.crossings],
        'table4': _table_4(results, results.table_4_published),
        'rig_that_warms': {
            'table3': [_crossing(crossing) for crossing in results.warming.crossings],
            'table4': _table_4(results, results.warming.table_4),
            'agreement': {
                name: found._asdict() for name, found in _agreements(
                    results, results.warming.table_4)}},
        'table4_identified': _table_4(results, results.table_4_identified),
        'table4_automatic': [
            {**row, 'harmonics_ff': point.harmonics['ff'],
             'harmonics_fbff': point.harmonics['fbff'], 'recommended_scheme': point.scheme,
             'predicted': dict(point.predicted_nrmse_percent)}
            for row, point in zip(
                _table_4(results, results.table_4_automatic), results.points, strict=True)],
        'recommended_schemes_right': recommendations(results),
        'harmonics': [_trial(trial) for trial in results.trials],
        'agreement': {
            name: found._asdict() for name, found in _agreements(
                results, results.table_4_published)},
        'nonlinearity': {
            'uncompensated': _nonlinearity(results.uncompensated),
            'compensated': _nonlinearity(results.compensated),
            'compensated_identified': _nonlinearity(results.compensated_identified),
            'compensated_creeping': _nonlinearity(results.compensated_creeping),
        },
        'margins': {
            'published': results.loop_published.record(),
            'identified': results.loop_identified.record(),
            'tuned': results.tuning.after.record(),
        },
        'identified': {
            'hysteresis': {
                **results.hysteresis.parameters.to_mapping(),
                'rms_um': results.hysteresis.rms_um},
            'dynamics': _dynamics(results.dynamics),
            'dynamics_behind_published_inverse': _dynamics(results.dynamics_published),
            'uncertainty': {
                'numerator': results.uncertainty.numerator.tolist(),
                'denominator': results.uncertainty.denominator.tolist(),
                'mean_excess_db': results.uncertainty.mean_excess_db,
                'smallest_margin': results.uncertainty.smallest_margin,
                'points': results.uncertainty.frequency_hz.size,
                'left_out': [
                    {'frequency_hz': point.frequency_hz, 'amplitude_um': point.amplitude,
                     'offset_um': point.offset, 'reason': point.reason}
                    for point in left_out(results.identified_responses)]},
            'controller': {
                'proportional_gain': results.tuning.proportional_gain,
                'integral_gain_per_s': results.tuning.integral_gain_per_s},
        },
    }


def held_out(results: PaperResults) -> NDArray[np.bool_]:
    """Return which conditions the calibration of the rig never saw, shape (conditions,)."""
    return np.array([amplitude_um in HELD_OUT_ROWS_UM for amplitude_um, _ in results.cells])


def agreement_of(
    results: PaperResults, errors: NDArray[np.float64], *, unseen: bool = False,
) -> Agreement:
    """Return how close errors, shape (conditions, 2), are to Table 4, or to its unseen rows."""
    rows = held_out(results) if unseen else slice(None)
    return agreement(errors[rows], published_errors(results.cells)[rows])


def rows_within(crossings: Iterable[Crossing]) -> int:
    """Return how many rows of Table 3 are within 50 Hz of the published band."""
    return sum(map(within_published_band, crossings))


def rows_outside(crossings: Iterable[Crossing]) -> str:
    """Return the amplitudes of the other rows; '' for none."""
    return ', '.join(
        f'{crossing.amplitude_um:g} µm' for crossing in crossings
        if not within_published_band(crossing))


def within_published_band(crossing: Crossing) -> bool:
    """Return whether a crossing lies in the published band, or within 50 Hz of it."""
    beyond_hz = beyond_published_band_hz(crossing.amplitude_um, crossing.crossing_hz)
    return beyond_hz <= _BAND_TOLERANCE_HZ


def left_out(responses: Sequence[FrequencyResponse]) -> list[ExcludedPoint]:
    """Return the points of some responses that were left out, mostly where the amplifier slews."""
    return [point for response in responses for point in response.excluded]


def _dynamics(fit: DynamicsFit) -> dict[str, dict[str, float]]:
    return {
        name: {'value': value, 'standard_error': fit.standard_errors[name]}
        for name, value in fit.values.items()}


def recommendations(results: PaperResults) -> int:
    """Return in how many conditions the recommended of FF and FBFF was the better one."""
    better = np.where(results.table_4_automatic[:, 0] < results.table_4_automatic[:, 1],
                      'ff', 'fbff')
    return sum(
        point.scheme == scheme for point, scheme in zip(results.points, better, strict=True))


def published_uncertainty(
    results: PaperResults,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies and |Delta|, (7), of the rig against the G of Table 2 behind the hold."""
    responses = results.compensated_responses
    frequency_hz = np.concatenate([response.frequency_hz for response in responses])
    measured = np.concatenate([response.response for response in responses])
    model = LinearDynamics().sampled_response(frequency_hz, responses[0].sample_period_s)
    return frequency_hz, np.abs(measured / model - 1.0)


def _trial(trial: HarmonicsTrial) -> dict[str, Any]:
    return {
        'amplitude_um': trial.point.amplitude_um, 'frequency_hz': trial.point.frequency_hz,
        'scheme': 'ff', 'chosen': trial.point.harmonics['ff'],
        'harmonics': list(trial.harmonics),
        'predicted': [trial.predicted_percent[m] for m in trial.harmonics],
        'measured': list(trial.measured_percent)}


def _scan(results: PaperResults, scheme: str, bag: str) -> dict[str, Any]:
    run = results.scans[scheme]
    frequency_hz, amplitude_um = 300.0, 2.5
    window = tail(run.samples, frequency_hz, run.sample_period_s, 4.0)
    reference_um, displacement_um = run.reference_um[window], run.displacement_um[window]
    record: dict[str, Any] = {
        'scheme': scheme, 'waveform': 'triangle', 'amplitude_um': amplitude_um,
        'frequency_hz': frequency_hz, 'harmonics': paper.HARMONICS,
        'nrmse_percent': _PERCENT * nrmse(reference_um, displacement_um),
        'max_error_um': float(np.abs(reference_um - displacement_um).max()),
        'bag': bag, 'samples': run.samples,
    }
    published = paper.table_4(scheme, amplitude_um, frequency_hz)
    if published is not None:
        record['paper_nrmse_percent'] = published
    if scheme in paper.MAXIMUM_ERROR_300_HZ_UM:
        record['paper_max_error_um'] = paper.MAXIMUM_ERROR_300_HZ_UM[scheme]
    return record


def _crossing(crossing: Crossing) -> dict[str, Any]:
    low_hz, high_hz = paper.TABLE_3[crossing.amplitude_um]
    return {
        'amplitude_um': crossing.amplitude_um,
        'crossing_hz': _finite(crossing.crossing_hz),
        'predicted_hz': _finite(crossing.predicted_hz),
        'paper_low_hz': low_hz, 'paper_high_hz': high_hz,
        'within_50_hz': within_published_band(crossing),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _table_4(results: PaperResults, errors: Any) -> list[dict[str, float]]:
    return [
        {'amplitude_um': amplitude_um, 'frequency_hz': frequency_hz, 'ff': float(ff),
         'fbff': float(fbff), 'paper_ff': float(paper_ff), 'paper_fbff': float(paper_fbff)}
        for (amplitude_um, frequency_hz), (ff, fbff), (paper_ff, paper_fbff) in zip(
            results.cells, errors, published_errors(results.cells), strict=True)]


def _agreements(
    results: PaperResults, errors: NDArray[np.float64],
) -> Iterator[tuple[str, Agreement]]:
    yield 'all', agreement_of(results, errors)
    yield 'held_out_rows', agreement_of(results, errors, unseen=True)


def _nonlinearity(loop: StaticLoop) -> dict[str, float]:
    return {
        'input': _PERCENT * loop.nonlinearity.input, 'output': _PERCENT * loop.nonlinearity.output}
