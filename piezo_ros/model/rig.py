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
The simulated rig in physical order, and the paper's lumped order as an option.

One sample, with the hysteresis H of (1) to (4) and G = Ga Gp Gs of (6) in Liu 2015::

    d[k]   = d[k-1] + clip(DA(u[k]) - d[k-1], -slew Ts, slew Ts)    rails, current limit
    x      = creep(H(Ga d))                                         order: physical
    y      = drift(Gs Gp x)
    y[k+1] = AD(y + noise[k+1])                                     what the sensor reads

    x = creep(H(d)),   y = drift(G x)                               order: lumped

In physical order the amplifier Ga has a zero-order hold and the mechanics Gs Gp a first-order hold,
because their input is smooth. In lumped order all of G is behind a zero-order hold. All values are
deviations from the operating point.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from piezo_ros.model.converter import ConverterConstants, convert_step, converter_constants
from piezo_ros.model.creep import (
    CreepConstants,
    CreepParameters,
    creep_constants,
    creep_step,
    drift_step,
)
from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.hysteresis import (
    HysteresisConstants,
    HysteresisParameters,
    hysteresis_constants,
    hysteresis_state,
    hysteresis_step,
)
from piezo_ros.model.parameters import ParameterError, parameter
from piezo_ros.model.state_space import (
    LinearConstants,
    discretise_first_order_hold,
    discretise_zero_order_hold,
    gain,
    linear_constants,
    output_then_update,
    update_then_output,
)
from piezo_ros.model.step import Vector, step

__all__ = [
    'RigConstants',
    'RigParameters',
    'RigState',
    'initial_state',
    'measure_step',
    'rig_constants',
    'rig_step',
    'sample_step',
]


