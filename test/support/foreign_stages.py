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
Piezo stages that share no code with the package, recorded as a data acquisition would.

Held voltage, poles before the hysteresis, hysteresis, poles and zeros behind it, delay, creep and
drift, noise and steps of the sensor. Between two samples the stage is computed at several instants.
Hysteresis operators come from the literature in forms that the package does not use: superposed
one-sided plays with a saturating output (Kuhnen), Bouc-Wen's differential equation, Preisach's
relays, plays that widen with speed.
"""

import math
from dataclasses import dataclass, field

import numba
import numpy as np
from scipy import signal

__all__ = ['STAGES', 'ForeignStage', 'StageDescription']


# -- hysteresis: each a kernel (state, parameters, voltage deviation, speed) -> free displacement --


@numba.njit(cache=False)
def _plays(state, parameters, value, speed):
    """Superpose plays; rows of parameters: gain, half width up, half width down, widening, -."""
    total = 0.0
    for i in range(parameters.shape[0] - 1):
        gain, up, down, widening, _ = parameters[i]
        grow = 1.0 + widening * abs(speed)
        low, high = value - up * grow, value + down * grow
        state[i] = min(max(state[i], low), high)
        total += gain * state[i]
    # The last row bends the sum: y = x + a x|x| + b x^3, for asymmetry and saturation.
    linear, odd_even, cubic, _, _ = parameters[-1]
    return linear * total + odd_even * total * total + cubic * total**3


@numba.njit(cache=False)
def _bouc_wen(state, parameters, value, speed):
    """Add a loop h with h' = alpha v' - beta |v'| h - gamma v' |h|; state: h, last value."""
    gain, alpha, beta, gamma, _ = parameters[0]
    step = value - state[1]
    state[1] = value
    state[0] += alpha * step - beta * abs(step) * state[0] - gamma * step * abs(state[0])
    return gain * value - state[0]


@numba.njit(cache=False)
def _preisach(state, parameters, value, speed):
    """Sum relays; rows of parameters: weight, switch-on, switch-off, initial, -; last row: gain."""
    total = 0.0
    for i in range(parameters.shape[0] - 1):
        weight, on, off, _, _ = parameters[i]
        if value >= on:
            state[i] = 1.0
        elif value <= off:
            state[i] = -1.0
        total += weight * state[i]
    return parameters[-1, 0] * value + total - parameters[-1, 1]


@numba.njit(cache=False)
def _memoryless(state, parameters, value, speed):
    gain, square, cubic, _, _ = parameters[0]
    return gain * value + square * value * value + cubic * value**3


_KERNELS = {
    'plays': _plays, 'bouc_wen': _bouc_wen, 'preisach': _preisach, 'memoryless': _memoryless}


def plays(elements, *, reach_v, gain_um_per_v, share=0.35, ratio=1.0, bend=(1.0, 0.0, 0.0),
          widening=0.0):
    """Return parameters of plays: `share` of the gain is hysteretic, `ratio` is down over up."""
    half = reach_v * np.geomspace(0.02, 0.9, elements)
    weight = np.linspace(2.0, 0.5, elements)
    weight *= share * gain_um_per_v / weight.sum()
    rows = [[(1.0 - share) * gain_um_per_v, 0.0, 0.0, 0.0, 0.0]]
    rows += [[w, r, ratio * r, widening, 0.0] for w, r in zip(weight, half, strict=True)]
    return np.array([*rows, [*bend, 0.0, 0.0]])


def relays(grid, *, reach_v, gain_um_per_v, share=0.25):
    """Return Preisach's relays on a triangle, denser about the diagonal, of a centred start."""
    levels = 1.05 * reach_v * (2.0 * (np.arange(grid) + 0.5) / grid - 1.0)
    rows = []
    for j, on in enumerate(levels):
        for off in levels[:j]:
            density = math.exp(-((on - off) / (0.8 * reach_v))**2 - (
                (on + off) / (2.5 * reach_v))**2)
            rows.append([density, on, off, -1.0 if on + off > 0.0 else 1.0, 0.0])
    relay = np.array(rows)
    relay[:, 0] *= share * gain_um_per_v * reach_v / relay[:, 0].sum()
    offset = float(relay[:, 0] @ relay[:, 3])
    return np.vstack([relay, [(1.0 - share) * gain_um_per_v, offset, 0.0, 0.0, 0.0]])


