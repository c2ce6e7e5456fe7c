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
Feedforward for any trajectory that is known a little ahead: a chain of inverses.

    x = B+ y_d,   u_w = H^-1(x),   u = F+ u_w,   v = H(u)

B and F are the sampled responses behind and before the hysteresis H. Their zeros may lie outside
the unit circle, so that a causal inverse would not be stable; with p samples of preview a finite
impulse response h comes close,

    minimise   integral over w of R(w)^2 |h(w) g(w) - exp(-i w p)|^2 + (rho g(0))^2 |h(w)|^2
    subject to h(0) g(0) = 1,   R = 1/(1 + (w/w_b)^3)

g being the response of the stage and R the shape of the spectrum of a trajectory. v is the command
that the compensator turns into u again.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.model import HysteresisParameters, MaxwellResistiveCapacitor
from piezo_ros.model.state_space import (
    StateSpace,
    discretise_first_order_hold,
    discretise_zero_order_hold,
)

__all__ = ['InverseTaps', 'PreviewChain', 'inverse_taps']

_RESPONSE_SAMPLES: Final = 600
_FREQUENCIES: Final = 1024
_BAND: Final = 0.02  # w_b/(2 pi) in cycles a sample
_EFFORT: Final = 1e-4  # rho
_DC_WEIGHT: Final = 1e3


class InverseTaps(NamedTuple):
    """
    A finite impulse response that undoes a system but for a delay.

    Attributes
    ----------
    taps : ndarray, shape (M,)
        The impulse response.
    preview : int
        Delay of system and inverse together, samples.
    residual : float
        Root mean square of the deviation from that delay over the spectrum of a trajectory, of
        that spectrum; 0 for a perfect inverse, 1 for none.

    """

    taps: NDArray[np.float64]
    preview: int
    residual: float


def inverse_taps(
    impulse: NDArray[np.float64], preview: int, taps: int, band: float = _BAND,
) -> InverseTaps:
    """
    Return the inverse of an impulse response by least squares.

    Parameters
    ----------
    impulse : ndarray, shape (N,)
        Impulse response g[0] … g[N-1]; it has died away at the end.
    preview : int
        Delay of system and inverse together, samples, below ``taps``.
    taps : int
        Length M of the inverse.
    band : float, optional
        Where the spectrum of a trajectory falls, cycles a sample.

    Raises
    ------
    ValueError
        If the preview is negative or not below the number of taps, or the system passes no
        constant.

    Examples
    --------
    A system with a zero outside the unit circle:

    >>> inverse_taps(np.array([1.0, -1.25]), preview=40, taps=60).residual < 1e-2
    True
    >>> inverse_taps(np.array([1.0, -1.25]), preview=0, taps=60).residual > 0.2
    True

    """
    if not 0 <= preview < taps:
        raise ValueError(f'preview is {preview}, allowed is 0 … {taps - 1} (taps - 1)')
    dc = float(impulse.sum())
    if not abs(dc) > 1e-9 * float(np.abs(impulse).sum()):
        raise ValueError(f'impulse has the sum {dc:g}: the system passes no constant')
    omega = np.pi * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
    turns = np.exp(-1j * np.outer(omega, np.arange(max(taps, impulse.size))))
    spectrum = 1.0 / (1.0 + (omega / (2.0 * np.pi * band))**3)
    passed = (spectrum * (turns[:, :impulse.size] @ impulse))[:, None] * turns[:, :taps]
    wanted = spectrum * np.exp(-1j * omega * preview)
    effort = _EFFORT * abs(dc) * turns[:, :taps]
    none = np.zeros(_FREQUENCIES)
    found = np.linalg.lstsq(
        np.vstack([
            passed.real, passed.imag, effort.real, effort.imag,
            np.full((1, taps), _DC_WEIGHT * dc)]),
        np.concatenate([wanted.real, wanted.imag, none, none, [_DC_WEIGHT]]), rcond=None)[0]
    residual = float(np.linalg.norm(passed @ found - wanted) / np.linalg.norm(spectrum))
    return InverseTaps(np.asarray(found), preview, residual)


class PreviewChain:
    """
    The commands that bring a stage along a trajectory, a fixed number of samples later.

    Parameters
    ----------
    before, behind : StateSpace
        What stands before the hysteresis and behind it, in continuous time.
    hysteresis : HysteresisParameters
        The hysteresis of the stage, which the compensator inverts.
    sample_period_s : float
        Sample period, seconds.
    preview, taps : int, optional
        Of the inverse of what stands behind the hysteresis.
    before_preview, before_taps : int, optional
        Of the inverse of what stands before it.

    Attributes
    ----------
    latency : int
        The reading k follows the reference k - latency.
    residual : float
        Root mean square of what the two inverses leave, of the spectrum of a trajectory.

    """

    def __init__(
        self, before: StateSpace, hysteresis: HysteresisParameters, behind: StateSpace,
        sample_period_s: float, *, preview: int = 30, taps: int = 71, before_preview: int = 4,
        before_taps: int = 20,
    ) -> None:
        self._operator = MaxwellResistiveCapacitor.of(hysteresis)
        self._behind = inverse_taps(
            _impulse(discretise_first_order_hold(behind, sample_period_s)), preview, taps)
        # A reading at the end of the sample period in which the voltage is held.
        self._before = inverse_taps(
            _impulse(discretise_zero_order_hold(before, sample_period_s))[bool(before.a.size):],
            before_preview, before_taps)
        self.latency = preview + before_preview + 1
        self.residual = float(np.hypot(self._behind.residual, self._before.residual))
        self.reset()

    def reset(self) -> None:
        """Return to a stage that was never driven, and a trajectory that was always zero."""
        self._past_um = np.zeros(self._behind.taps.size - 1)
        self._past_v = np.zeros(self._before.taps.size - 1)
        self._inverse_state = self._operator.virgin_state()
        self._forward_state = self._operator.virgin_state()

    def answer(self, reference_um: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the commands of consecutive samples.

        Parameters
        ----------
        reference_um : ndarray, shape (N,)
            The trajectory, `latency` samples ahead of the stage.

        Returns
        -------
        ndarray, shape (N,)
            Commands for the compensator, micrometres.

        """
        free_um, self._past_um = _filtered(self._behind.taps, self._past_um, reference_um)
        wanted_v, self._inverse_state = self._operator.inverse(free_um, self._inverse_state)
        voltage_v, self._past_v = _filtered(self._before.taps, self._past_v, wanted_v)
        command_um, self._forward_state = self._operator.forward(voltage_v, self._forward_state)
        return command_um


def _filtered(
    taps: NDArray[np.float64], past: NDArray[np.float64], values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the filtered values and the last M - 1 inputs."""
    known = np.concatenate([past, values])
    result = np.zeros(values.size)
    # Tap by tap, for the same sum at every sample however the samples come in blocks.
    for delay, tap in enumerate(taps.tolist()):
        first = past.size - delay
        result += tap * known[first:first + values.size]
    return result, known[values.size:]


def _impulse(system: StateSpace) -> NDArray[np.float64]:
    """Return the impulse response of a sampled system, shape (600,)."""
    state = system.b[:, 0]
    response = np.empty(_RESPONSE_SAMPLES)
    response[0] = system.d[0, 0]
    for k in range(1, _RESPONSE_SAMPLES):
        response[k] = float(system.c[0] @ state) if state.size else 0.0
        state = system.a @ state
    return response
