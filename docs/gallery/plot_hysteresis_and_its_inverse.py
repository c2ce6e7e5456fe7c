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
Hysteresis and its inverse
==========================

A piezo actuator has two displacements for one voltage, one on the way up and one on the way down.
The Maxwell resistive capacitor (MRC) model of (1) to (4) in Liu 2015 describes that, and its
inverse is explicit: no equation has to be solved.
"""

# %%
# A voltage that rises to 4 V, and loops of decreasing amplitude, as in Fig. 5 of the paper.
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np

from piezo_ros.model import MaxwellResistiveCapacitor

operator = MaxwellResistiveCapacitor()  # Table 1
turns_v = [0.0, 4.0, -4.0, 3.0, -3.0, 2.0, -2.0, 1.0, -1.0, 0.0]
voltage_v = np.concatenate([
    np.linspace(start, stop, 400) for start, stop in pairwise(turns_v)])
displacement_um, _ = operator.forward(voltage_v)

# %%
# The loop hides what matters: most of it is a straight line. The deviation from that line shows the
# hysteresis, as a share of the travel.
slope_um_per_v = np.polyfit(voltage_v, displacement_um, 1)[0]
deviation_um = displacement_um - slope_um_per_v * voltage_v

# %%
# Now the displacement itself is wanted, and the inverse model finds the voltage. What is left is
# rounding: the model inverts itself exactly. On a stage the model's own error is left.
wanted_um = 1.2 * voltage_v
compensating_v, _ = operator.inverse(wanted_um)
reached_um, _ = operator.forward(compensating_v)
left_um = np.abs(reached_um - wanted_um).max()
print(f'largest deviation without the inverse: {np.abs(deviation_um).max():.3f} um')
print(f'largest error with the inverse:        {left_um:.1e} um')

fig, (loop, deviation) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout='constrained')
loop.plot(voltage_v, displacement_um, label='without inverse')
loop.plot(wanted_um / 1.2, reached_um, '--', label='with inverse, wanted 1.2 µm/V')
loop.set(xlabel='voltage, or wanted displacement / 1.2 [V]', ylabel='displacement [µm]')
loop.legend()
deviation.plot(voltage_v, deviation_um)
deviation.axhline(0.0, color='0.5', linewidth=0.8)
deviation.set(xlabel='voltage [V]', ylabel='deviation from the straight line [µm]')
plt.show()
