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

"""An excitation played through the simulated rig offline, to make records for identification."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.model.hysteresis_and_inverse import MaxwellResistiveCapacitor
from piezo_ros.model.rig import RigParameters
from piezo_ros.model.simulated_rig import Rig

__all__ = ['run_excitation_offline']


def run_excitation_offline(
    plant: RigParameters,
    compensator: MaxwellResistiveCapacitor | None,
    command: ArrayLike,
    sample_period_s: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Play a command open loop through the compensator and the simulated rig.

    Parameters
    ----------
    plant : RigParameters
        The rig; its hysteresis starts virgin.
    compensator : MaxwellResistiveCapacitor or None
        Inverted to get the voltage; None for the bare actuator, where the command is the voltage.
    command : array_like, shape (N,)
        Commanded displacement, micrometres, or voltage, volts.
    sample_period_s : float
        Sample period, seconds.

    Returns
    -------
    voltage_v : ndarray, shape (N,)
        Amplifier input; ``voltage_v[k]`` is held from sample k to k + 1.
    displacement_um : ndarray, shape (N,)
        Readings; ``displacement_um[k]`` is taken at ``k * sample_period_s``, before
        ``voltage_v[k]`` has any effect.

    """
    values = np.asarray(command, dtype=np.float64)
    voltage_v = values if compensator is None else compensator.inverse(values)[0]
    rig = Rig(plant, sample_period_s)
    first_um = rig.measure()
    return voltage_v, np.concatenate([[first_um], rig.run(voltage_v)[:-1]])
