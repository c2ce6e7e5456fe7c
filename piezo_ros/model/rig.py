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

One sample, with the hysteresis H of (1) to (4) in Liu 2015 and G = Gbehind Gbefore exp(-s T), of
(6) the amplifier Ga before H, mechanics and sensor Gs Gp behind it::

    d[k]   = d[k-1] + clip(DA(u[k]) - d[k-1], -slew Ts, slew Ts)    rails, current limit
    x      = creep(warm(H(Gbefore d)))                              order: physical
    y      = drift(Gbehind x)
    y[k+1] = AD(y + noise[k+1])                                     what the sensor reads

    x = creep(warm(H(d))),   y = drift(G x)                         order: lumped

In physical order Gbefore has a zero-order hold, with the delay. What it gives is smooth, so that
Gbehind has a first-order hold, at n times per sample where poles before H are fast: what drives the
mechanics is the output of the amplifier *between* the samples, through H::

    n = 1 for Ts max |pole| <= 0.25,   else max(3, ceil(4 Ts max |pole|))

Straight lines between them err by (w Ts/n)^2/12 at the frequency w. Poles that settle within a
sample, Ts |pole| > 25, need not be resolved: H, having no rate, then sees steps, and it makes no
difference on which side of it they stand. In lumped order all of G is behind a zero-order hold. All
values are deviations from the operating point.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final, NamedTuple

from piezo_ros.model.converter import ConverterConstants, convert_step, converter_constants
from piezo_ros.model.creep import (
    NO_CREEP,
    CreepConstants,
    DriftParameters,
    creep_constants,
    creep_step,
    drift_step,
)
from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.effects.delay import delay_step
from piezo_ros.model.effects.load import (
    NO_LOAD,
    STATE_SIZE,
    LoadConstants,
    LoadParameters,
    allowed_voltage,
    heat_step,
    load_constants,
    warm_step,
)
from piezo_ros.model.effects.operating_point import check_operating_point
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
    StateSpace,
    discretise_delayed_hold,
    discretise_first_order_hold,
    lags,
    linear_constants,
    output_then_update,
    series,
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

_RESOLVED_RAD: Final = 0.25  # that the fastest pole before H turns in a substep
_SETTLED: Final = 25.0  # of a pole within a sample: exp(-25) of a step is left at its end
_FEWEST_SUBSTEPS: Final = 3  # where there are any
_MOST_SUBSTEPS: Final = 400
_MOST_DELAY_SAMPLES: Final = 10**6


@dataclass(frozen=True, kw_only=True)
class RigParameters(HysteresisParameters, DynamicsParameters, DriftParameters, LoadParameters):
    """Amplifier, stage and converters; the mismatches are unknown to the published models."""

    order: str = parameter(
        'physical', '', 'physical (some poles of G before the hysteresis, others behind) or lumped '
        '(hysteresis, then all of G)',
        choices=('physical', 'lumped'))
    gain_mismatch: float = parameter(
        0.0, '', 'relative deviation of the dc gain', minimum=-0.9, maximum=10.0)
    natural_frequency_1_mismatch: float = parameter(
        0.0, '', 'relative deviation of omega_1, or of the first pole pair',
        minimum=-0.9, maximum=10.0)
    damping_ratio_1_mismatch: float = parameter(
        0.0, '', 'relative deviation of zeta_1, or of the first pole pair',
        minimum=-0.9, maximum=10.0)
    natural_frequency_2_mismatch: float = parameter(
        0.0, '', 'relative deviation of omega_2, or of the second pole pair',
        minimum=-0.9, maximum=10.0)
    damping_ratio_2_mismatch: float = parameter(
        0.0, '', 'relative deviation of zeta_2, or of the second pole pair',
        minimum=-0.9, maximum=10.0)
    time_constant_mismatch: float = parameter(
        0.0, '', 'relative deviation of tau, or of the time constant of the first real pole',
        minimum=-0.9, maximum=10.0)
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
        0.0, 'um/V', 'scale of the sensor; 0: its travel_um fills the upper half of the A/D range',
        minimum=0.0, maximum=1e6)
    noise_rms_um: float = parameter(
        1e-3, 'um', 'white measurement noise', minimum=0.0, maximum=1e3)
    seed: int = parameter(1, '', 'seed of the measurement noise', minimum=0, maximum=2**53)

    def check_together(self) -> None:
        """Refuse ranges without the operating point and mismatches beyond the dynamics."""
        super().check_together()
        check_operating_point(self)
        if self.operating_point_um > self.highest_reading_um:
            raise ParameterError(
                f'operating_point_um is {self.operating_point_um:g} um, allowed is 0 … '
                f'{self.highest_reading_um:g} um: more the A/D converter cannot read with '
                f'adc_span_v {self.adc_span_v:g} V and sensor_scale_um_per_v '
                f'{self.sensor_scale_um_per_v:g} um/V')
        try:
            _ = self.true_dynamics
        except ParameterError as error:
            raise ParameterError(f'with its mismatches the rig is out of range: {error}') from None

    @property
    def highest_reading_um(self) -> float:
        """The largest displacement that the A/D converter can tell, micrometres."""
        if self.sensor_scale_um_per_v:
            return self.adc_span_v / 2.0 * self.sensor_scale_um_per_v
        return self.travel_um

    @cached_property
    def true_dynamics(self) -> DynamicsParameters:
        """The linear dynamics with every mismatch applied; the dc gain only by its own."""
        if self.dynamics == 'sections':
            return self._true_sections()
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
            * (1.0 + self.natural_frequency_2_mismatch),
            delay_s=self.delay_s, rates_before_hysteresis=self.rates_before_hysteresis,
            pairs_before_hysteresis=self.pairs_before_hysteresis,
            hysteresis_place=self.hysteresis_place)
        wanted = self.dc_gain * (1.0 + self.gain_mismatch)
        return true.replaced(gain_k_rad3_per_s3=wanted / true.dc_gain)

    def _true_sections(self) -> DynamicsParameters:
        rates, frequencies, ratios = (
            list(getattr(self, f'pole_{name}'))
            for name in ('rates_rad_per_s', 'frequencies_rad_per_s', 'damping_ratios'))
        for name, values, index, power in (
            ('time_constant_mismatch', rates, 0, -1),
            ('natural_frequency_1_mismatch', frequencies, 0, 1),
            ('damping_ratio_1_mismatch', ratios, 0, 1),
            ('natural_frequency_2_mismatch', frequencies, 1, 1),
            ('damping_ratio_2_mismatch', ratios, 1, 1),
        ):
            mismatch = getattr(self, name)
            if not mismatch:
                continue
            if index >= len(values):
                kind = 'real pole' if values is rates else 'pole pair'
                raise ParameterError(
                    f'{name} is {mismatch}, but the sections have {len(values)} of a {kind}: it '
                    f'belongs to number {index + 1}, allowed is 0')
            values[index] *= (1.0 + mismatch) ** power
        own = {name: getattr(self, name) for name in DynamicsParameters.names()}
        return DynamicsParameters.from_mapping({
            **own, 'gain_um_per_um': self.gain_um_per_um * (1.0 + self.gain_mismatch),
            'pole_rates_rad_per_s': rates, 'pole_frequencies_rad_per_s': frequencies,
            'pole_damping_ratios': ratios})

    @property
    def reach_um(self) -> float:
        """Largest amplitude around the operating point that stays within the travel."""
        return min(self.operating_point_um, self.travel_um - self.operating_point_um)


