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

"""The numbers of the study for programs: what report.json contains beside the page."""

import math
from dataclasses import asdict
from typing import Any

from piezo_ros.study.beyond.beyond_results import BeyondResults, LearnedScan
from piezo_ros.study.beyond.targets import targets

__all__ = ['beyond_record']


def beyond_record(results: BeyondResults) -> dict[str, Any]:
    """
    Return the content of report.json, without versions.

    Parameters
    ----------
    results : BeyondResults
        The study.

    Returns
    -------
    dict
        cells, robustness, average_current, merit, identified.

    """
    return {
        'cells': [
            {'amplitude_um': cell.amplitude_um, 'frequency_hz': cell.frequency_hz,
             'paper_percent': cell.paper_percent, 'published_percent': cell.published_percent,
             'identified_percent': cell.identified_percent,
             'best_known_percent': _finite(cell.best_known_percent), 'factor': cell.factor,
             **_scan(cell.scan)}
            for cell in results.cells],
        'robustness': [
            {'fault': row.fault, 'amplitude_um': row.amplitude_um,
             'frequency_hz': row.frequency_hz, 'nominal_percent': row.nominal_percent,
             **_scan(row.scan)}
            for row in results.robustness],
        'average_current': [
            {'amplitude_um': each.amplitude_um, 'frequency_hz': each.frequency_hz,
             'predicted_percent': each.plan.measured_nrmse_percent, **asdict(each.run)}
            for each in results.average_current],
        'merit': [
            {**target._asdict(), 'holds': target.holds} for target in targets(results)],
        'identified': {
            'hysteresis': {
                **results.hysteresis.parameters.to_mapping(),
                'rms_um': results.hysteresis.rms_um},
            'dynamics': dict(results.dynamics.values),
            'uncertainty': {
                'numerator': results.uncertainty.numerator.tolist(),
                'denominator': results.uncertainty.denominator.tolist()}},
    }


def _scan(scan: LearnedScan) -> dict[str, Any]:
    plan = scan.plan
    return {
        'predicted_percent': plan.measured_nrmse_percent,
        'predicted_true_percent': plan.predicted_nrmse_percent,
        'predicted_at_most_percent': plan.highest_nrmse_percent,
        'truncation_percent': plan.truncation_percent,
        'gamma': plan.certificate.gamma, 'true_gamma': scan.true_gamma,
        'band_harmonic': int(plan.orders[-1]),
        'runs': [asdict(run) for run in scan.runs], 'best': scan.best,
        'begin_percent': scan.begin_percent, 'end_percent': scan.end_percent,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
