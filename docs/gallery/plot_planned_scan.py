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
A scan planned at the limit of the amplifier
============================================

At 800 Hz and 2.5 µm the published feedforward asks for more current than the amplifier has. A
voltage that is planned within the limit does what can be done.
"""

# %%
# For clarity the models are right here: hysteresis, dynamics and limit are those of the rig. The
# amplifier's current limit is a limit on the slope of the voltage, 18 200 V/s.
import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.identification import run_excitation_offline
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    MaxwellResistiveCapacitor,
    RigParameters,
)
from piezo_ros.planning.scan import ScanRequest, limits_of, planned_scan
from piezo_ros.report.metrics import nrmse

PERIOD_S = 1e-5
rig = RigParameters(order='physical', slew_limit_v_per_s=18200.0)
request = ScanRequest(
    waveform='triangle', amplitude_um=2.5, frequency_hz=800.0, sample_period_s=PERIOD_S,
    dynamics=DynamicsParameters(pairs_before_hysteresis=1), hysteresis=HysteresisParameters(),
    limits=limits_of(rig))
plan = planned_scan(request)
print(f'predicted NRMSE {plan.predicted_nrmse_percent:.2f} %')

# %%
# The plan is played on the rig until it has settled, and compared with the feedforward of nine
# harmonics. Both are scored over their last whole number of periods.
samples = plan.reference_um.size
count = 12 * samples
_, planned_um = run_excitation_offline(
    rig, MaxwellResistiveCapacitor(), plan.command_um(count, request.hysteresis, 2.0), PERIOD_S)
scan = TrajectoryParameters(
    waveform='triangle', amplitude_um=2.5, frequency_hz=800.0, harmonics=9,
    sample_period_s=PERIOD_S, periods=800.0 * PERIOD_S * count)
law = ControllerParameters(scheme='ff')
feedforward_um = simulate(rig, HysteresisParameters(), law, scan).displacement_um[:-1]
for name, measured_um in (('feedforward', feedforward_um), ('planned', planned_um)):
    print(f'{name:12}{100.0 * nrmse(plan.reference_um, measured_um[-samples:]):6.2f} %')

# %%
# Two periods at the end.
shown = slice(-250, None)
reference_um = np.resize(plan.reference_um, count)
time_ms = 1e3 * PERIOD_S * np.arange(250)
fig, (scans, errors) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.5), layout='constrained')
scans.plot(time_ms, reference_um[shown], color='0.4', linewidth=2.5, label='reference')
for name, measured_um, style in (
        ('feedforward, m = 9', feedforward_um, '--'), ('planned', planned_um, '-')):
    scans.plot(time_ms, measured_um[shown], style, label=name)
    errors.plot(time_ms, (reference_um - measured_um)[shown], style, label=name)
scans.set_ylabel('displacement [µm]')
errors.set(xlabel='time [ms]', ylabel='error [µm]')
fig.legend(*scans.get_legend_handles_labels(), loc='outside upper center', ncols=3)
plt.show()