# -- the stage ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StageDescription:
    """
    What a stage is made of.

    `before` and `behind` are (zeros, poles) in rad/s, of unit dc gain; the hysteresis takes volts
    and gives micrometres. Voltage and displacement are deviations from the operating point.
    """

    sample_period_s: float
    reach_v: float
    hysteresis: str
    parameters: np.ndarray = field(repr=False)
    before: tuple = ((), ())
    behind: tuple = ((), ())
    delay_s: float = 0.0
    creep: float = 0.0  # share of the displacement that creeps in each decade of time
    drift_um_per_s: float = 0.0
    noise_um: float = 1e-3
    sensor_step_um: float = 0.0
    slew_limit_v_per_s: float = 0.0
    travel_um: float = 12.0
    instants: int = 8  # in a sample period


def pair(frequency_hz, damping):
    """Return a conjugate pair of roots, rad/s."""
    omega = 2.0 * math.pi * frequency_hz
    root = omega * complex(-damping, math.sqrt(1.0 - damping**2))
    return [root, root.conjugate()]


def lag(frequency_hz):
    """Return a real root, rad/s."""
    return [-2.0 * math.pi * frequency_hz]


def _unit_gain(roots):
    zeros, poles = (np.asarray(each, dtype=complex) for each in roots)
    gain = float(np.real(np.prod(-poles) / np.prod(-zeros)))
    return signal.ZerosPolesGain(zeros, poles, gain)


@numba.njit(cache=False)
def _advance(kernel, state, parameters, last, front, back, voltage_v, instants, fine_s, slew_v):
    """Hold each voltage for a sample period; return the displacement at the end of each."""
    fa, fb, fc, fx = front
    ba, bb, bc, bd, bx = back
    outputs = np.empty((voltage_v.size, instants))
    for k in range(voltage_v.size):
        change = voltage_v[k] - last[0]
        last[0] += min(max(change, -slew_v), slew_v)
        for i in range(instants):
            if fx.size:
                fx[:] = fa @ fx + fb * last[0]
                driven = fc @ fx
            else:
                driven = last[0]
            speed = (driven - last[1]) / fine_s
            last[1] = driven
            free = kernel(state, parameters, driven, speed)
            if bx.size:
                # Behind poles the input is smooth, else it is held.
                middle = 0.5 * (free + last[2]) if fx.size else free
                bx[:] = ba @ bx + bb * middle
                outputs[k, i] = bc @ bx + bd * free
            else:
                outputs[k, i] = free
            last[2] = free
    return outputs


