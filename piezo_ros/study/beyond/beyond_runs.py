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
The runs of the study of planned and learned scans.

Hysteresis and dynamics are identified from bags of the rig; nothing else of it is known to the
plans but its data sheet. Each cell of Table 4 is run as published, with re-identified models, as
planned, and with at most two runs that learn. The mismatches of the rig serve for what no
experiment could measure alone: the error without noise, and the true contraction of a learning.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.bag import Run, read
from piezo_ros.experiment.planned_scan import (
    ScanRequest,
    limits_of,
    planned_scan,
    stage_of,
)
from piezo_ros.experiment.scan_learning import ScanLearning
from piezo_ros.identification import (
    FrequencyResponse,
    UncertaintyBound,
    fit_dynamics,
    merge,
    uncertainty_bound,
)
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    LinearDynamics,
    RigParameters,
)
from piezo_ros.model.simulated_rig import Rig
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.planning.certificate import contraction
from piezo_ros.planning.periodic_plan import PeriodicPlan, regularisation_of
from piezo_ros.planning.periodic_stage import PeriodicStage
from piezo_ros.planning.scan import with_bound
from piezo_ros.report.metrics import nrmse
from piezo_ros.study.beyond.best_known import read_best_known
from piezo_ros.study.beyond.beyond_results import (
    AverageCurrentRun,
    BeyondResults,
    CellResult,
    LearnedScan,
    RobustnessRow,
    ScanRun,
)
from piezo_ros.study.experiments import (
    CREEP,
    Execute,
    PaperExperiments,
    run_error_percent,
)
from piezo_ros.study.table_4 import published_errors, table_cells

__all__ = ['BeyondExperiments', 'run_beyond_experiments']

_Run = Callable[[PlannedRun, Path], RunResult]

_IDENTIFICATION_AMPLITUDES_UM: Final = (0.1, 0.2, 0.4)
_RUNS: Final = 3  # as planned, and two that learn
_FAULT_RUNS: Final = 5
_FAULT_CELLS: Final = ((1.0, 500.0), (2.0, 600.0))
_AVERAGE_SHARE: Final = 0.5  # of the peak current; of an E-625 60 of 120 mA


@dataclass(frozen=True)
class _Fault:
    """What is wrong with the model, or with the stage in the run of a number."""

    name: str
    model: Callable[[ScanRequest], ScanRequest] = field(default=lambda request: request)
    plant: Callable[[RigParameters, int], Mapping[str, Any]] = field(
        default=lambda rig, number: {})


def _scaled(name: str, factor: float) -> Callable[[ScanRequest], ScanRequest]:
    """Return a change of every element of the hysteresis."""
    def change(request: ScanRequest) -> ScanRequest:
        values = tuple(factor * value for value in getattr(request.hysteresis, name))
        return replace(request, hysteresis=request.hysteresis.replaced(**{name: values}))
    return change


def _second_pair(factor: float) -> Callable[[ScanRequest], ScanRequest]:
    """Return a change of the resonance of the mechanics."""
    def change(request: ScanRequest) -> ScanRequest:
        dynamics = request.dynamics
        return replace(request, dynamics=dynamics.replaced(
            natural_frequency_2_rad_per_s=factor * dynamics.natural_frequency_2_rad_per_s))
    return change


_FAULTS: Final = (
    _Fault('u_S of the model +20 %', _scaled('saturation_v', 1.2)),
    _Fault('u_S of the model -20 %', _scaled('saturation_v', 0.8)),
    _Fault('kappa of the model +10 %', _scaled('kappa_um_per_v', 1.1)),
    _Fault('creep 2 % per decade', plant=lambda rig, number: CREEP),
    _Fault('noise 5 nm', plant=lambda rig, number: {'noise_rms_um': 0.005}),
    _Fault('gain drifts 0.3 % a run', plant=lambda rig, number: {
        'gain_mismatch': rig.gain_mismatch + 0.003 * number}),
    _Fault('omega_2 of the model -20 %', _second_pair(0.8)),
    _Fault('omega_2 of the model -40 %', _second_pair(0.6)),
)


