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

r"""
Tuning a PI controller
======================

Gains for the published dynamics (6), within a limit on the sensitivity \|S\|, and what they mean:
open loop with margins, Nyquist curve, sensitivities, step response.
"""

# %%
# `tune_pi` minimises the ITAE of a step within \|S\| <= 1.5. Its start is the crossover method.
import control
import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.identification import tune_pi
from piezo_ros.model import LinearDynamics
from piezo_ros.paper import uncertainty_magnitude

tuning = tune_pi(
    LinearDynamics(), bound=uncertainty_magnitude, max_sensitivity=1.5, sample_period_s=1e-5)
shape = tuning.after
print(f'kP {tuning.proportional_gain:.3f}, kI {tuning.integral_gain_per_s:.0f} 1/s')
print(f'gain margin {shape.gain_margin_db:.1f} dB, phase margin {shape.phase_margin_deg:.1f} deg')
print(f'feedback lessens the error below {shape.feedback_acceptable_frequency_hz:.0f} Hz')
print(f'reached: {", ".join(tuning.active_limits)}')

# %%
# The open loop, the delay of the measurement included, as a frequency response of python-control,
# which draws the Bode plot with its margins.
frequency_hz = np.geomspace(10.0, 4e4, 800)
loop = control.frd(
    shape.loop.loop(frequency_hz), 2.0 * np.pi * frequency_hz, smooth=False, name='L')
fig, axes = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.5), layout='constrained')
control.bode_plot(
    loop, ax=axes, Hz=True, dB=True, display_margins=True)

# %%
# The curve stays outside the circle about -1 of radius 1 over the largest \|S\|. Feedback lessens
# the error at frequencies where the curve is more than 1 away from -1.
response = shape.loop.loop(frequency_hz)
angle = np.linspace(0.0, 2.0 * np.pi, 200)
fig, nyquist = plt.subplots(figsize=(5.5, 5.0), layout='constrained')
nyquist.plot(response.real, response.imag, label='L, f > 0')
for radius, style, label in (
        (1.0 / shape.max_sensitivity, '--', f'max |S| = {shape.max_sensitivity:.2f}'),
        (1.0, ':', '|S| = 1')):
    nyquist.plot(radius * np.cos(angle) - 1.0, radius * np.sin(angle), style, label=label)
nyquist.plot(-1.0, 0.0, 'k+', markersize=10)
nyquist.set(xlim=(-2.2, 1.0), ylim=(-2.2, 1.0), aspect='equal', xlabel='real', ylabel='imaginary')
nyquist.legend(loc='upper right')

# %%
# What is gained below that frequency is paid above it. \|W T\| stays below 1, so the loop is stable
# for every stage within the uncertainty bound (19).
fig, gains = plt.subplots(figsize=(8.0, 4.0), layout='constrained')
sensitivity = np.abs(shape.loop.sensitivity(frequency_hz))
complementary = np.abs(shape.loop.complementary(frequency_hz))
gains.loglog(frequency_hz, sensitivity, label='|S|')
gains.loglog(frequency_hz, complementary, '--', label='|T|')
gains.loglog(frequency_hz, uncertainty_magnitude(frequency_hz) * complementary, '-.', label='|W T|')
gains.axhline(1.0, color='0.5', linewidth=0.8)
gains.axvline(shape.feedback_acceptable_frequency_hz, color='0.5', linestyle=':')
gains.set(xlabel='frequency [Hz]', ylabel='magnitude', ylim=(1e-2, 4.0))
gains.legend()
plt.show()