@dataclass(frozen=True, kw_only=True)
class RigParameters(HysteresisParameters, DynamicsParameters, CreepParameters):
    """Amplifier, stage and converters; the mismatches are unknown to the published models."""

    order: str = parameter(
        'physical', '', 'physical (amplifier before the hysteresis) or lumped (hysteresis, then G)',
        choices=('physical', 'lumped'))
    gain_mismatch: float = parameter(
        0.0, '', 'relative deviation of the dc gain', minimum=-0.9, maximum=10.0)
    natural_frequency_1_mismatch: float = parameter(
        0.0, '', 'relative deviation of omega_1', minimum=-0.9, maximum=10.0)
    damping_ratio_1_mismatch: float = parameter(
        0.0, '', 'relative deviation of zeta_1', minimum=-0.9, maximum=10.0)
    natural_frequency_2_mismatch: float = parameter(
        0.0, '', 'relative deviation of omega_2', minimum=-0.9, maximum=10.0)
    damping_ratio_2_mismatch: float = parameter(
        0.0, '', 'relative deviation of zeta_2', minimum=-0.9, maximum=10.0)
    time_constant_mismatch: float = parameter(
        0.0, '', 'relative deviation of tau', minimum=-0.9, maximum=10.0)
    slew_limit_v_per_s: float = parameter(
        0.0, 'V/s',
        'current limit of the amplifier over the load capacitance, at its input; 0: none',
        minimum=0.0, maximum=1e9)
    operating_point_v: float = parameter(
        5.0, 'V', 'amplifier input at zero deviation', minimum=-1e3, maximum=1e3)
    operating_point_um: float = parameter(
        6.0, 'um', 'displacement at zero deviation', minimum=-1e4, maximum=1e4)
    travel_um: float = parameter(
        12.0, 'um', 'travel of the stage, from 0', minimum=1e-3, maximum=1e5)
    voltage_minimum_v: float = parameter(
        -2.0, 'V', 'lowest amplifier input', minimum=-1e3, maximum=1e3)
    voltage_maximum_v: float = parameter(
        10.0, 'V', 'highest amplifier input that the D/A converter can give',
        minimum=-1e3, maximum=1e3)
    dac_bits: int = parameter(16, 'bit', 'D/A resolution; 0: ideal', minimum=0, maximum=32)
    dac_span_v: float = parameter(20.0, 'V', 'D/A range', minimum=1e-3, maximum=1e4)
    adc_bits: int = parameter(18, 'bit', 'A/D resolution; 0: ideal', minimum=0, maximum=32)
    adc_span_v: float = parameter(
        20.0, 'V', 'A/D range, centred on zero', minimum=1e-3, maximum=1e4)
    sensor_scale_um_per_v: float = parameter(
        1.2, 'um/V', 'scale of the sensor', minimum=1e-6, maximum=1e6)
    noise_rms_um: float = parameter(
        1e-3, 'um', 'white measurement noise', minimum=0.0, maximum=1e3)
    seed: int = parameter(1, '', 'seed of the measurement noise', minimum=0, maximum=2**53)

    def check_together(self) -> None:
        """Refuse ranges without the operating point and mismatches beyond the dynamics."""
        super().check_together()
        for value, name, low, high in (
            (self.operating_point_v, 'operating_point_v',
             self.voltage_minimum_v, self.voltage_maximum_v),
            (self.operating_point_um, 'operating_point_um', 0.0, self.travel_um),
        ):
            if not low <= value <= high:
                raise ParameterError(f'{name} is {value}, allowed is {low} … {high}')
        try:
            _ = self.true_dynamics
        except ParameterError as error:
            raise ParameterError(f'with its mismatches the rig is out of range: {error}') from None

    @property
    def true_dynamics(self) -> DynamicsParameters:
        """The linear dynamics with every mismatch applied; the dc gain only by its own."""
        true = DynamicsParameters(
            gain_k_rad3_per_s3=1.0,
            zero_b1_rad_per_s=self.zero_b1_rad_per_s,
            zero_b2_rad2_per_s2=self.zero_b2_rad2_per_s2,
            time_constant_s=self.time_constant_s * (1.0 + self.time_constant_mismatch),
            damping_ratio_1=self.damping_ratio_1 * (1.0 + self.damping_ratio_1_mismatch),
            natural_frequency_1_rad_per_s=self.natural_frequency_1_rad_per_s
            * (1.0 + self.natural_frequency_1_mismatch),
            damping_ratio_2=self.damping_ratio_2 * (1.0 + self.damping_ratio_2_mismatch),
            natural_frequency_2_rad_per_s=self.natural_frequency_2_rad_per_s
            * (1.0 + self.natural_frequency_2_mismatch))
        wanted = self.dc_gain * (1.0 + self.gain_mismatch)
        return true.replaced(gain_k_rad3_per_s3=wanted / true.dc_gain)

    @property
    def reach_um(self) -> float:
        """Largest amplitude around the operating point that stays within the travel."""
        return min(self.operating_point_um, self.travel_um - self.operating_point_um)


class RigConstants(NamedTuple):
    """What the steps need of the parameters; lists in a node, arrays in a kernel."""

    dac: ConverterConstants
    slew_step_v: float  # largest change per sample
    amplifier: LinearConstants
    hysteresis: HysteresisConstants
    mechanics: LinearConstants
    lumped: bool
    noise_rms_um: float
    adc: ConverterConstants
    creep: CreepConstants | None


class RigState(NamedTuple):
    """Everything the rig remembers; lists in a node, arrays in a kernel."""

    # (4,) voltage behind the slew limit; samples so far beyond a rail; slewing; voltage asked for
    drive_v: Vector
    amplifier: Vector  # (n,)
    hysteresis: Vector  # (n + 7,) plays, and the line that is valid
    mechanics: Vector  # (n,)
    displacement_um: Vector  # (1,) true displacement
    relaxed_um: Vector  # (r,) of the creep
    drift_um: Vector  # (1,)
    scratch: Vector  # (5,)


