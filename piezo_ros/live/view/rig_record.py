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

"""What the page shows of one rig: samples, statuses, and what follows from them; bounded."""

import math
import statistics
import time
from collections import deque
from collections.abc import Mapping
from itertools import takewhile
from typing import Any, Final

from piezo_ros.control.waveform import EXCITATIONS, FILE
from piezo_ros.live.view.harmonic_fit import HarmonicFitError, covered_share, fit_harmonics
from piezo_ros.live.view.run_reference import RunReference
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['RigRecord', 'RunFacts']

_KEPT_SAMPLES: Final = 1200  # of each stream: a minute at 20 a second
_ANALYSED_SAMPLES: Final = 600
_FEWEST_SAMPLES: Final = 10
_ANALYSE_AGAIN_S: Final = 1.0
_LONGEST_TEXT: Final = 500
_SAME_UM: Final = 1e-9
_NM_PER_UM: Final = 1e3


class RunFacts:
    """
    What is known of a run before it begins.

    Parameters
    ----------
    planned : PlannedRun
        The run.

    """

    def __init__(self, planned: PlannedRun) -> None:
        self.description = planned.description
        self.samples = planned.trajectory.samples
        self.sample_period_s = planned.trajectory.sample_period_s
        self.reference = RunReference(planned)
        trajectory = planned.trajectory
        # Of a table, the fastest cycle is not known.
        self.cycle_samples = None if trajectory.waveform in (*EXCITATIONS, FILE) else (
            1.0 / (trajectory.frequency_hz * trajectory.sample_period_s))
        self.outline = self.reference.outline()
        limits = planned.hardware or planned.plant
        self.rails_v = (
            limits.voltage_minimum_v - limits.operating_point_v,
            limits.voltage_maximum_v - limits.operating_point_v)

    def as_mapping(self) -> dict[str, Any]:
        """Return the facts for the page."""
        return {
            'description': self.description, 'samples': self.samples,
            'sample_period_s': self.sample_period_s,
            'period_samples': self.reference.period_samples,
            'cycle_samples': self.cycle_samples,
            'follows_reference': self.reference.is_known,
            'rails_v': self.rails_v, 'outline': self.outline}


