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

"""Small pages of analyses, of made-up numbers: a sweep, tuned gains, a replay, dynamics."""

import numpy as np

from piezo_ros import paper
from piezo_ros.identification.dynamics.dynamics_fit import fit_dynamics
from piezo_ros.identification.response.frequency_response import FrequencyResponse
from piezo_ros.identification.tuning.loop_evidence import LoopEvidence
from piezo_ros.identification.tuning.loop_shape import loop_shape
from piezo_ros.identification.tuning.pi_tuning import PiTuning
from piezo_ros.model import LinearDynamics
from piezo_ros.report.analysis.identification_page import write_dynamics_page
from piezo_ros.report.analysis.replay_page import write_replay_page
from piezo_ros.report.analysis.replayed_run import ReplayedRun
from piezo_ros.report.analysis.sweep_page import SweptRun, WorstDraw, write_sweep_page
from piezo_ros.report.analysis.tuning_page import TunedLoop, write_tuning_page

__all__ = [
    'dynamics_page', 'replay_page', 'sweep_page', 'swept_records', 'tuned_loop', 'tuning_page']


def swept_records(count, seed=1):
    """Return what a sweep keeps of so many draws of one run."""
    generator = np.random.default_rng(seed)
    gains = generator.uniform(-0.1, 0.1, count)
    return [
        {'number': k, 'draw': k, 'run': 0, 'name': f'{k:03d}_fb', 'plant.gain_mismatch': gain,
         'nrmse_percent': 1.0 + abs(gain), 'max_error_um': 0.1, 'error': ''}
        for k, gain in enumerate(gains.tolist())]


def sweep_page(directory, drawn, **options):
    """Write the page of a sweep; return report.html."""
    return write_sweep_page(
        directory, title='Sweep', runs=[SweptRun('fb <1>', drawn)] if drawn else [],
        parameters=['plant.gain_mismatch'], failed=[], software={'piezo_ros': '1'},
        worst=[WorstDraw(drawn[0], 'worst/000000.yaml', 'piezo simulate it')] if drawn else [],
        **options)


def tuned_loop(gain, **changes):
    """Return a loop with a proportional gain, as if it had been tuned."""
    model = LinearDynamics()
    shape = loop_shape(model, gain, 3000.0, sample_period_s=1e-5, measurement_delay_samples=1)
    tuning = PiTuning('itae_step', shape, shape, 1.0, 1.0, 2.0, 1.0, (), None, None)
    frequency_hz = np.array([100.0, 1000.0, 5000.0])
    evidence = LoopEvidence(
        frequency_hz, shape.loop.plant_response(frequency_hz), model_error=0.05)
    return TunedLoop(**{
        'tuning': tuning, 'published': shape, 'evidence': evidence,
        'bound': paper.uncertainty_magnitude, 'reference_um': np.sin(np.arange(500) / 50.0),
        'scan': 'a sine', 'points': (), 'remarks': ['far'], **changes})


def tuning_page(directory, gain, **changes):
    """Write the page of tuned gains; return report.html."""
    return write_tuning_page(
        directory, title='Gains', tuned=tuned_loop(gain, **changes), software={})


def replay_page(directory):
    """Write the page of a replay; return report.html."""
    time_s = np.arange(500) * 1e-5
    wave = np.sin(2e3 * time_s)
    run = ReplayedRun(time_s, wave, (wave, 0.9 * wave), (wave, wave), slice(250, 500))
    return write_replay_page(
        directory, title='Replay', run=run, remarks=['Replaced: scheme.'], software={})


def dynamics_page(directory):
    """Write the page of identified dynamics; return report.html."""
    model, period_s = LinearDynamics(), 1e-5
    frequency_hz = np.geomspace(50.0, 5000.0, 60)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (2, frequency_hz.size))
    every = np.ones(frequency_hz.size)
    response = FrequencyResponse(
        frequency_hz, model.sampled_response(frequency_hz, period_s) + noise[0] + 1j * noise[1],
        2e-6 * every, 0.999 * every, 0.0 * every, 0.1 * every, 0.0 * every, period_s)
    fit = fit_dynamics(response)
    return write_dynamics_page(
        directory, title='Dynamics', response=response, fit=fit, verdict=fit.validation.verdict,
        software={'numpy': '2'}, command='piezo identify dynamics')