@lru_cache(maxsize=64)
def rig_constants(parameters: RigParameters, sample_period_s: float) -> RigConstants:
    """
    Return the constants of the steps as lists, not to be changed: they are shared.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    sample_period_s : float
        Sample period, seconds.

    """
    p = parameters
    dynamics = LinearDynamics(p.true_dynamics)
    lumped = p.order == 'lumped'
    if lumped:
        amplifier = gain(1.0)
        mechanics = dynamics.discrete(sample_period_s)
    else:
        amplifier = discretise_zero_order_hold(dynamics.amplifier, sample_period_s)
        # What drives the mechanics is smooth: straight between samples, not a staircase.
        mechanics = discretise_first_order_hold(dynamics.mechanics_and_sensor, sample_period_s)
    adc_limit_um = p.adc_span_v / 2.0 * p.sensor_scale_um_per_v
    return RigConstants(
        dac=converter_constants(
            p.voltage_minimum_v, p.voltage_maximum_v, p.dac_span_v, p.dac_bits,
            p.operating_point_v),
        slew_step_v=p.slew_limit_v_per_s * sample_period_s or 1e300,
        amplifier=linear_constants(amplifier),
        hysteresis=hysteresis_constants(parameters),
        mechanics=linear_constants(mechanics),
        lumped=lumped,
        noise_rms_um=p.noise_rms_um,
        adc=converter_constants(
            -adc_limit_um, adc_limit_um, 2.0 * adc_limit_um, p.adc_bits, p.operating_point_um),
        creep=creep_constants(p, sample_period_s))


def initial_state(constants: RigConstants, vector: Callable[[list[float]], Any] = list) -> RigState:
    """
    Return the state of the rig at rest at its operating point, never driven.

    Parameters
    ----------
    constants : RigConstants
        The rig.
    vector : callable, optional
        Makes the vectors: ``list`` for a node, ``numpy.array`` for a kernel.

    """
    return RigState(
        drive_v=vector([0.0, 0.0, 0.0, 0.0]),
        amplifier=vector([0.0] * len(constants.amplifier.b)),
        hysteresis=vector(hysteresis_state([0.0] * len(constants.hysteresis.width_um))),
        mechanics=vector([0.0] * len(constants.mechanics.b)),
        displacement_um=vector([0.0]),
        relaxed_um=vector([0.0] * (len(constants.creep.rate) if constants.creep else 0)),
        drift_um=vector([0.0]),
        scratch=vector([0.0] * 5))


@step
def measure_step(constants: RigConstants, displacement_um: float, unit_noise_value: float) -> float:
    """Return the reading of a displacement: noise added, then the A/D converter."""
    return convert_step(
        constants.adc, displacement_um + constants.noise_rms_um * unit_noise_value)


@step
def rig_step(state: RigState, constants: RigConstants, voltage_v: float) -> float:
    """Hold a voltage for one sample period and return the true displacement at its end."""
    drive_v = convert_step(constants.dac, voltage_v)
    value_v = voltage_v + constants.dac.operating_point
    if value_v < constants.dac.minimum or value_v > constants.dac.maximum:
        state.drive_v[1] += 1.0
    change_v = drive_v - state.drive_v[0]
    if change_v > constants.slew_step_v:
        drive_v = state.drive_v[0] + constants.slew_step_v
        state.drive_v[2] += 1.0
    elif change_v < -constants.slew_step_v:
        drive_v = state.drive_v[0] - constants.slew_step_v
        state.drive_v[2] += 1.0
    state.drive_v[0] = drive_v
    state.drive_v[3] = voltage_v
    if constants.lumped:
        free_um = hysteresis_step(state.hysteresis, constants.hysteresis, drive_v)
        free_um = creep_step(state.relaxed_um, constants.creep, free_um)
        true_um = update_then_output(state.mechanics, state.scratch, constants.mechanics, free_um)
    else:
        amplified_v = update_then_output(
            state.amplifier, state.scratch, constants.amplifier, drive_v)
        free_um = hysteresis_step(state.hysteresis, constants.hysteresis, amplified_v)
        free_um = creep_step(state.relaxed_um, constants.creep, free_um)
        true_um = output_then_update(state.mechanics, state.scratch, constants.mechanics, free_um)
    true_um = drift_step(state.drift_um, constants.creep, true_um)
    state.displacement_um[0] = true_um
    return true_um


@step
def sample_step(
    state: RigState, constants: RigConstants, voltage_v: float, unit_noise: float,
) -> float:
    """Hold a voltage for one sample period and return the reading at its end, micrometres."""
    return measure_step(constants, rig_step(state, constants, voltage_v), unit_noise)
