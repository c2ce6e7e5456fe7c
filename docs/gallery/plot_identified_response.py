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
A frequency response, and the model of it
=========================================

A stepped sine drives the stage, behind the inverse of its hysteresis. Each frequency gives a point
with its standard error; a model is fitted to the points and says how certain it is.
"""

# %%
# The stage is simulated, with 2 nm of noise. All of its hysteresis is in front of the dynamics
# (``lumped``), so that the inverse leaves a linear system; where some poles are before the
# hysteresis no linear model explains every point, and the fit says so.
import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.control.tables.excitation import stepped_sine
from piezo_ros.identification import fit_dynamics, frequency_response, run_excitation_offline
from piezo_ros.model import MaxwellResistiveCapacitor, RigParameters

stage = RigParameters(order='lumped', natural_frequency_2_mismatch=0.1, noise_rms_um=0.002)
excitation = stepped_sine(
    np.geomspace(50.0, 1.5e4, 40), 0.1, 1e-5, dwell_s=0.05, minimum_periods=4)
voltage_v, displacement_um = run_excitation_offline(
    stage, MaxwellResistiveCapacitor(), excitation.command, excitation.sample_period_s)
points = frequency_response(
    excitation.command, displacement_um, excitation.sample_period_s, excitation=excitation)

# %%
# Structure and orders are chosen by the points, and points that are left out in turn judge the fit.
model = fit_dynamics(points, structure='auto')
print(f'{points.frequency_hz.size} points; structure {model.structure}, orders {model.orders}')
for name, value in model.values.items():
    print(f'{name:32}{value:12.5g} ± {model.standard_errors[name]:.2g}')

# %%
# Magnitude and phase with the points, and below them what the model leaves of each point beside the
# radius within which the true response lies in 95 % of cases.
frequency_hz = np.geomspace(50.0, 1.5e4, 600)
fitted = model.sampled_response(frequency_hz)
left = np.abs(points.response - model.sampled_response(points.frequency_hz))
fig, (magnitude, phase, rest) = plt.subplots(
    3, 1, sharex=True, figsize=(8.0, 7.5), layout='constrained')
magnitude.semilogx(frequency_hz, 20.0 * np.log10(np.abs(fitted)), label='model')
magnitude.semilogx(
    points.frequency_hz, 20.0 * np.log10(np.abs(points.response)), 'o', markersize=4,
    label='points')
magnitude.set_ylabel('magnitude [dB]')
magnitude.legend()
phase.semilogx(frequency_hz, np.unwrap(np.angle(fitted)) * 180.0 / np.pi)
phase.semilogx(
    points.frequency_hz, np.unwrap(np.angle(points.response)) * 180.0 / np.pi, 'o', markersize=4)
phase.set_ylabel('phase [°]')
rest.loglog(points.frequency_hz, left, 'o', markersize=4, label='|point − model|')
rest.loglog(
    points.frequency_hz, points.confidence_radius, '--', label='95 % radius of the point')
rest.loglog(
    frequency_hz, model.response_confidence_radius(frequency_hz), '-.',
    label='95 % radius of the model')
rest.set(xlabel='frequency [Hz]', ylabel='distance [µm/µm]')
rest.legend()
plt.show()
