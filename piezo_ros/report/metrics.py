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
Tracking error and hysteresis nonlinearity of a run, as fractions.

    NRMSE               = RMS(y_d - y) / (max y_d - min y_d)             Section 5 in Liu 2015
    input nonlinearity  = max |u_rising(y) - u_falling(y)| / (max u - min u)        Fig. 5
    output nonlinearity = max |y_rising(u) - y_falling(u)| / (max y - min y)        Fig. 5

with desired displacement y_d, measured displacement y and input u of the hysteresis loop.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['Nonlinearity', 'nonlinearity', 'nrmse', 'tail']

# A branch is complete if it spans this share of the peak-to-peak voltage: a record that ends a few
# samples before the turning point still closes its loop, one that ends halfway does not.
_WHOLE_BRANCH_SHARE: Final = 0.95
# Half the dead band around the middle, as a share of the peak-to-peak voltage, that separates upper
# excursions from lower ones. Every value well above the noise and below 0.5 works.
_DEAD_BAND_SHARE: Final = 0.25
# fs / f is rarely representable: 4 / (500 Hz * 1e-5 s) must give 800 samples, never 799.
_ROUNDING_SAMPLES: Final = 1e-6

_Floats = NDArray[np.float64]


class Nonlinearity(NamedTuple):
    """
    Width of a hysteresis loop (Fig. 5 in Liu 2015).

    Attributes
    ----------
    input : float
        Largest difference of voltage between the branches at equal displacement, as a fraction of
        the peak-to-peak voltage.
    output : float
        Largest difference of displacement between the branches at equal voltage, as a fraction of
        the peak-to-peak displacement.

    """

    input: float
    output: float


def nrmse(reference: ArrayLike, measured: ArrayLike) -> float:
    """
    Return the normalised root mean square tracking error (Section 5 in Liu 2015).

    Parameters
    ----------
    reference : array_like, shape (n,)
        Desired displacement y_d, um, over whole periods in steady state.
    measured : array_like, shape (n,)
        Measured displacement y, um.

    Returns
    -------
    float
        RMS(y_d - y) over the peak-to-peak of y_d; a fraction, not percent.

    Raises
    ------
    ValueError
        If the arrays are empty, not one-dimensional or of different shape, contain a value that is
        not finite, or if the reference is constant.

    """
    desired, actual = _finite_pair('reference', reference, 'measured', measured)
    error = desired - actual
    # In place and by methods: over a few periods the calls take longer than the sums.
    error *= error
    return float(np.sqrt(error.sum() / error.size) / _peak_to_peak('reference', desired))


def nonlinearity(voltage: ArrayLike, displacement: ArrayLike) -> Nonlinearity:
    """
    Return the nonlinearity of the last complete loop of a record (Fig. 5 in Liu 2015).

    The loop is split at the extremes of the voltage into a rising and a falling branch. Between
    samples each branch is interpolated linearly; samples with equal abscissa, which a converter
    produces, are averaged.

    Parameters
    ----------
    voltage : array_like, shape (n,)
        Input of the loop: volts, or micrometres of command for a compensated actuator.
    displacement : array_like, shape (n,)
        Output of the loop, um.

    Returns
    -------
    Nonlinearity
        Input and output nonlinearity, fractions of the peak-to-peak of that loop.

    Raises
    ------
    ValueError
        If the arrays are empty, not one-dimensional or of different shape, contain a value that is
        not finite, are constant, or contain no complete loop.

    """
    u, x = _finite_pair('voltage', voltage, 'displacement', displacement)
    first, middle, last = _last_whole_loop(u)
    one, other = slice(first, middle + 1), slice(middle, last + 1)
    loop = slice(first, last + 1)
    return Nonlinearity(
        input=_largest_gap(x[one], u[one], x[other], u[other]) / _peak_to_peak('voltage', u[loop]),
        output=_largest_gap(u[one], x[one], u[other], x[other])
        / _peak_to_peak('displacement', x[loop]))