class RigRecord:
    """
    The newest samples and statuses of one rig.

    One thread at a time may call it.

    Parameters
    ----------
    name : str
        Name of the axis, '' for a rig that is alone.

    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._sequence = 0  # of the newest sample
        self._run = 0
        self._facts: RunFacts | None = None
        self._statuses: dict[str, dict[str, Any]] = {}
        # (sequence, index, displacement, reference or None) and (sequence, index, voltage)
        self._displacements: deque[tuple[int, int, float, float | None]] = deque(
            maxlen=_KEPT_SAMPLES)
        self._voltages: deque[tuple[int, int, float]] = deque(maxlen=_KEPT_SAMPLES)
        self._last_index: dict[str, int] = {}
        self._differs_from: int | None = None  # sample from which on the reference is another one
        self._analysis: dict[str, Any] = {}
        self._analysed_s = -math.inf

    def begin(self, planned: PlannedRun) -> None:
        """Forget the run before; what comes from now on is of this one."""
        self._facts = RunFacts(planned)
        self._run += 1
        self._statuses.clear()
        self._differs_from = None
        self._forget_samples()

    def _forget_samples(self) -> None:
        self._displacements.clear()
        self._voltages.clear()
        self._last_index.clear()
        self._analysis, self._analysed_s = {}, -math.inf

    def take_sample(self, stream: str, index: int, value: float) -> None:
        """Take the newest sample of a stream, which may be one that was taken before."""
        if self._facts is None or not math.isfinite(value):
            return
        last = self._last_index.get(stream, -1)
        if index == last or index > self._facts.samples:
            return
        if index < last:
            self._forget_samples()  # they were of a run before this one
        self._last_index[stream] = index
        reference = self._facts.reference
        if stream == 'displacement':
            self._sequence += 1
            self._displacements.append((self._sequence, index, value, reference.at(index)))
        elif stream == 'voltage':
            self._sequence += 1
            self._voltages.append((self._sequence, index, value))
        elif stream == 'reference' and self._differs_from is None:
            computed_um = reference.at(index)
            if computed_um is not None and abs(computed_um - value) > _SAME_UM:
                self._differs_from = index

    def take_status(self, status: Mapping[str, Any]) -> None:
        """Take the status of a node, as `parse_status` returns it."""
        self._statuses[status['node']] = {
            'state': status['state'][:_LONGEST_TEXT], 'index': status['index'],
            'reason': status['reason'][:_LONGEST_TEXT], 'voltage_v': status['voltage_v'],
            'elapsed_s': status['elapsed_s']}

    def snapshot(self, run: int, sequence: int) -> dict[str, Any]:
        """
        Return what a page shows that knows some of it already.

        Parameters
        ----------
        run, sequence : int
            The newest that the page has, of an earlier snapshot; 0 for nothing.

        """
        is_new = run != self._run
        since = 0 if is_new else sequence
        return {
            'name': self.name, 'run': self._run, 'sequence': self._sequence,
            'facts': self._facts.as_mapping() if is_new and self._facts else None,
            'statuses': dict(self._statuses),
            'tracking': _columns(_newer(self._displacements, since), 3),
            'voltage': _columns(_newer(self._voltages, since), 2),
            'analysis': self._analysed()}

    def _analysed(self) -> dict[str, Any]:
        now_s = time.monotonic()
        if self._facts and now_s - self._analysed_s >= _ANALYSE_AGAIN_S:
            self._analysis, self._analysed_s = self._analyse(self._facts), now_s
        return self._analysis

    def _analyse(self, facts: RunFacts) -> dict[str, Any]:
        reference = facts.reference
        period, settled = reference.period_samples, reference.settled_sample
        chosen = [sample for sample in self._displacements if sample[1] >= settled]
        chosen = chosen[-_ANALYSED_SAMPLES:]
        indices = [sample[1] for sample in chosen]
        signal = 'displacement'
        values = [sample[2] for sample in chosen]
        result: dict[str, Any] = {'samples': len(chosen), 'from_sample': settled}
        if reference.is_known:
            if self._differs_from is not None:
                return {
                    **result, 'refused_reference': True,
                    'refused': 'the trajectory sends another reference than the plan '
                    f'says since sample {self._differs_from} or before: no error is known'}
            pairs = [sample for sample in chosen if sample[3] is not None]
            indices = [sample[1] for sample in pairs]
            values = [sample[3] - sample[2] for sample in pairs]  # type: ignore[operator]
            signal = 'error'
        result['signal'] = signal
        if period is None:
            result['refused_spectrum'] = 'nothing in this run is repeated'
        if len(values) < _FEWEST_SAMPLES:
            return {
                **result, 'refused': f'{len(values)} samples after the soft start so far, '
                f'{_FEWEST_SAMPLES} are needed'}
        if signal == 'error':
            result.update(_error_figures(values, indices, facts))
        if period is not None:
            result.update(_spectrum(indices, values, period))
        return result


def _error_figures(
    errors_um: list[float], indices: list[int], facts: RunFacts,
) -> dict[str, Any]:
    """Return size of the error of some samples; NRMSE only where they are of the whole period."""
    squares = [error * error for error in errors_um]
    square = statistics.fmean(squares)
    rms_um = math.sqrt(square)
    # Two standard errors of the root, relative, are one of the mean of squares.
    doubt = statistics.pstdev(squares) / math.sqrt(len(squares)) / square if square else 0.0
    figures: dict[str, Any] = {
        'rms_nm': _NM_PER_UM * rms_um,
        'relative_doubt': doubt,
        'largest_nm': _NM_PER_UM * max(map(abs, errors_um))}
    references_um = [reference_um for _, reference_um in facts.outline]
    span_um = max(references_um) - min(references_um) if references_um else 0.0
    period = facts.reference.period_samples
    if period is not None and span_um > 0.0 and covered_share(indices, period) == 1.0:
        figures['nrmse_percent'] = 100.0 * rms_um / span_um
    return figures


def _spectrum(indices: list[int], values_um: list[float], period: float) -> dict[str, Any]:
    try:
        fit = fit_harmonics(indices, values_um, period)
    except HarmonicFitError as error:
        return {'refused_spectrum': str(error)}
    return {'spectrum': {
        'amplitudes_nm': (_NM_PER_UM * fit.amplitudes).tolist(),
        'standard_errors_nm': (_NM_PER_UM * fit.standard_errors).tolist(),
        'mean_nm': _NM_PER_UM * fit.mean, 'rest_rms_nm': _NM_PER_UM * fit.rest_rms}}


def _newer(samples: Any, sequence: int) -> list[Any]:
    """Return the samples after one, in order."""
    newest = list(takewhile(lambda sample: sample[0] > sequence, reversed(samples)))
    return newest[::-1]


def _columns(rows: list[Any], columns: int) -> list[list[Any]]:
    """Return samples column by column, without their sequence."""
    return [[row[1 + column] for row in rows] for column in range(columns)]
