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
Commands for any motion that is known in advance, by the chain of inverses with preview.

The motion begins as many samples later as the chain looks ahead, and holds its last value.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.control.tables.motion_table import MotionTable
from piezo_ros.model import DynamicsParameters, HysteresisParameters, LinearDynamics, RigParameters
from piezo_ros.model.effects.load import average_slew
from piezo_ros.model.hysteresis_and_inverse import InverseHysteresis
from piezo_ros.planning.constrained_step import AmplifierLimits
from piezo_ros.planning.preview_chain import PreviewChain

__all__ = ['PlannedMotion', 'planned_motion']

_START_SHARE: Final = 1e-3  # of the largest value, from which a motion may begin


@dataclass(frozen=True)
class PlannedMotion:
    """
    A motion with its commands.

    Attributes
    ----------
    table : MotionTable
        What the trajectory node plays.
    latency : int
        Samples before the motion begins.
    predicted_rms_um, predicted_maximum_um : float
        Error of the known stage without noise.
    limit_use : float
        Largest use of any limit of the amplifier, 1 at the limit.

    """

    table: MotionTable
    latency: int
    predicted_rms_um: float
    predicted_maximum_um: float
    limit_use: float


def planned_motion(
    motion: MotionTable, dynamics: DynamicsParameters, hysteresis: HysteresisParameters,
    limits: AmplifierLimits, average_slew_time_s: float,
) -> PlannedMotion:
    """
    Return the commands that bring an identified stage along a motion.

    Parameters
    ----------
    motion : MotionTable
        The reference, from about 0 on; its own commands do not matter.
    dynamics : DynamicsParameters
        What was identified.
    hysteresis : HysteresisParameters
        What was identified, and the compensator inverts.
    limits : AmplifierLimits
        What the voltage must keep.
    average_slew_time_s : float
        Time over which the amplifier averages its current, seconds.

    Raises
    ------
    ValueError
        If the motion is repeated, does not begin at 0, or asks for more than the amplifier has.

    """
    if motion.repeat_from is not None:
        raise ValueError('repeat_from is set: a motion that is repeated is planned as a scan')
    wanted_um = motion.reference_um
    if abs(wanted_um[0]) > _START_SHARE * np.abs(wanted_um).max():
        raise ValueError(
            f'reference_um is {wanted_um[0]:g} um at sample 0: a run begins at rest, at 0')
    model = LinearDynamics(dynamics)
    chain = PreviewChain(
        model.before_hysteresis, hysteresis, model.behind_hysteresis, motion.sample_period_s)
    delay = round(model.delay_s / motion.sample_period_s)
    latency = chain.latency + delay
    reference_um = np.concatenate([np.zeros(latency), wanted_um])
    command_um = chain.answer(
        np.concatenate([wanted_um, np.full(latency, wanted_um[-1])]))
    voltage_v = InverseHysteresis(hysteresis).answer(0, command_um)
    limit_use = _limit_use(voltage_v, limits, average_slew_time_s, motion.sample_period_s)
    table = MotionTable(reference_um, command_um, motion.sample_period_s)
    error_um = _predicted_um(dynamics, hysteresis, table) - reference_um
    return PlannedMotion(
        table, latency, float(np.sqrt(np.mean(error_um**2))), float(np.abs(error_um).max()),
        limit_use)


def _limit_use(
    voltage_v: NDArray[np.float64], limits: AmplifierLimits, average_s: float,
    sample_period_s: float,
) -> float:
    """Return the largest use of any limit; refuse a voltage that the amplifier cannot give."""
    from_rest_v = np.concatenate([[0.0], voltage_v])
    slope_v_per_s = np.abs(np.diff(from_rest_v)) / sample_period_s
    average_v_per_s = average_slew(from_rest_v, average_s, sample_period_s, from_rest=True)
    use = 0.0
    for name, values, allowed, unit in (
            ('the slope of the voltage', slope_v_per_s, limits.slew_v_per_s, 'V/s'),
            (f'the slope of the voltage, averaged over {average_s:g} s,', average_v_per_s,
             limits.average_slew_v_per_s, 'V/s'),
            ('the voltage', voltage_v, limits.maximum_v, 'V'),
            ('the voltage, negated,', -voltage_v, -limits.minimum_v, 'V')):
        worst = int(np.argmax(values))
        if values[worst] > allowed:
            raise ValueError(
                f'{name} is {values[worst]:.4g} {unit} at {worst * sample_period_s:.6g} s, '
                f'allowed is {allowed:.4g} {unit}: a slower or smoother motion is needed')
        use = max(use, float(values[worst]) / allowed)
    return use


def _predicted_um(
    dynamics: DynamicsParameters, hysteresis: HysteresisParameters, table: MotionTable,
) -> NDArray[np.float64]:
    """Return the displacement of the known stage, with ideal converters and without noise."""
    rig = RigParameters.from_mapping({
        **dynamics.to_mapping(), **hysteresis.to_mapping(), 'dac_bits': 0, 'adc_bits': 0,
        'noise_rms_um': 0.0, 'sensor_scale_um_per_v': 1e4, 'travel_um': 1e5,
        'operating_point_um': 0.0, 'operating_point_v': 0.0,
        'voltage_minimum_v': -1e3, 'voltage_maximum_v': 1e3})
    assert table.command_um is not None
    run = run_loop(
        rig, hysteresis, ControllerParameters(
            scheme='ff', command_minimum_um=-1e4, command_maximum_um=1e4),
        table.sample_period_s, table.reference_um, table.command_um)
    return np.asarray(run.displacement_um[:-1])
