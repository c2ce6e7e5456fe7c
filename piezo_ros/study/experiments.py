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
The experiments of Liu 2015: which runs, in which order, and what is computed from them.

First the runs that need no model of our own: static loops, identification, Tables 3 and 4 as
published. Then the models are identified from their bags, and Table 4 is run again with these.
A callable does the runs: on live nodes, or offline with the same steps.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros import paper
from piezo_ros.bag import Run
from piezo_ros.bag.recorded_node import recorded_parameters
from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.experiment.plan import plan_run
from piezo_ros.experiment.plan.automatic import known_rig
from piezo_ros.experiment.plan.packaged_plans import packaged_configuration
from piezo_ros.experiment.recorded_response import recorded_response
from piezo_ros.identification import (
    DynamicsFit,
    FrequencyResponse,
    HysteresisFit,
    OperatingPoint,
    UncertaintyBound,
    equal_error_frequency_hz,
    fit_dynamics,
    fit_hysteresis,
    merge,
    predict_operating_points,
    uncertainty_bound,
)
from piezo_ros.identification.tuning.loop_shape import loop_shape
from piezo_ros.identification.tuning.pi_tuning import tune_pi
from piezo_ros.model import HysteresisParameters, LinearDynamics, RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_file
from piezo_ros.parameters.run_and_result import PlannedRun
from piezo_ros.report.metrics import nonlinearity, nrmse, tail
from piezo_ros.study.results import (
    Crossing,
    HarmonicsTrial,
    PaperResults,
    StaticLoop,
    WarmingResults,
    known_frequency_hz,
)
from piezo_ros.study.table_3 import SINE_FREQUENCIES_HZ
from piezo_ros.study.table_4 import SCHEMES, table_cells

__all__ = [
    'CREEP', 'Execute', 'PaperExperiments', 'rig_that_warms', 'run_error_percent',
    'run_experiments',
]

Execute = Callable[[Sequence[PlannedRun]], Iterator[Run]]
_Floats = NDArray[np.float64]

SCORE_PERIODS: Final = 4.0
PERIODS: Final = 15.0
_PERCENT: Final = 100.0
_SWEEP: Final = {'waveform': 'stepped_sine', 'harmonics': 0, 'dwell_s': 0.02}
# The static experiments are slow and sampled slowly, as in the paper.
_STATIC: Final = {'sample_period_s': 1e-4}
_RESPONSE_FREQUENCIES_HZ: Final = tuple(float(f'{f:.4g}') for f in np.geomspace(20.0, 2000.0, 20))
# Creep shows below, where sampling slowly is enough.
_SLOW_FREQUENCIES_HZ: Final = (1.0, 2.0, 5.0, 10.0)
_SLOW: Final = {'sample_period_s': 1e-3}
# Piezo ceramics creep by one or two percent per decade; the paper has no number.
CREEP: Final = {'creep_per_decade': 0.02, 'creep_start_s': 1e-3}
_TRIED_HARMONICS: Final = (1, 3, 5, 7, 9, 11, 15, 21, 31, 41)
_TRIED_CELLS: Final = tuple((a, f) for f in (300.0, 800.0) for a in (0.5, 1.5, 2.5))
_WIDE_FREQUENCIES_HZ: Final = tuple(float(f'{f:.4g}') for f in np.geomspace(20.0, 8000.0, 30))
_LOOP_FREQUENCIES_HZ: Final = tuple(float(f'{f:.4g}') for f in np.geomspace(100.0, 12000.0, 24))
# For the figures: past the second resonance, at amplitudes that the amplifier follows up to there.
_HIGH_FREQUENCIES_HZ: Final = tuple(float(f'{f:.4g}') for f in np.geomspace(20.0, 12000.0, 40))
_SMALL_AMPLITUDE_V: Final = 0.2
_SMALL_AMPLITUDE_UM: Final = 0.2
_IDENTIFICATION_AMPLITUDES_UM: Final = (0.1, 0.2, 0.4)
_AMPLITUDES_V: Final = (0.5, 1.0, 1.5, 2.0, 2.5)
_OFFSETS_V: Final = (-1.5, -0.75, 0.0, 0.75, 1.5)
_MOST_SENSITIVE: Final = 1.6


