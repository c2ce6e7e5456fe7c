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
the right half plane.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.waveform import TURN_RAD, WaveformParameters
from piezo_ros.model.dynamics import LinearDynamics
from piezo_ros.model.parameters import ParameterError
from piezo_ros.model.step import step

__all__ = [
    'PERIODIC',
    'FeedforwardConstants',
    'feedforward_constants',
    'feedforward_step',
    'fourier_amplitudes',
    'mean_square_um2',
    'usual_harmonics',
]

# Mean square of the waveforms that have a Fourier series here, for an amplitude of 1.
_MEAN_SQUARE: Final = {'triangle': 1.0 / 3.0, 'sine': 0.5}
PERIODIC: Final = tuple(_MEAN_SQUARE)
# Of the dc gain: what is less can hardly be inverted, and its model is a guess.
_LEAST_GAIN: Final = 1e-6
_USUAL_HARMONICS: Final = 9


class FeedforwardConstants(NamedTuple):
    """
    The odd harmonics U_k = A_k/G(i w_k), k = 1, 3, 5 …; lists in a node, arrays in a kernel.

    Without harmonics (no Fourier series) the feedforward is the reference times ``dc_inverse``.
    """

    real_um: Any  # (ceil(m / 2),)
    imaginary_um: Any  # (ceil(m / 2),)
    dc_inverse: float


def fourier_amplitudes(
    waveform: str, amplitude_um: float, harmonics: int,
) -> NDArray[np.float64]:
    """
    Return the sine coefficients A_k of a waveform, k = 1 … harmonics, (11) in Liu 2015.

    Parameters
    ----------
    waveform : str
        ``'triangle'`` or ``'sine'``.
    amplitude_um : float
        Peak amplitude, micrometres.
    harmonics : int
        Highest harmonic m.

    Returns
    -------
    ndarray, shape (harmonics,)
        ``A_k``, micrometres; the even ones are zero.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series here.

    Examples
    --------
    >>> [round(a, 4) for a in fourier_amplitudes('triangle', 1.0, 5).tolist()]
    [0.8106, 0.0, -0.0901, 0.0, 0.0324]

    """
    k = np.arange(1, harmonics + 1)
    if waveform == 'triangle':
        # sin(k pi/2) is 0, 1, 0, -1 exactly, not to rounding.
        signs = np.array([0.0, 1.0, 0.0, -1.0])[k % 4]
        return np.asarray(amplitude_um * 8.0 / (k * np.pi) ** 2 * signs)
    if waveform == 'sine':
        return np.where(k == 1, amplitude_um, 0.0)
    raise ParameterError(f'waveform {waveform!r} is not periodic, harmonics must be 0')


def mean_square_um2(waveform: str, amplitude_um: float) -> float:
    """
    Return the mean square of a periodic waveform, half the sum of its A_k squared.

    Parameters
    ----------
    waveform : str
        One of `PERIODIC`.
    amplitude_um : float
        Peak amplitude, micrometres.

    """
    return _MEAN_SQUARE[waveform] * amplitude_um**2


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
    odd = np.arange(1, harmonics + 1, 2)
    nyquist_hz = 0.5 / waveform.sample_period_s
    highest_hz = float(odd[-1]) * waveform.frequency_hz
    if highest_hz >= nyquist_hz:
        raise ParameterError(
            f'harmonics is {harmonics}: harmonic {odd[-1]} of {waveform.frequency_hz:g} Hz is at '
            f'{highest_hz:g} Hz, it must be below the Nyquist frequency {nyquist_hz:g} Hz')
    amplitudes = fourier_amplitudes(waveform.waveform, waveform.amplitude_um, harmonics)[odd - 1]
    frequency_hz = np.asarray(odd * waveform.frequency_hz, dtype=np.float64)
    response = _inverted_response(model, frequency_hz, waveform.sample_period_s, sampled)
    small = ~_is_invertible(response, model) & (amplitudes != 0.0)
    if small.any():
        first = int(np.flatnonzero(small)[0])
        raise ParameterError(
            f'harmonics is {harmonics}: at harmonic {odd[first]} of {waveform.frequency_hz:g} Hz, '
            f'{frequency_hz[first]:g} Hz, the model has the gain {abs(response[first]):.3g}, it '
            f'must be {_LEAST_GAIN * model.dc_gain:.3g} at least ({_LEAST_GAIN:g} of the dc gain) '
            'to be inverted')
    u = amplitudes / np.where(amplitudes != 0.0, response, 1.0)
    return FeedforwardConstants(u.real.tolist(), u.imag.tolist(), dc_inverse)


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
        model has hardly any gain; 0 for a waveform without Fourier series.

    """
    if waveform.waveform not in PERIODIC:
        return 0
    odd = np.arange(1, _USUAL_HARMONICS + 1, 2)
    odd = odd[odd * waveform.frequency_hz < 0.5 / waveform.sample_period_s]
    frequency_hz = np.asarray(odd * waveform.frequency_hz, dtype=np.float64)
    response = _inverted_response(model, frequency_hz, waveform.sample_period_s, sampled)
    used = fourier_amplitudes(waveform.waveform, 1.0, _USUAL_HARMONICS)[odd - 1] != 0.0
    refused = np.flatnonzero(~_is_invertible(response, model) & used)
    return int(odd[-1]) if not refused.size else max(2 * int(refused[0]) - 1, 0)


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
    Return u_ff of (13) without its soft start: Im(sum over odd k of U_k z^k), z = exp(i w t).

    Horner's scheme in z^2 needs one sine and one cosine for all harmonics.
    """
    harmonics = len(constants.real_um)
    if harmonics == 0:
        return constants.dc_inverse * reference_um
    angle_rad = TURN_RAD * (turns - math.floor(turns))
    cosine = math.cos(angle_rad)
    sine = math.sin(angle_rad)
    square_real = cosine * cosine - sine * sine
    square_imaginary = 2.0 * cosine * sine
    real = 0.0
    imaginary = 0.0
    for j in range(harmonics - 1, -1, -1):
        carried = real * square_real - imaginary * square_imaginary + constants.real_um[j]
        imaginary = real * square_imaginary + imaginary * square_real + constants.imaginary_um[j]
        real = carried
    return real * sine + imaginary * cosine
