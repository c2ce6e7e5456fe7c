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
The truncated Fourier feedforward, (11) to (13) in Liu 2015.

Each harmonic of the desired trajectory is divided by the response of the model at its frequency,
w_k = 2 pi k f. For a triangle of amplitude A::

    y_d  = sum over k of A_k sin(w_k t),   A_k = A 8 / (k pi)^2 sin(k pi / 2)       (11)
    u_ff = sum over k <= m of A_k / abs(G(i w_k)) sin(w_k t - arg G(i w_k))         (12, 13)

Here the sum is evaluated as a polynomial in z = exp(2 pi i f t)::

    u_ff = Im(sum over odd k <= m of U_k z^k),   U_k = A_k / G(i w_k)

G is any stable model with its delay. The plain inverse of G(s) would be unstable where zeros are in
the right half plane. A waveform with even harmonics (a sawtooth) has them in the sum. The offset
y_0 adds y_0/G(0), a lissajous axis counts the angle by its own periods.

A spiral grows: to g t e^(i w t), as the real system answers to t e^(i w t) by
(t G(i w) + G'(i w)) e^(i w t), belongs

    u_ff = Im(g (t - G'(i w)/G(i w))/G(i w) e^(i w t)),   G' = dG/ds
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.shapes.fourier_series import (
    PERIODIC,
    fourier_amplitudes,
    odd_harmonics_only,
)
from piezo_ros.control.waveform import (
    TURN_RAD,
    WAVEFORMS,
    WaveformParameters,
    waveform_constants,
)
from piezo_ros.model.dynamics import LinearDynamics
from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.step import step

__all__ = [
    'FeedforwardConstants',
    'feedforward_constants',
    'feedforward_step',
    'usual_harmonics',
]

_SPIRAL: Final = WAVEFORMS[9]
_DIFFERENCE: Final = 1e-5  # of the frequency, for the derivative of the response
# Of the dc gain: what is less can hardly be inverted, and its model is a guess.
_LEAST_GAIN: Final = 1e-6
_USUAL_HARMONICS: Final = 9


class FeedforwardConstants(NamedTuple):
    """
    The harmonics U_k = A_k/G(i w_k), k = 1, 3, 5 … or 1, 2, 3 …; lists in a node, else arrays.

    Without harmonics (no Fourier series) the feedforward is the reference times ``dc_inverse``.
    """

    real_um: Any  # (ceil(m / 2),), or (m,) with the even ones
    imaginary_um: Any  # as well
    dc_inverse: float
    has_even: bool = False  # whether the even harmonics are listed too
    mean_um: float = 0.0  # for the offset
    cycles: float = 1.0  # of the axis in a period
    phase: float = 0.0  # of the axis at the start, in turns
    growth_real_um: float = 0.0  # of a spiral, for each turn
    growth_imaginary_um: float = 0.0


def feedforward_constants(
    waveform: WaveformParameters, harmonics: int, model: LinearDynamics, *,
    sampled: bool = False,
) -> FeedforwardConstants:
    """
    Return the constants of the feedforward, as lists.

    Parameters
    ----------
    waveform : WaveformParameters
        The desired trajectory.
    harmonics : int
        Highest harmonic m of the feedforward; 0: the reference over the model's dc gain.
    model : LinearDynamics
        The model that is inverted.
    sampled : bool, optional
        Whether to invert its response behind the zero-order hold of the D/A converter in place of
        the continuous one of the paper.

    Raises
    ------
    ParameterError
        If the highest odd harmonic is not below the Nyquist frequency, the model has hardly any
        gain at a harmonic, or the waveform has no Fourier series.

    """
    dc_inverse = 1.0 / model.dc_gain
    if harmonics == 0:
        return FeedforwardConstants([], [], dc_inverse)
    has_even = waveform.waveform in PERIODIC and not odd_harmonics_only(waveform)
    order = np.arange(1, harmonics + 1, 1 if has_even else 2)
    nyquist_hz = 0.5 / waveform.sample_period_s
    highest_hz = float(order[-1]) * waveform.fundamental_hz
    if highest_hz >= nyquist_hz:
        raise ParameterError(
            f'harmonics is {harmonics}: harmonic {order[-1]} of {waveform.fundamental_hz:g} Hz is '
            f'at {highest_hz:g} Hz, it must be below the Nyquist frequency {nyquist_hz:g} Hz')
    if waveform.waveform == _SPIRAL:
        order, amplitudes = order[:1], np.array([waveform.amplitude_um])
    else:
        amplitudes = fourier_amplitudes(waveform, harmonics)[order - 1]
    frequency_hz = np.asarray(order * waveform.fundamental_hz, dtype=np.float64)
    response = _inverted_response(model, frequency_hz, waveform.sample_period_s, sampled)
    small = ~_is_invertible(response, model) & (amplitudes != 0.0)
    if small.any():
        first = int(np.flatnonzero(small)[0])
        raise ParameterError(
            f'harmonics is {harmonics}: at harmonic {order[first]} of '
            f'{waveform.fundamental_hz:g} Hz, '
            f'{frequency_hz[first]:g} Hz, the model has the gain {abs(response[first]):.3g}, it '
            f'must be {_LEAST_GAIN * model.dc_gain:.3g} at least ({_LEAST_GAIN:g} of the dc gain) '
            'to be inverted')
    u = amplitudes / np.where(amplitudes != 0.0, response, 1.0)
    constants = waveform_constants(waveform)
    growth = 0j
    if waveform.waveform == _SPIRAL:
        growth = complex(u[0]) * constants.growth_per_turn
        # A turn takes 1/f: t is measured in turns, and G' is by s/f.
        u = np.array([-growth * waveform.frequency_hz * _slope_of_response(
            model, waveform, sampled) / complex(response[0])])
    return FeedforwardConstants(
        u.real.tolist(), u.imag.tolist(), dc_inverse, has_even,
        dc_inverse * constants.offset, constants.cycles, constants.phase, growth.real, growth.imag)


def _slope_of_response(
    model: LinearDynamics, waveform: WaveformParameters, sampled: bool,
) -> complex:
    """Return dG/ds at the frequency of a waveform, seconds."""
    width_hz = _DIFFERENCE * waveform.frequency_hz
    below, above = _inverted_response(
        model, waveform.frequency_hz + np.array([-width_hz, width_hz]), waveform.sample_period_s,
        sampled).tolist()
    return complex((above - below) / (2.0 * width_hz * TURN_RAD * 1j))


def usual_harmonics(
    waveform: WaveformParameters, model: LinearDynamics, *, sampled: bool = False,
) -> int:
    """
    Return the highest harmonic m that is taken where none is given.

    Parameters
    ----------
    waveform, model, sampled
        As for `feedforward_constants`.

    Returns
    -------
    int
        9, or as many as there are below the Nyquist frequency and below the first at which the
        model has hardly any gain; 1 for a spiral; 0 for a waveform without Fourier series, and for
        a staircase, of which 9 would make a triangle.

    """
    if waveform.waveform == _SPIRAL:
        return 1
    if waveform.waveform not in PERIODIC or waveform.waveform == 'staircase':
        return 0
    order = np.arange(1, _USUAL_HARMONICS + 1)
    if odd_harmonics_only(waveform):
        order = order[::2]
    order = order[order * waveform.fundamental_hz < 0.5 / waveform.sample_period_s]
    frequency_hz = np.asarray(order * waveform.fundamental_hz, dtype=np.float64)
    response = _inverted_response(model, frequency_hz, waveform.sample_period_s, sampled)
    used = fourier_amplitudes(waveform, _USUAL_HARMONICS)[order - 1] != 0.0
    refused = np.flatnonzero(~_is_invertible(response, model) & used)
    if not refused.size:
        return int(order[-1])
    return int(order[refused[0] - 1]) if refused[0] else 0


def _inverted_response(
    model: LinearDynamics, frequency_hz: NDArray[np.float64], sample_period_s: float,
    sampled: bool,
) -> NDArray[np.complex128]:
    if sampled:
        return model.sampled_response(frequency_hz, sample_period_s)
    return model.response(frequency_hz)


def _is_invertible(
    response: NDArray[np.complex128], model: LinearDynamics,
) -> NDArray[np.bool_]:
    return np.asarray(np.abs(response) >= _LEAST_GAIN * model.dc_gain)


@step
def feedforward_step(constants: FeedforwardConstants, turns: float, reference_um: float) -> float:
    """
    Return u_ff of (13) without its soft start: Im(sum of U_k z^k), z = exp(i w t).

    Horner's scheme, in z^2 where all k are odd, needs one sine and one cosine for all harmonics.
    """
    harmonics = len(constants.real_um)
    if harmonics == 0:
        return constants.dc_inverse * reference_um
    cycle = constants.cycles * turns + constants.phase
    angle_rad = TURN_RAD * (cycle - math.floor(cycle))
    cosine = math.cos(angle_rad)
    sine = math.sin(angle_rad)
    factor_real = cosine * cosine - sine * sine
    factor_imaginary = 2.0 * cosine * sine
    if constants.has_even:
        factor_real = cosine
        factor_imaginary = sine
    real = 0.0
    imaginary = 0.0
    for j in range(harmonics - 1, -1, -1):
        carried = real * factor_real - imaginary * factor_imaginary + constants.real_um[j]
        imaginary = real * factor_imaginary + imaginary * factor_real + constants.imaginary_um[j]
        real = carried
    if constants.growth_real_um != 0.0:
        real += constants.growth_real_um * turns
        imaginary += constants.growth_imaginary_um * turns
    value_um = real * sine + imaginary * cosine
    return value_um + constants.mean_um if constants.mean_um != 0.0 else value_um
