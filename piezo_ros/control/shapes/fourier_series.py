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
Fourier series of the periodic waveforms, (11) in Liu 2015, and their mean square.

All of them are odd about their phase 0: x(p) = sum over k of A_k sin(2 pi k p). For a peak of 1,
with the letters of `periodic_shapes`, sinc(x) = sin(pi x)/(pi x) and a = 1/2 - c::

    triangle, sawtooth   A_k = (rise + fall)/(k pi)^2 sinc(k w) sin(2 pi k a)
    staircase            A_k = 2/(pi k n) sin(k pi/2)/sin(k pi/(4 n)) B(pi k t/(4 n)),   k odd
                         B(z) = 3 (sin z - z cos z)/z^3,   of a smooth step

Lissajous axes are sines. A spiral has no Fourier series.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.shapes.periodic_shapes import turning_shape
from piezo_ros.control.waveform import WaveformParameters
from piezo_ros.model.parameters import ParameterError

__all__ = ['PERIODIC', 'fourier_amplitudes', 'mean_square_um2', 'odd_harmonics_only']

PERIODIC: Final = ('triangle', 'sine', 'sawtooth', 'staircase', 'lissajous')
_SINES: Final = ('sine', 'lissajous')
_SMALL_ANGLE: Final = 1e-2  # below it B(z) loses digits, and is 1 - z^2/10 to 1e-11
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the square of a parabola

_Floats = NDArray[np.float64]


def odd_harmonics_only(waveform: WaveformParameters) -> bool:
    """Return whether the even coefficients A_k of a periodic waveform vanish."""
    return waveform.waveform != 'sawtooth'


def fourier_amplitudes(waveform: WaveformParameters, harmonics: int) -> _Floats:
    """
    Return the sine coefficients A_k of a waveform, k = 1 … harmonics, (11) in Liu 2015.

    Parameters
    ----------
    waveform : WaveformParameters
        One of `PERIODIC`; its offset is no part of the series.
    harmonics : int
        Highest harmonic m, of the frequency `WaveformParameters.fundamental_hz`.

    Returns
    -------
    ndarray, shape (harmonics,)
        ``A_k``, micrometres.

    Raises
    ------
    ParameterError
        If the waveform has no Fourier series.

    Examples
    --------
    >>> amplitudes_um = fourier_amplitudes(WaveformParameters(amplitude_um=1.0), 5)
    >>> [round(a, 4) for a in amplitudes_um.tolist()]
    [0.8106, 0.0, -0.0901, 0.0, 0.0324]

    """
    k = np.arange(1, harmonics + 1)
    name, amplitude_um = waveform.waveform, waveform.amplitude_um
    if name in _SINES:
        return np.where(k == 1, amplitude_um, 0.0)
    if name == 'triangle' and waveform.turn_fraction == 0.0:
        return np.asarray(amplitude_um * 8.0 / (k * np.pi) ** 2 * _quarter_sines(k))
    if name in ('triangle', 'sawtooth'):
        shape = turning_shape(waveform.flyback, waveform.turn_fraction)
        middle = shape.straight_until + 0.5 * shape.turn
        sines = _quarter_sines(k) if name == 'triangle' else np.sin(2.0 * np.pi * k * middle)
        return np.asarray(
            amplitude_um * (shape.rise + shape.fall) / (k * np.pi) ** 2
            * np.sinc(k * shape.turn) * sines)
    if name == 'staircase':
        stairs = waveform.stairs
        smooth = _smooth_step(np.asarray(
            np.pi * k * waveform.turn_fraction / (4.0 * stairs), dtype=np.float64))
        # Where the quotient is 0/0, at multiples of 4 n, k is even.
        quotient = _quarter_sines(k) / np.where(k % 2, np.sin(k * np.pi / (4.0 * stairs)), 1.0)
        return np.asarray(amplitude_um * 2.0 / (np.pi * k * stairs) * quotient * smooth)
    raise ParameterError(f'waveform {name!r} is not periodic, harmonics must be 0')


def _quarter_sines(k: NDArray[np.int64]) -> _Floats:
    """Return sin(k pi/2): 0, 1, 0, -1 exactly, not to rounding."""
    return np.asarray(np.array([0.0, 1.0, 0.0, -1.0])[k % 4])


def _smooth_step(angle_rad: _Floats) -> _Floats:
    """Return B of a smooth step, 1 for a sharp one."""
    z = np.maximum(angle_rad, _SMALL_ANGLE)
    return np.where(
        angle_rad < _SMALL_ANGLE, 1.0 - angle_rad**2 / 10.0,
        3.0 * (np.sin(z) - z * np.cos(z)) / z**3)


def mean_square_um2(waveform: WaveformParameters) -> float:
    """
    Return the mean square of a periodic waveform about its offset, half the sum of A_k squared.

    Parameters
    ----------
    waveform : WaveformParameters
        One of `PERIODIC`.

    """
    return _mean_square(waveform) * waveform.amplitude_um**2


def _mean_square(waveform: WaveformParameters) -> float:
    """Return the mean square for an amplitude of 1."""
    if waveform.waveform in _SINES:
        return 0.5
    turn = waveform.turn_fraction
    if waveform.waveform == 'staircase':
        # From stair r to r + 1: so long at either, and the integral of (r + s(v))^2 between.
        r = np.arange(float(waveform.stairs))
        cells = 0.5 * (1.0 - turn) * (r**2 + (r + 1.0) ** 2) + turn * (r**2 + r + 13.0 / 35.0)
        return math.fsum(cells.tolist()) / waveform.stairs**3
    if waveform.waveform == 'triangle' and turn == 0.0:
        return 1.0 / 3.0
    shape = turning_shape(waveform.flyback, turn)
    t1, w = shape.straight_until, shape.turn
    into = 0.5 * w * (1.0 + _NODES)
    turned = shape.rise * (t1 + into)
    if w > 0.0:
        turned = turned - 0.5 * (shape.rise + shape.fall) / w * into**2
    return 2.0 * (
        shape.rise**2 * t1**3 / 3.0 + 0.5 * w * float(_WEIGHTS @ turned**2)
        + shape.fall**2 * (0.5 - t1 - w) ** 3 / 3.0)
