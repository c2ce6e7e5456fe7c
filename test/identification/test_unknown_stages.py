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
Stages that share no code with the package, identified by its commands and scanned in truth.

Each stage goes through what a lab does: record, identify, tune; then the true stage is scanned with
what was identified. What the commands promised is compared with what comes.
"""

import math
import re

import numpy as np
import pytest
import yaml
from foreign_stages import STAGES, ForeignStage
from identification_flow import Flow, compensated_nonlinearity_percent, nrmse_percent, scan

import piezo_ros.cli.shared.scheme_advice as operating_points
from piezo_ros.model import LinearDynamics

pytestmark = pytest.mark.slow

SYMMETRIC_PLAYS = (
    'MRC of 5, one mode', 'MRC of 20, amplifier before, mode and sensor behind',
    'large and slow, 10 nm steps')
LONGEST_SCAN = 40_000  # samples
results = {}


class Study:
    """One stage, identified, tuned and scanned."""

    def __init__(self, name, directory, monkeypatch):
        self.name, self.description = name, STAGES[name]
        self.flow = Flow(self.description, directory)
        predicted = []
        original = operating_points.predicted_points
        monkeypatch.setattr(
            operating_points, 'predicted_points',
            lambda *given, **named: predicted.append(original(*given, **named)) or predicted[-1])
        self.codes = [
            self.flow.identify_hysteresis('--accept-poor'),
            self.flow.identify_dynamics('--accept-poor'), self.flow.identify_uncertainty(),
            self.flow.tune('--accept-poor')]
        self.points = predicted[-1] if predicted else ()

    def verdict(self, step):
        """Return what a command said of its model."""
        return next(
            line.removeprefix('verdict: ') for line in self.flow.printed[step].splitlines()
            if line.startswith('verdict: '))

    @property
    def trusted_to_hz(self):
        """Return up to where the dynamics are said to hold; 0 where they are not to be trusted."""
        verdict = self.verdict('dynamics')
        if verdict.startswith('do not trust'):
            return 0.0
        limit = re.match(r'usable up to ([\d.e+]+) Hz', verdict)
        facts = yaml.safe_load(self.flow.file('trajectory.yaml').read_text())[
            '/**/identified_dynamics']['ros__parameters']
        return float(limit[1]) if limit else facts['usable_to_hz']

    @property
    def is_limited_by_its_class(self):
        """Whether a verdict names the model class, or what it leaves in the points."""
        return any(
            words in self.verdict('hysteresis') + self.verdict('dynamics') for words in (
                'model class is the limit', 'points may be off', 'speeds of the record'))

    def dynamics_errors(self):
        """Return magnitude and phase errors of G up to the trusted frequency."""
        frequency_hz = np.array(self.flow.stepped(0.1).frequencies_hz)
        frequency_hz = frequency_hz[frequency_hz <= self.trusted_to_hz]
        ratio = LinearDynamics(self.flow.trajectory()).response(frequency_hz) / ForeignStage(
            self.description).response(frequency_hz)
        ratio = ratio / abs(ratio[0])  # the gain belongs to the hysteresis
        return np.max(np.abs(np.abs(ratio) - 1.0)), np.max(np.abs(np.angle(ratio)))

    def true_sensitivity(self):
        """Return max|S| of the tuned loop about the true linear stage."""
        period_s, law = self.flow.period_s, self.flow.controller
        frequency_hz = np.geomspace(1e-4, 0.4999, 20_000) / period_s
        turn = 2j * math.pi * frequency_hz * period_s
        held = -np.expm1(-turn) / turn
        controller = law.proportional_gain + law.integral_gain_per_s * period_s / (
            -np.expm1(-turn))
        loop = controller * np.exp(-turn * law.measurement_delay_samples) * held * ForeignStage(
            self.description).response(frequency_hz)
        return float(np.max(np.abs(1.0 / (1.0 + loop))))

    def promised_sensitivity(self):
        """Return max|S| as tune tells it."""
        line = next(
            line for line in self.flow.printed['tune'].splitlines()
            if line.startswith('max |S| with the tuned gains'))
        return max(float(value) for value in re.findall(r'(?:model|points|band) ([\d.]+)', line))

    def scans(self):
        """Yield measured and predicted error in percent of every scheme at some points."""
        amplitudes = sorted({point.amplitude_um for point in self.points})[1::2]
        frequencies = sorted({point.frequency_hz for point in self.points})[::3]
        for point in self.points:
            if point.amplitude_um not in amplitudes or point.frequency_hz not in frequencies:
                continue
            cell = {}
            for scheme, prediction in point.predictions.items():
                if scheme == 'planned':  # is no scheme of the controller
                    continue
                trajectory = self.flow.trajectory(
                    waveform='triangle', amplitude_um=point.amplitude_um,
                    frequency_hz=point.frequency_hz, harmonics=prediction.harmonics, periods=15.0)
                if trajectory.samples > LONGEST_SCAN:
                    continue
                reference_um, displacement_um = scan(
                    self.description, self.flow.compensator,
                    self.flow.controller.replaced(scheme=scheme), trajectory)
                samples = int(4.0 / (point.frequency_hz * self.flow.period_s))
                cell[scheme] = (
                    nrmse_percent(reference_um, displacement_um, samples),
                    prediction.nrmse_percent)
            if cell:
                yield cell


@pytest.mark.parametrize('name', STAGES)
def test_what_the_commands_promise_of_a_stage_comes(name, tmp_path, monkeypatch):
    study = Study(name, tmp_path, monkeypatch)
    assert study.codes == [0, 0, 0, 0], study.flow.printed
    results[name] = list(study.scans())
    assert results[name]
    magnitude, phase = study.dynamics_errors()
    limited = study.is_limited_by_its_class
    assert limited or (magnitude <= 0.03 and phase <= math.radians(2.0)), (magnitude, phase)
    assert study.true_sensitivity() <= 1.05 * study.promised_sensitivity()
    reach_um = 0.75 * 0.5 * study.description.travel_um
    bar = 0.15 if name in SYMMETRIC_PLAYS else 0.5
    for share in (0.1, 0.3, 0.6, 1.0):
        left = compensated_nonlinearity_percent(
            study.description, study.flow.compensator, share * reach_um)
        assert left <= bar or limited, (share, left)


def test_predicted_errors_and_schemes_are_right_in_nine_of_ten_cells():
    assert len(results) == len(STAGES), 'needs the results of the test before, on all stages'
    ratios, right = [], []
    for cells in results.values():
        for cell in cells:
            ratios += [measured / predicted for measured, predicted in cell.values()]
            chosen = min(cell, key=lambda scheme: cell[scheme][1])
            best = min(measured for measured, _ in cell.values())
            # Of two that are as good either is right.
            right.append(cell[chosen][0] <= 1.1 * best)
    assert np.mean([0.6 <= ratio <= 1.7 for ratio in ratios]) >= 0.9
    assert np.mean(right) >= 0.9