def run_experiments(
    base: Mapping[str, Mapping[str, Any]], execute: Execute,
) -> PaperResults:
    """
    Do every run of the study and compute every table and figure.

    Parameters
    ----------
    base : mapping of str to mapping
        Node to parameters: the rig, and the published compensator, controller and trajectory.
    execute : callable
        Does runs and yields them as read from their bags, in order.

    Returns
    -------
    PaperResults
        All results.

    """
    study = PaperExperiments(base, execute)
    uncompensated, compensated = study.static_loops()
    hysteresis = study.hysteresis()
    inverse = {
        name: values for name in hysteresis.parameters.names()
        if (values := getattr(hysteresis.parameters, name))}
    identified_loop = study.compensated_loop('identified', inverse)
    dynamics = study.dynamics('identified', inverse, _IDENTIFICATION_AMPLITUDES_UM)
    dynamics_published = study.dynamics('published', {}, _IDENTIFICATION_AMPLITUDES_UM[1:2])
    assert dynamics.parameters is not None
    assert dynamics_published.parameters is not None
    responses = study.responses('identified', inverse)
    bound = uncertainty_bound(responses, dynamics.sampled_response)
    law = study.parameters('controller', ControllerParameters)
    tuning = tune_pi(
        LinearDynamics(dynamics.parameters), bound=bound, max_sensitivity=_MOST_SENSITIVE,
        measurement_delay_samples=law.measurement_delay_samples)
    model = {**dynamics.parameters.to_mapping(), 'model_response': 'sampled'}
    # Nothing of the rig's secrets: the identified models, and its data sheet.
    known = known_rig(
        {}, study.parameters('plant', RigParameters), hysteresis.parameters, dynamics.parameters)
    scan = study.parameters('trajectory', TrajectoryParameters)
    cells = table_cells()
    points = predict_operating_points(
        known, scan.replaced(**model), law, cells, uncertainty=bound)
    return PaperResults(
        uncompensated=uncompensated, compensated=compensated,
        compensated_identified=identified_loop,
        compensated_creeping=study.compensated_loop('creeping', {}, CREEP),
        hysteresis=hysteresis, bare_responses=study.bare_responses(),
        compensated_responses=study.responses('published', {}),
        wide_response=study.wide_response(), identified_responses=responses,
        dynamics_published=dynamics_published, dynamics=dynamics,
        uncertainty=bound, closed_loop=study.closed_loop(),
        loop_published=loop_shape(
            LinearDynamics(), law.proportional_gain, law.integral_gain_per_s,
            bound=paper.uncertainty_magnitude),
        loop_identified=loop_shape(
            LinearDynamics(dynamics_published.parameters), law.proportional_gain,
            law.integral_gain_per_s, sample_period_s=1e-5,
            measurement_delay_samples=law.measurement_delay_samples,
            bound=paper.uncertainty_magnitude),
        tuning=tuning, crossings=study.crossings(known, bound), cells=cells,
        table_4_published=study.table_4('published', cells),
        table_4_identified=study.table_4('identified', cells, inverse, model),
        table_4_automatic=study.table_4('automatic', cells, inverse, model, points),
        points=points, trials=study.trials(points, inverse, model),
        warming=study.warming(cells), scans=study.scans())