class ForeignStage:
    """A stage with its state, never driven."""

    def __init__(self, description, seed=0):
        self.description = description
        self.fine_s = description.sample_period_s / description.instants
        self._kernel = _KERNELS[description.hysteresis]
        self._noise = np.random.default_rng(seed)
        self._fractions = round(description.delay_s / self.fine_s)
        self.reset()

    def reset(self):
        """Return to the state that was never driven."""
        d = self.description
        rows = d.parameters.shape[0]
        self._state = np.zeros(max(rows, 2))
        if d.hysteresis == 'preisach':
            self._state[:rows] = d.parameters[:, 3]
        self._last = np.zeros(3)
        self._front = self._discrete(d.before)
        self._back = self._discrete(d.behind)
        self._line = np.zeros(self._fractions)
        self._relaxed = np.zeros(5)
        self._index = 0

    def _discrete(self, roots):
        if not len(roots[1]):
            empty = np.zeros(0)
            return np.zeros((0, 0)), empty, empty, 0.0, empty
        system = _unit_gain(roots).to_ss()
        a, b, c, d, _ = signal.cont2discrete(
            (system.A, system.B, system.C, system.D), self.fine_s)
        return (np.ascontiguousarray(a), np.ascontiguousarray(b[:, 0]),
                np.ascontiguousarray(c[0]), float(d[0, 0]), np.zeros(a.shape[0]))

    def response(self, frequency_hz):
        """Return the linear part at frequencies, unit dc gain, with the delay and without hold."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        value = np.exp(-s * self.description.delay_s)
        for roots in (self.description.before, self.description.behind):
            zeros, poles = (np.asarray(each, dtype=complex) for each in roots)
            for zero in zeros:
                value = value * (1.0 - s / zero)
            for pole in poles:
                value = value / (1.0 - s / pole)
        return value

    def run(self, voltage_v):
        """Return y[1] … y[N] of the held voltages u[0] … u[N-1], as the sensor reads them."""
        return self.read(self.drive(voltage_v))

    def drive(self, voltage_v):
        """Return the true displacement at the end of each sample period."""
        d = self.description
        voltage_v = np.ascontiguousarray(voltage_v, dtype=float)
        slew_v = d.slew_limit_v_per_s * d.sample_period_s or 1e300
        fa, fb, fc, _, fx = self._front
        outputs = _advance(
            self._kernel, self._state, d.parameters, self._last, (fa, fb, fc, fx), self._back,
            voltage_v, d.instants, self.fine_s, slew_v)
        fine = np.concatenate([self._line, outputs.ravel()])
        if self._fractions:
            self._line = fine[-self._fractions:]
            fine = fine[:-self._fractions]
        true_um = fine.reshape(-1, d.instants)[:, -1]
        if d.creep:
            true_um = self._creep(true_um)
        time_s = d.sample_period_s * (self._index + 1 + np.arange(voltage_v.size))
        self._index += voltage_v.size
        return true_um + d.drift_um_per_s * time_s

    def _creep(self, free_um):
        result = free_um.copy()
        for i, time_s in enumerate((0.01, 0.1, 1.0, 10.0, 100.0)):
            pole = math.exp(-self.description.sample_period_s / time_s)
            relaxed, end = signal.lfilter(
                [1.0 - pole], [1.0, -pole], free_um, zi=[pole * self._relaxed[i]])
            self._relaxed[i] = end[0] / pole
            result += self.description.creep * relaxed
        return result

    def read(self, true_um):
        """Return what the sensor says of true displacements."""
        d = self.description
        read_um = true_um + d.noise_um * self._noise.standard_normal(np.shape(true_um))
        if d.sensor_step_um:
            read_um = np.round(read_um / d.sensor_step_um) * d.sensor_step_um
        return read_um


# -- the stages of the study ----------------------------------------------------------------------


def _small(hysteresis, parameters, **given):
    return StageDescription(
        reach_v=5.0, hysteresis=hysteresis, parameters=parameters, travel_um=12.0,
        **{'sample_period_s': 2e-5, **given})


STAGES = {
    'MRC of 5, one mode': _small(
        'plays', plays(5, reach_v=5.0, gain_um_per_v=1.1),
        behind=((), pair(900.0, 0.02)), sample_period_s=2e-5),
    'MRC of 20, amplifier before, mode and sensor behind': _small(
        'plays', plays(20, reach_v=5.0, gain_um_per_v=1.1, share=0.3),
        before=((), pair(1500.0, 0.7)), behind=((), [*pair(2600.0, 0.03), *lag(8000.0)]),
        sample_period_s=1e-5),
    'asymmetric plays, lag before': _small(
        'plays', plays(12, reach_v=5.0, gain_um_per_v=1.1, ratio=0.6, bend=(1.0, 0.006, -4e-4)),
        before=((), lag(400.0)), behind=((), pair(1200.0, 0.05)), sample_period_s=5e-5),
    'Bouc-Wen, mode and delay': _small(
        'bouc_wen', np.array([[1.1, 0.35, 0.8, 0.2, 0.0]]),
        behind=((), pair(700.0, 0.03)), delay_s=1.5e-4, sample_period_s=5e-5),
    'Preisach, two close modes': _small(
        'preisach', relays(40, reach_v=5.0, gain_um_per_v=1.1),
        behind=(pair(840.0, 0.01), [*pair(800.0, 0.01), *pair(880.0, 0.01)]),
        sample_period_s=1e-4),
    'creep and drift, antiresonance': _small(
        'plays', plays(8, reach_v=5.0, gain_um_per_v=1.0), creep=0.006, drift_um_per_s=0.002,
        behind=(pair(500.0, 0.02), [*pair(420.0, 0.02), *pair(1100.0, 0.04)]),
        sample_period_s=1e-4),
    'rate-dependent plays, first order': _small(
        'plays', plays(10, reach_v=5.0, gain_um_per_v=1.1, widening=2e-4),
        behind=((), lag(300.0)), sample_period_s=2e-4, noise_um=0.01),
    'large and slow, 10 nm steps': StageDescription(
        reach_v=5.0, hysteresis='plays', parameters=plays(5, reach_v=5.0, gain_um_per_v=9.0),
        before=((), pair(450.0, 0.8)), behind=((), pair(210.0, 0.04)), travel_um=100.0,
        sample_period_s=5e-4, noise_um=0.02, sensor_step_um=0.01),
    'no memory, one mode': _small(
        'memoryless', np.array([[1.1, 0.01, 0.0, 0.0, 0.0]]),
        behind=((), pair(2000.0, 0.01)), sample_period_s=1e-5, noise_um=1e-4),
}