def run_beyond_experiments(
    base: Mapping[str, Mapping[str, Any]], execute: Execute, run: _Run, directory: Path,
    cells: Sequence[tuple[float, float]] | None = None,
    fault_cells: Sequence[tuple[float, float]] = _FAULT_CELLS,
) -> BeyondResults:
    """
    Do every run of the study.

    Parameters
    ----------
    base : mapping of str to mapping
        Node to parameters: the rig, and the published compensator, controller and trajectory.
    execute : callable
        Does runs and yields them as read from their bags, in order.
    run : callable
        Does one run into the bag directory it is given.
    directory : Path
        Of the output.
    cells : sequence of (amplitude in um, frequency in Hz), optional
        Conditions of Table 4, all by default.
    fault_cells : sequence of (amplitude in um, frequency in Hz), optional
        Those of the faults.

    """
    study = BeyondExperiments(base, execute, run, directory)
    chosen = table_cells() if cells is None else tuple(cells)
    results = study.cells(chosen)
    average_v_per_s = _AVERAGE_SHARE * study.rig.slew_limit_v_per_s
    return BeyondResults(
        hysteresis=study.hysteresis_fit, dynamics=study.dynamics_fit, uncertainty=study.bound,
        slew_limit_v_per_s=study.rig.slew_limit_v_per_s, rails_v=study.rails_v,
        average_slew_v_per_s=average_v_per_s, cells=results,
        robustness=tuple(
            row for cell in fault_cells for row in study.robustness(*cell, results)),
        average_current=study.average_current(results, average_v_per_s))


class BeyondExperiments:
    """The runs of the study, group by group; the models are identified first."""

    def __init__(
        self, base: Mapping[str, Mapping[str, Any]], execute: Execute, run: _Run,
        directory: Path,
    ) -> None:
        self._base = base
        self._run = run
        self._directory = directory
        self._paper = PaperExperiments(base, execute)
        self.rig: RigParameters = self._paper.parameters('plant', RigParameters)
        self.hysteresis_fit = self._paper.hysteresis()
        hysteresis: HysteresisParameters = self.hysteresis_fit.parameters
        self._inverse = {
            name: values for name in hysteresis.names() if (values := getattr(hysteresis, name))}
        self._responses: list[FrequencyResponse] = self._paper.wide_responses(
            'identified', self._inverse, _IDENTIFICATION_AMPLITUDES_UM)
        self.dynamics_fit = fit_dynamics(merge(self._responses))
        assert self.dynamics_fit.parameters is not None
        self._dynamics: DynamicsParameters = self.dynamics_fit.parameters
        self.bound: UncertaintyBound = uncertainty_bound(
            self._responses, self.dynamics_fit.sampled_response)

    @property
    def rails_v(self) -> tuple[float, float]:
        """Rails, deviations from the operating point."""
        rig = self.rig
        return (
            rig.voltage_minimum_v - rig.operating_point_v,
            rig.voltage_maximum_v - rig.operating_point_v)

    def request(self, amplitude_um: float, frequency_hz: float) -> ScanRequest:
        """Return what is wanted of one condition, and all that is known for it."""
        return with_bound(ScanRequest(
            waveform='triangle', amplitude_um=amplitude_um, frequency_hz=frequency_hz,
            sample_period_s=float(self._base['trajectory'].get('sample_period_s', 1e-5)),
            dynamics=self._dynamics, hysteresis=self.hysteresis_fit.parameters,
            limits=limits_of(self.rig), noise_rms_um=self.rig.noise_rms_um), self.bound.magnitude)

    def cells(self, cells: Sequence[tuple[float, float]]) -> tuple[CellResult, ...]:
        """Return Table 4 as published, re-identified, planned and learned."""
        best_known = read_best_known(self.rig)
        model = {**self._dynamics.to_mapping(), 'model_response': 'sampled'}
        published = self._paper.table_4('published', cells).min(axis=1)
        identified = self._paper.table_4(
            'identified', cells, self._inverse, model).min(axis=1)
        paper = published_errors(cells).min(axis=1)
        return tuple(
            CellResult(
                cell[0], cell[1], paper_percent, published_percent, identified_percent,
                self.learned_scan(self.request(*cell), _place('learned', *cell), _RUNS),
                best_known.get(cell, float('nan')))
            for cell, paper_percent, published_percent, identified_percent in zip(
                cells, paper.tolist(), published.tolist(), identified.tolist(), strict=True))

    def robustness(
        self, amplitude_um: float, frequency_hz: float, cells: Sequence[CellResult],
    ) -> Iterator[RobustnessRow]:
        """Yield what comes of learning under each fault."""
        nominal = next((
            cell.scan for cell in cells
            if (cell.amplitude_um, cell.frequency_hz) == (amplitude_um, frequency_hz)), None)
        wanted = self.request(amplitude_um, frequency_hz)
        if nominal is None:
            nominal = self.learned_scan(
                wanted, _place('learned', amplitude_um, frequency_hz), _RUNS)
        for number, fault in enumerate(_FAULTS):
            request = self._judged(fault.model(wanted))
            place = _place(f'faults/{number:02d}', amplitude_um, frequency_hz)
            yield RobustnessRow(
                fault.name, amplitude_um, frequency_hz,
                self.learned_scan(request, place, _FAULT_RUNS, fault),
                nominal.learned.true_percent)

    def _judged(self, request: ScanRequest) -> ScanRequest:
        """Return the request with the W(s) that the bags give a model, its band untouched."""
        if request.dynamics == self._dynamics:
            return request
        wrong = LinearDynamics(request.dynamics)
        period_s = request.sample_period_s
        largest = max(
            float(np.abs(
                response.response / wrong.sampled_response(response.frequency_hz, period_s)
                - 1.0).max())
            for response in self._responses)
        return replace(request, uncertainty=largest, uncertainty_percent=50.0 * largest)

    def average_current(
        self, cells: Sequence[CellResult], average_v_per_s: float,
    ) -> tuple[AverageCurrentRun, ...]:
        """Return the scans that ask for more average current, planned within it, and run."""
        found = []
        for cell in cells:
            if cell.scan.runs[0].average_slew_v_per_s <= average_v_per_s:
                continue
            request = self.request(cell.amplitude_um, cell.frequency_hz)
            request = replace(request, limits=limits_of(self.rig, average_v_per_s))
            scan = self.learned_scan(
                request, _place('average', cell.amplitude_um, cell.frequency_hz), 1)
            found.append(AverageCurrentRun(
                cell.amplitude_um, cell.frequency_hz, scan.plan, scan.runs[0]))
        return tuple(found)

    def learned_scan(
        self, request: ScanRequest, place: str, most_runs: int, fault: _Fault | None = None,
    ) -> LearnedScan:
        """Return a planned scan with its runs on the stage."""
        fault = fault or _Fault('')
        plan = planned_scan(request)
        learning = ScanLearning(request, plan, self._directory / place, self._base)
        runs: list[ScanRun] = []
        rig = self.rig
        while not learning.is_done and len(learning.runs) < most_runs:
            changes = dict(fault.plant(self.rig, len(learning.runs)))
            rig = self.rig.replaced(**changes)
            learned = learning.next_run(_changed(self._run, changes))
            bag = read(self._directory / place / 'bags' / learned.name)
            runs.append(_scan_run(bag, rig, plan.reference_um.size))
        best = learning.best_run
        begin_percent, end_percent = (
            _true_percent(
                read(self._directory / place / 'bags' / learning.runs[number].name), rig,
                plan.reference_um.size)
            for number in (0, best))
        return LearnedScan(
            plan, tuple(runs), best, begin_percent, end_percent,
            _true_gamma(request, plan, rig))


