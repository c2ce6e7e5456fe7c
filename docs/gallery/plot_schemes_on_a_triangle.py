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
Feedback, feedforward, both
===========================

The scan that `make demo` runs over ROS topics, here offline: a triangle of 1 µm and 300 Hz, by
feedback alone (``fb``), feedforward alone (``ff``), and both (``fbff``).
"""

# %%
# The rig has what no model knows of it: its dynamics are off the printed ones, and its amplifier
# has a current limit. The numbers are those of ``config/rig.yaml``, fitted to Table 4 of the paper.
import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.paper import table_4
from piezo_ros.report.metrics import nrmse, tail

rig = RigParameters(
    order='physical', gain_mismatch=-0.0586, natural_frequency_1_mismatch=0.157,
    natural_frequency_2_mismatch=0.226, damping_ratio_1_mismatch=-0.0642,
    time_constant_mismatch=-0.0706, slew_limit_v_per_s=18200.0, noise_rms_um=0.001, seed=1)
scan = TrajectoryParameters(
    waveform='triangle', amplitude_um=1.0, frequency_hz=300.0, harmonics=9, periods=15.0)

# %%
# The last four periods are scored, as in the paper: the root mean square error as a share of the
# peak-to-peak reference (NRMSE).
window = tail(scan.samples, scan.frequency_hz, scan.sample_period_s, 4.0)
runs = {
    scheme: simulate(rig, HysteresisParameters(), ControllerParameters(scheme=scheme), scan)
    for scheme in ('fb', 'ff', 'fbff')}
for scheme, run in runs.items():
    percent = 100.0 * nrmse(run.reference_um[window], run.displacement_um[:-1][window])
    published = table_4(scheme, 1.0, 300.0)
    print(f'{scheme:5}{percent:7.2f} %   paper: {published or "not printed"}')

# %%
# Two periods at the end. Feedback alone lags behind, by half a micrometre, which is off the scale
# of the lower panel; feedforward knows the way in advance.
shown = slice(scan.samples - 667, scan.samples)
time_ms = 1e3 * scan.sample_period_s * np.arange(667)
fig, (scans, errors) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.5), layout='constrained')
scans.plot(time_ms, runs['ff'].reference_um[shown], color='0.4', linewidth=2.5, label='reference')
for (scheme, run), style in zip(runs.items(), ('-', '--', '-.'), strict=True):
    measured_um = run.displacement_um[:-1]
    scans.plot(time_ms, measured_um[shown], style, label=scheme)
    errors.plot(time_ms, (run.reference_um - measured_um)[shown], style, label=scheme)
scans.set_ylabel('displacement [µm]')
errors.set(xlabel='time [ms]', ylabel='error [µm]', ylim=(-0.15, 0.15))
fig.legend(*scans.get_legend_handles_labels(), loc='outside upper center', ncols=4)
plt.show()
