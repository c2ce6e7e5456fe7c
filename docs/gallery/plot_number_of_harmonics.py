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
How many harmonics should the feedforward have?
===============================================

The feedforward (13) inverts the model at the first m harmonics of the triangle. Too few round its
corners off, too many rely on the model where it is wrong. The paper finds m by trial; the error can
be predicted.
"""

# %%
# The feedforward inverts the printed dynamics, and the rig differs from them. The prediction is
# made with what is known of the rig: its dynamics as they were identified from recorded runs
# (``config/identified.yaml``), the hysteresis of Table 1, the limit of the amplifier. Where these
# differ from the rig, so do the curves; what a choice of m by the prediction loses against the best
# m is printed.
import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.identification import predict_tracking
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.report.metrics import nrmse, tail

rig = RigParameters(
    order='physical', gain_mismatch=-0.0586, natural_frequency_1_mismatch=0.157,
    natural_frequency_2_mismatch=0.226, damping_ratio_1_mismatch=-0.0642,
    time_constant_mismatch=-0.0706, slew_limit_v_per_s=18200.0, noise_rms_um=0.001, seed=1)
known = RigParameters(
    order='physical', slew_limit_v_per_s=18200.0, gain_k_rad3_per_s3=4.9222e12,
    zero_b1_rad_per_s=-3.4417e4, zero_b2_rad2_per_s2=1.27085e9, time_constant_s=1.50046e-4,
    damping_ratio_1=0.579853, natural_frequency_1_rad_per_s=1.71928e4, damping_ratio_2=0.105568,
    natural_frequency_2_rad_per_s=5.63304e4, pairs_before_hysteresis=1)
law = ControllerParameters(scheme='ff')
numbers = range(1, 24, 2)


def measured_percent(scan):
    """Return the NRMSE of the last four periods of a run, percent."""
    run = simulate(rig, HysteresisParameters(), law, scan)
    window = tail(scan.samples, scan.frequency_hz, scan.sample_period_s, 4.0)
    return 100.0 * nrmse(run.reference_um[window], run.displacement_um[:-1][window])


fig, axes = plt.subplots(figsize=(8.0, 4.2), layout='constrained')
for frequency_hz, style in ((300.0, '-'), (500.0, '--'), (800.0, '-.')):
    scans = [
        TrajectoryParameters(frequency_hz=frequency_hz, harmonics=m, periods=15.0)
        for m in numbers]
    predicted = [predict_tracking(known, scan, law).nrmse_percent for scan in scans]
    measured = [measured_percent(scan) for scan in scans]
    (line,) = axes.plot(numbers, predicted, style, label=f'{frequency_hz:g} Hz, predicted')
    axes.plot(numbers, measured, 'o', color=line.get_color(), label='simulated')
    chosen, best = int(np.argmin(predicted)), int(np.argmin(measured))
    print(f'{frequency_hz:g} Hz: predicted best m = {numbers[chosen]}, it leaves '
          f'{measured[chosen]:.2f} %; the best, m = {numbers[best]}, {measured[best]:.2f} %')
axes.set(xlabel='number of harmonics m', ylabel='NRMSE [%]', yscale='log', xticks=[*numbers])
axes.legend(ncols=3)
plt.show()