def _place(group: str, amplitude_um: float, frequency_hz: float) -> str:
    return f'{group}_{amplitude_um:g}um_{frequency_hz:g}hz'


def _changed(run: _Run, changes: Mapping[str, Any]) -> _Run:
    """Return a run on a stage with other parameters."""
    def changed(planned: PlannedRun, bag: Path) -> RunResult:
        parameters = {
            **planned.parameters, 'plant': {**planned.parameters['plant'], **changes}}
        return run(PlannedRun(planned.name, parameters, planned.prediction), bag)
    return changed


def _scan_run(run: Run, rig: RigParameters, repetition: int) -> ScanRun:
    period_s = run.sample_period_s
    steps_v = np.abs(np.diff(run.voltage_v, prepend=0.0))
    return ScanRun(
        measured_percent=run_error_percent(run),
        true_percent=_true_percent(run, rig, repetition),
        slew_v_per_s=float(steps_v.max()) / period_s,
        average_slew_v_per_s=float(steps_v[-repetition:].mean()) / period_s,
        minimum_v=float(run.voltage_v.min()), maximum_v=float(run.voltage_v.max()))


def _true_percent(run: Run, rig: RigParameters, repetition: int) -> float:
    """Return the NRMSE of the last repetition, against the displacement without noise."""
    # The command is open loop: the same voltage moves the same stage without noise.
    silent = Rig(rig.replaced(noise_rms_um=0.0, adc_bits=0), run.sample_period_s)
    first_um = silent.measure()
    true_um = np.concatenate([[first_um], silent.run(run.voltage_v)])[:run.samples]
    last = slice(run.samples - repetition, run.samples)
    return 100.0 * nrmse(run.reference_um[last], true_um[last])


def _true_gamma(request: ScanRequest, plan: PeriodicPlan, rig: RigParameters) -> float:
    basis = plan.basis(plan.reference_um.size)
    voltage_v = plan.period_voltage_v
    slope = stage_of(request).linearise(voltage_v, basis).slope
    dynamics = LinearDynamics(rig.true_dynamics)
    true_slope = PeriodicStage(
        dynamics.before_hysteresis, rig, dynamics.behind_hysteresis, plan.sample_period_s,
        plan.reference_um.size, dynamics.delay_s).linearise(voltage_v, basis).slope
    return contraction(slope, true_slope, plan.weight, regularisation_of(slope))