def tail(n_samples: int, frequency_hz: float, sample_period_s: float, periods: float) -> slice:
    """
    Return the slice of the last floor(periods * fs / f) samples of a record.

    Parameters
    ----------
    n_samples : int
        Samples in the record.
    frequency_hz : float
        Fundamental frequency f, hertz.
    sample_period_s : float
        Sample period 1 / fs, seconds.
    periods : float
        Periods to keep.

    Returns
    -------
    slice
        Selects the window from an array of `n_samples`.

    Raises
    ------
    ValueError
        If an argument is not positive and finite, or the record is shorter than the window.

    """
    for name, value in (('frequency_hz', frequency_hz), ('sample_period_s', sample_period_s),
                        ('periods', periods)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f'{name} is {value}, it must be positive and finite')
    count = math.floor(periods / (frequency_hz * sample_period_s) + _ROUNDING_SAMPLES)
    if not 1 <= count <= n_samples:
        raise ValueError(
            f'{periods:g} periods of {frequency_hz:g} Hz are {count} samples of '
            f'{sample_period_s:g} s, the record has {n_samples}; 1 to {n_samples} can be taken')
    return slice(n_samples - count, n_samples)


def _finite_pair(
    name_a: str, a: ArrayLike, name_b: str, b: ArrayLike
) -> tuple[_Floats, _Floats]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(
            f'{name_a} has shape {first.shape} and {name_b} {second.shape}, '
            'they must be one-dimensional and equally long')
    if first.size == 0:
        raise ValueError(f'{name_a} and {name_b} are empty, at least one sample is needed')
    for name, values in ((name_a, first), (name_b, second)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = np.flatnonzero(~finite)
            raise ValueError(f'{name}[{bad[0]}] is {values[bad[0]]}, it must be finite')
    return first, second


def _peak_to_peak(name: str, values: _Floats) -> float:
    width = float(values.max() - values.min())
    if width == 0.0:
        raise ValueError(
            f'{name} is constant at {values[0]}, its peak-to-peak must be greater than 0')
    return width


def _last_whole_loop(u: _Floats) -> tuple[int, int, int]:
    """Return the indices of the three successive extremes of `u` that bound its last loop."""
    width = _peak_to_peak('voltage', u)
    offset = u - (u.min() + width / 2)
    outside = np.flatnonzero(np.abs(offset) >= _DEAD_BAND_SHARE * width)
    upper = offset[outside] > 0
    starts = outside[np.flatnonzero(np.diff(upper, prepend=not upper[0]))]
    excursions = zip(starts, [*starts[1:], u.size], strict=True)
    turns = [int(start + np.argmax(np.abs(offset[start:stop]))) for start, stop in excursions]
    whole = np.abs(np.diff(u[turns])) >= _WHOLE_BRANCH_SHARE * width
    ends = np.flatnonzero(whole[:-1] & whole[1:])
    if ends.size == 0:
        raise ValueError(
            f'voltage turns {len(turns)} times in {u.size} samples without one whole loop: two '
            f'successive branches of {_WHOLE_BRANCH_SHARE:.0%} of its peak-to-peak {width:g}')
    last = int(ends[-1])
    return turns[last], turns[last + 1], turns[last + 2]


def _largest_gap(x_a: _Floats, y_a: _Floats, x_b: _Floats, y_b: _Floats) -> float:
    """Return the largest difference of two sampled curves over the abscissae they share."""
    knots_a, values_a = _as_function(x_a, y_a)
    knots_b, values_b = _as_function(x_b, y_b)
    low, high = max(knots_a[0], knots_b[0]), min(knots_a[-1], knots_b[-1])
    # Two piecewise linear curves are farthest apart at a knot of either.
    knots = np.concatenate((knots_a, knots_b))
    knots = knots[(knots >= low) & (knots <= high)]
    gap = np.interp(knots, knots_a, values_a) - np.interp(knots, knots_b, values_b)
    return float(np.max(np.abs(gap), initial=0.0))


def _as_function(x: _Floats, y: _Floats) -> tuple[_Floats, _Floats]:
    """Return the sorted distinct abscissae and the mean ordinate at each."""
    knots, member = np.unique(x, return_inverse=True)
    return knots, np.bincount(member, weights=y) / np.bincount(member)