class PaperExperiments:
    """The runs of the study, group by group."""

    def __init__(self, base: Mapping[str, Mapping[str, Any]], execute: Execute) -> None:
        self._base = base
        self._execute = execute

    def parameters(self, node: str, parameter_set: type[Any]) -> Any:
        """Return a parameter set of a node as published."""
        return parameter_set.among(self._base[node])

    def static_loops(self) -> tuple[StaticLoop, StaticLoop]:
        """Return the loops of Fig. 5, without and with the published inverse model."""
        (run,) = self._execute([self._plan('static_uncompensated', {
            'output': 'voltage', 'amplitude_v': 3.0, 'frequency_hz': 1.0, 'periods': 3.0,
            'waveform': 'triangle', 'harmonics': 0}, _STATIC)])
        return _last_loop(run.voltage_v, run), self.compensated_loop('published', {})

    def compensated_loop(
        self, name: str, inverse: Mapping[str, Any], plant: Mapping[str, Any] | None = None,
    ) -> StaticLoop:
        """Return the slow loop of commanded and measured displacement."""
        (run,) = self._execute([self._plan(f'static_compensated_{name}', {
            'scheme': 'open_loop', 'amplitude_um': 3.0, 'frequency_hz': 1.0, 'periods': 3.0,
            'waveform': 'triangle', 'harmonics': 0, 'compensator': inverse,
            'plant': plant or {}}, _STATIC)])
        return _last_loop(run.command_um, run)

    def hysteresis(self) -> HysteresisFit:
        """Identify the hysteresis from a triangle of decreasing amplitude."""
        (run,) = self._execute([self._plan('identify_hysteresis', {
            'output': 'voltage', 'amplitude_v': 4.5, 'frequency_hz': 1.0, 'periods': 10.0,
            'waveform': 'decreasing_triangle', 'harmonics': 0}, _STATIC)])
        return fit_hysteresis(run.voltage_v, run.displacement_um)

    def bare_responses(self) -> tuple[tuple[FrequencyResponse, ...], ...]:
        """
        Return Fig. 6: the bare actuator by amplitude, with creep, in a slow and a fast sweep.

        A last one has a small amplitude alone, past the second resonance.
        """
        wide = self._execute([self._plan('bare_response_wide', {
            **_SWEEP, 'output': 'voltage', 'amplitude_v': _SMALL_AMPLITUDE_V, 'plant': CREEP,
            'trajectory': {'frequencies_hz': _HIGH_FREQUENCIES_HZ}})])
        by_amplitude = tuple(
            tuple(recorded_response(run, bare=True) for run in self._execute([
                self._plan(f'bare_response_{amplitude_v:g}v{suffix}', {
                    **_SWEEP, 'output': 'voltage', 'amplitude_v': amplitude_v, 'plant': CREEP,
                    'trajectory': {'frequencies_hz': frequencies_hz}}, everywhere)
                for suffix, frequencies_hz, everywhere in (
                    ('_slow', _SLOW_FREQUENCIES_HZ, _SLOW),
                    ('', _RESPONSE_FREQUENCIES_HZ, None))]))
            for amplitude_v in _AMPLITUDES_V)
        return (*by_amplitude, tuple(recorded_response(run, bare=True) for run in wide))

    def responses(
        self, name: str, inverse: Mapping[str, Any],
    ) -> tuple[FrequencyResponse, ...]:
        """Return the grid of Fig. 7 and 8: compensated, amplitude by offset."""
        kappa = paper.KAPPA_UM_PER_V[-1]
        runs = self._execute([
            self._plan(f'response_{name}_{amplitude_v:g}v_at_{offset_v:g}v', {
                **_SWEEP, 'scheme': 'open_loop', 'amplitude_um': kappa * amplitude_v,
                'offset_um': kappa * offset_v, 'compensator': inverse,
                'trajectory': {'frequencies_hz': _RESPONSE_FREQUENCIES_HZ}})
            for amplitude_v in _AMPLITUDES_V for offset_v in _OFFSETS_V])
        return tuple(map(recorded_response, runs))

    def dynamics(
        self, name: str, inverse: Mapping[str, Any], amplitudes_um: Sequence[float],
    ) -> DynamicsFit:
        """Identify G behind an inverse, at amplitudes that no limit touches."""
        return fit_dynamics(merge(self.wide_responses(name, inverse, amplitudes_um)))

    def wide_responses(
        self, name: str, inverse: Mapping[str, Any], amplitudes_um: Sequence[float],
    ) -> list[FrequencyResponse]:
        """Return the responses behind an inverse up to 8 kHz, one for each amplitude."""
        runs = self._execute([
            self._plan(f'identify_dynamics_{name}_{amplitude_um:g}um', {
                'scheme': 'open_loop', 'waveform': 'stepped_sine', 'harmonics': 0,
                'amplitude_um': amplitude_um, 'dwell_s': 0.05, 'compensator': inverse,
                'trajectory': {'frequencies_hz': _WIDE_FREQUENCIES_HZ}})
            for amplitude_um in amplitudes_um])
        return [recorded_response(run) for run in runs]

    def wide_response(self) -> FrequencyResponse:
        """Return what Fig. 7 shows past the second resonance: a small amplitude, compensated."""
        (run,) = self._execute([self._plan('response_published_wide', {
            **_SWEEP, 'scheme': 'open_loop', 'amplitude_um': _SMALL_AMPLITUDE_UM,
            'trajectory': {'frequencies_hz': _HIGH_FREQUENCIES_HZ}})])
        return recorded_response(run)

    def closed_loop(self) -> FrequencyResponse:
        """Return Fig. 9: reference to displacement under feedback alone."""
        (run,) = self._execute([self._plan('closed_loop_response', {
            'scheme': 'fb', 'waveform': 'stepped_sine', 'harmonics': 0, 'amplitude_um': 0.5,
            'dwell_s': 0.01, 'trajectory': {'frequencies_hz': _LOOP_FREQUENCIES_HZ}})])
        return recorded_response(run, closed_loop=True)

    def crossings(
        self, known: RigParameters, bound: UncertaintyBound,
    ) -> tuple[Crossing, ...]:
        """Return Fig. 10 and Table 3: sines under FF and FBFF, all as published."""
        law = self.parameters('controller', ControllerParameters)
        compensator = self.parameters('compensator', HysteresisParameters)
        sine = self.parameters('trajectory', TrajectoryParameters).replaced(
            waveform='sine', harmonics=1)
        crossings = []
        for amplitude_um in paper.TABLE_3:
            predicted_hz = equal_error_frequency_hz(
                known, sine.replaced(amplitude_um=amplitude_um), law, SINE_FREQUENCIES_HZ,
                compensator=compensator, uncertainty=bound)
            crossings.append(replace(
                self._crossing('sine', amplitude_um, {}),
                predicted_hz=known_frequency_hz(predicted_hz)))
        return tuple(crossings)

    def _crossing(self, name: str, amplitude_um: float, more: Mapping[str, Any]) -> Crossing:
        errors = self._scan_errors(
            f'{name}_{amplitude_um:g}um', 'sine',
            [(amplitude_um, frequency_hz) for frequency_hz in SINE_FREQUENCIES_HZ],
            {'harmonics': 1, **more})
        return Crossing(amplitude_um, np.array(SINE_FREQUENCIES_HZ), errors[:, 0], errors[:, 1])

    def warming(self, cells: Sequence[tuple[float, float]]) -> WarmingResults:
        """Return Tables 3 and 4, all as published, on the rig that warms."""
        plant = rig_that_warms()
        return WarmingResults(
            RigParameters.among(plant).self_heating_gain,
            tuple(
                self._crossing('warming_sine', amplitude_um, {'plant': plant})
                for amplitude_um in paper.TABLE_3),
            self._scan_errors('table_4_warming', 'triangle', cells, {'plant': plant}))

    def trials(
        self, points: Sequence[OperatingPoint], inverse: Mapping[str, Any],
        model: Mapping[str, Any],
    ) -> tuple[HarmonicsTrial, ...]:
        """Run feedforward alone with several m where amplitude and frequency are extreme."""
        predicted = {(point.amplitude_um, point.frequency_hz): point for point in points}
        trials = []
        for cell in _TRIED_CELLS:
            point = predicted[cell]
            harmonics = tuple(sorted({*_TRIED_HARMONICS, point.harmonics['ff']}))
            runs = self._execute([
                self._scan_plan(f'harmonics_{m}', 'triangle', 'ff', *cell, {
                    'compensator': inverse, 'trajectory': model, 'harmonics': m})
                for m in harmonics])
            trials.append(HarmonicsTrial(point, harmonics, tuple(map(run_error_percent, runs))))
        return tuple(trials)

    def table_4(
        self, name: str, cells: Sequence[tuple[float, float]],
        inverse: Mapping[str, Any] | None = None, model: Mapping[str, Any] | None = None,
        points: Sequence[OperatingPoint] | None = None,
    ) -> _Floats:
        """Return the errors of triangle tracking, shape (cells, 2), percent."""
        return self._scan_errors(
            f'table_4_{name}', 'triangle', cells,
            {'compensator': inverse or {}, 'trajectory': model or {}},
            None if points is None else [point.harmonics for point in points])

    def scans(self) -> dict[str, Run]:
        """Return Fig. 11: the 300 Hz triangle under all schemes."""
        schemes = ('fb', 'ff', 'fbff')
        runs = self._execute([
            self._plan(f'scan_{scheme}', {
                'scheme': scheme, 'waveform': 'triangle', 'amplitude_um': 2.5,
                'frequency_hz': 300.0, 'harmonics': paper.HARMONICS, 'periods': PERIODS})
            for scheme in schemes])
        return dict(zip(schemes, runs, strict=True))

    def _scan_errors(
        self, name: str, waveform: str, cells: Sequence[tuple[float, float]],
        more: Mapping[str, Any], harmonics: Sequence[Mapping[str, int]] | None = None,
    ) -> _Floats:
        planned = [
            self._scan_plan(name, waveform, scheme, *cell, {
                **more, **({} if harmonics is None else {'harmonics': harmonics[row][scheme]})})
            for row, cell in enumerate(cells) for scheme in SCHEMES]
        errors = [run_error_percent(run) for run in self._execute(planned)]
        return np.array(errors).reshape(len(cells), len(SCHEMES))

    def _scan_plan(
        self, name: str, waveform: str, scheme: str, amplitude_um: float, frequency_hz: float,
        more: Mapping[str, Any],
    ) -> PlannedRun:
        return self._plan(f'{name}_{scheme}_{amplitude_um:g}um_{frequency_hz:g}hz', {
            'harmonics': paper.HARMONICS, **more, 'scheme': scheme, 'waveform': waveform,
            'amplitude_um': amplitude_um, 'frequency_hz': frequency_hz, 'periods': PERIODS})

    def _plan(
        self, name: str, entry: Mapping[str, Any], everywhere: Mapping[str, Any] | None = None,
    ) -> PlannedRun:
        base = {
            node: {**values, **(everywhere or {})} for node, values in self._base.items()}
        return plan_run(base, entry, where=f'study: {name}', number=0, name=name)


def rig_that_warms() -> Mapping[str, Any]:
    """
    Return the parameters of the packaged rig in which losses warm the stage.

    Raises
    ------
    PlanError
        If they are not installed.

    """
    return read_parameter_file(packaged_configuration() / 'rig_that_warms.yaml', ('plant',))[
        'plant']


def run_error_percent(run: Run) -> float:
    """Return the NRMSE of the last four periods of a run, as the paper measures it."""
    frequency_hz = recorded_parameters(run, 'trajectory', TrajectoryParameters).frequency_hz
    window = tail(run.samples, frequency_hz, run.sample_period_s, SCORE_PERIODS)
    return _PERCENT * nrmse(run.reference_um[window], run.displacement_um[window])


def _last_loop(input_: _Floats, run: Run) -> StaticLoop:
    frequency_hz = recorded_parameters(run, 'trajectory', TrajectoryParameters).frequency_hz
    period = round(1.0 / (frequency_hz * run.sample_period_s))
    # Three periods: the last whole loop begins and ends at a peak.
    window = slice(run.samples - 2 * period, run.samples)
    loop = slice(run.samples - period, run.samples)
    return StaticLoop(
        input_[loop], run.displacement_um[loop],
        nonlinearity(input_[window], run.displacement_um[window]))