class RigConstants(NamedTuple):
    """What the steps need of the parameters; lists in a node, arrays in a kernel."""

    dac: ConverterConstants
    slew_step_v: float  # largest change per sample
    before: LinearConstants  # of a substep
    hysteresis: HysteresisConstants
    behind: LinearConstants  # of a substep
    lumped: bool
    noise_rms_um: float
    adc: ConverterConstants
    substeps: int
    late_substeps: int  # of a sample, in which the voltage of the one before still acts
    delay_samples: int
    # Both None where there is neither creep, drift, average current limit nor self-heating.
    creep: CreepConstants | None
    load: LoadConstants | None


class RigState(NamedTuple):
    """Everything the rig remembers; lists in a node, arrays in a kernel."""

    # (5,) voltage behind the slew limit; samples so far beyond a rail; slewing; voltage asked for;
    # voltage that acted in the sample before
    drive_v: Vector
    before: Vector  # (n,)
    hysteresis: Vector  # (n + 7,) plays, and the line that is valid
    behind: Vector  # (n,)
    displacement_um: Vector  # (1,) true displacement
    load: Vector  # (3,) see `piezo_ros.model.effects.load`
    relaxed_um: Vector  # (r,) of the creep
    drift_um: Vector  # (1,)
    delayed_v: Vector  # (1 + d,) place of the oldest, and the newest d voltages in a ring
    scratch: Vector  # (n,) of the larger n


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

    Raises
    ------
    ValueError
        If the sample period is not finite and positive.
    ParameterError
        If the delay has too many samples.

    """
    p = parameters
    before, behind, delay_samples, (substeps, late_substeps) = _halves(p, sample_period_s)
    if delay_samples > _MOST_DELAY_SAMPLES:
        raise ParameterError(
            f'delay_s is {p.delay_s} s, allowed is 0 … '
            f'{_MOST_DELAY_SAMPLES * sample_period_s:g} s at a sample period of '
            f'{sample_period_s:g} s')
    adc_limit_um = p.highest_reading_um
    creep = creep_constants(p, sample_period_s, substeps)
    load = load_constants(p, sample_period_s)
    return RigConstants(
        dac=converter_constants(
            p.voltage_minimum_v, p.voltage_maximum_v, p.dac_span_v, p.dac_bits,
            p.operating_point_v),
        slew_step_v=p.slew_limit_v_per_s * sample_period_s or 1e300,
        before=linear_constants(before),
        hysteresis=hysteresis_constants(parameters),
        behind=linear_constants(behind),
        lumped=not len(before.a),
        noise_rms_um=p.noise_rms_um,
        adc=converter_constants(
            -adc_limit_um, adc_limit_um, 2.0 * adc_limit_um, p.adc_bits, p.operating_point_um),
        substeps=substeps,
        late_substeps=late_substeps,
        delay_samples=delay_samples,
        creep=NO_CREEP if load and not creep else creep,
        load=NO_LOAD if creep and not load else load)


def _halves(
    parameters: RigParameters, sample_period_s: float,
) -> tuple[StateSpace, StateSpace, int, tuple[int, int]]:
    """Return what is before and behind H in discrete time, whole delay, and substeps."""
    true = parameters.true_dynamics
    dynamics = LinearDynamics(true)
    before, behind, fastest = dynamics.before_hysteresis, dynamics.behind_hysteresis, 0.0
    if parameters.order == 'lumped':
        before, behind = lags((), ()), series(before, behind)
    else:
        # A settled overshoot of a fast, lightly damped pair is left out here.
        rates = true.rates_rad_per_s[:true.rates_before_hysteresis]
        pairs = true.pole_pairs[:true.pairs_before_hysteresis]
        settle = _SETTLED / sample_period_s if sample_period_s > 0.0 else math.inf
        slow_rates = [rate for rate in rates if rate <= settle]
        slow_pairs = [pair for pair in pairs if _root_rates(*pair)[0] <= settle]
        if len(slow_rates) + len(slow_pairs) < len(rates) + len(pairs):
            settled = lags(
                [rate for rate in rates if rate > settle],
                [pair for pair in pairs if _root_rates(*pair)[0] > settle])
            before, behind = lags(slow_rates, slow_pairs), series(settled, behind)
        fastest = max([*slow_rates, *(_root_rates(*pair)[1] for pair in slow_pairs)], default=0.0)
    if not len(before.a):
        return before, *discretise_delayed_hold(behind, sample_period_s, true.delay_s), (1, 0)
    wanted = fastest * sample_period_s / _RESOLVED_RAD
    substeps = 1
    if wanted > 1.0:
        substeps = max(math.ceil(min(wanted, _MOST_SUBSTEPS)), _FEWEST_SUBSTEPS)
    before, late_substeps = discretise_delayed_hold(
        before, sample_period_s / substeps, true.delay_s)
    # What drives the second half is smooth: straight between substeps, not a staircase.
    behind = discretise_first_order_hold(behind, sample_period_s / substeps)
    delay_samples, late_substeps = divmod(late_substeps, substeps)
    return before, behind, delay_samples, (substeps, late_substeps)


def _root_rates(frequency_rad_per_s: float, damping_ratio: float) -> tuple[float, float]:
    """Return how fast the slower root of a pole pair decays, and the size of the faster one."""
    w, z = frequency_rad_per_s, damping_ratio
    if z <= 1.0:
        return z * w, w
    fast = w * (z + math.sqrt(z * z - 1.0))
    return w * w / fast, fast


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
        drive_v=vector([0.0, 0.0, 0.0, 0.0, 0.0]),
        before=vector([0.0] * len(constants.before.b)),
        hysteresis=vector(hysteresis_state([0.0] * len(constants.hysteresis.width_um))),
        behind=vector([0.0] * len(constants.behind.b)),
        displacement_um=vector([0.0]),
        load=vector([0.0] * STATE_SIZE),
        relaxed_um=vector([0.0] * (len(constants.creep.rate) if constants.creep else 0)),
        drift_um=vector([0.0]),
        delayed_v=vector([0.0] * (1 + constants.delay_samples)),
        scratch=vector([0.0] * max(len(constants.before.b), len(constants.behind.b))))


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
    drive_v = allowed_voltage(state.load, constants.load, state.drive_v[0], drive_v)
    state.drive_v[0] = drive_v
    state.drive_v[3] = voltage_v
    drive_v = delay_step(state.delayed_v, constants.delay_samples, drive_v)
    true_um = 0.0
    if constants.lumped:
        free_um = hysteresis_step(state.hysteresis, constants.hysteresis, drive_v)
        free_um = warm_step(state.load, constants.load, free_um)
        free_um = creep_step(state.relaxed_um, constants.creep, free_um)
        true_um = update_then_output(state.behind, state.scratch, constants.behind, free_um)
    else:
        for substep in range(constants.substeps):
            held_v = state.drive_v[4] if substep < constants.late_substeps else drive_v
            amplified_v = update_then_output(
                state.before, state.scratch, constants.before, held_v)
            free_um = hysteresis_step(state.hysteresis, constants.hysteresis, amplified_v)
            free_um = warm_step(state.load, constants.load, free_um)
            free_um = creep_step(state.relaxed_um, constants.creep, free_um)
            true_um = output_then_update(state.behind, state.scratch, constants.behind, free_um)
        state.drive_v[4] = drive_v
    true_um = drift_step(state.drift_um, constants.creep, true_um)
    heat_step(state.load, constants.load, state.displacement_um[0], true_um)
    state.displacement_um[0] = true_um
    return true_um


@step
def sample_step(
    state: RigState, constants: RigConstants, voltage_v: float, unit_noise: float,
) -> float:
    """Hold a voltage for one sample period and return the reading at its end, micrometres."""
    return measure_step(constants, rig_step(state, constants, voltage_v), unit_noise)
