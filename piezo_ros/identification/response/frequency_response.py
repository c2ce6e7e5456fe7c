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
The frequency response of a periodically excited stage, with its confidence.

With the phasors X of the input and Y of the output, fitted by least squares (see `line_fit`)::

    H = Y/X
    variance = max(scatter, residual)
    scatter  = M/(M - 1) sum_m q_m^2 |Y_m - H X_m|^2 / |X|^2  over M groups of periods, q_m: the
                                                              share of the samples, mostly 1/M
    residual = (s_y^2 + |H|^2 s_x^2) v / |X|^2                v: variance of a phasor for s = 1

The scatter includes noise of any colour and drift; the residual also includes errors that repeat
in every period, such as converter steps and harmonics. A lost sample costs the group of periods
that it lies in at most, as the fit needs neither every sample nor every period.

Examples
--------
>>> from piezo_ros.control.tables.excitation import Window
>>> k = np.arange(2000)
>>> command_um = np.cos(2.0 * np.pi * 0.01 * k)
>>> displacement_um = 0.5 * np.cos(2.0 * np.pi * 0.01 * (k - 5))  # 18 degrees late
>>> measured = frequency_response(
...     command_um, displacement_um, 1e-4, excitation=[Window(0, 2000, 100.0, (1,))])
>>> measured.frequency_hz, np.abs(measured.response).round(6)
(array([100.]), array([0.5]))
>>> np.angle(measured.response, deg=True).round(6)
array([-18.])

"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.control.tables.excitation import Excitation, Window
from piezo_ros.identification.response.amplifier_limits import (
    Amplifier,
    limit_reached,
    settled_samples,
)
from piezo_ros.identification.response.line_fit import LineFit, fit_lines

__all__ = ['Amplifier', 'ExcludedPoint', 'FrequencyResponse', 'frequency_response', 'merge']

_HIGHEST_HARMONIC = 7
_MOST_DETECTION_LINES = 40
_RELATIVE_FLOOR = 1e-9  # smallest standard error, relative to the response


class ExcludedPoint(NamedTuple):
    """
    A point that was measured and left out.

    Attributes
    ----------
    frequency_hz : float
        Its frequency, hertz.
    amplitude, offset : float
        Of the input, in its unit.
    reason : str
        Why it was left out.

    """

    frequency_hz: float
    amplitude: float
    offset: float
    reason: str


@dataclass(frozen=True)
class FrequencyResponse:
    """
    Points of a frequency response, in order of frequency.

    Attributes
    ----------
    frequency_hz : ndarray, shape (N,)
        Frequencies, hertz.
    response : ndarray of complex, shape (N,)
        Output over input of a sampled record; includes the zero-order hold.
    variance : ndarray, shape (N,)
        ``E|error|**2`` of the response, half of it in the real part and half in the imaginary.
    coherence : ndarray, shape (N,)
        Coherence of the groups of periods, 1 without noise; NaN where there was one group only.
    distortion : ndarray, shape (N,)
        Harmonics of a sine, or the level at the lines between those of a multisine, over the
        output at the excited lines.
    amplitude : ndarray, shape (N,)
        Half of the input's peak-to-peak value, in its unit.
    offset : ndarray, shape (N,)
        Mean of the input, in its unit.
    sample_period_s : float
        Sample period of the record, seconds.
    excluded : tuple of ExcludedPoint
        Points that were left out, with the reason.
    samples_used : int
        Samples of the records that the points were made of; 0 where it is not known.
    samples_lost : int
        Samples that are missing or not finite, inside the evaluated windows or outside.
    losses : tuple of str
        Sentences that say where samples were lost, and of which points.
    input_unit : str
        Unit of the input, ``'um'`` or ``'v'``.
    notes : tuple of str
        Sentences that say what has been assumed of the points.

    """

    frequency_hz: NDArray[np.float64]
    response: NDArray[np.complex128]
    variance: NDArray[np.float64]
    coherence: NDArray[np.float64]
    distortion: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    offset: NDArray[np.float64]
    sample_period_s: float
    excluded: tuple[ExcludedPoint, ...] = ()
    samples_used: int = 0
    samples_lost: int = 0
    losses: tuple[str, ...] = ()
    input_unit: str = 'um'
    notes: tuple[str, ...] = ()

    @property
    def standard_error(self) -> NDArray[np.float64]:
        """Standard error of the real and of the imaginary part, shape (N,)."""
        return np.sqrt(0.5 * self.variance)

    @property
    def confidence_radius(self) -> NDArray[np.float64]:
        """Radius of the circle that contains the true response in 95 % of cases, shape (N,)."""
        return np.asarray(np.sqrt(-math.log(0.05) * self.variance))

    def select(self, mask: ArrayLike) -> 'FrequencyResponse':
        """
        Return some of the points; the list of excluded points is kept.

        Parameters
        ----------
        mask : array_like of bool or int, shape (N,)
            The points to keep, or indices in a new order.

        """
        kept = np.asarray(mask)
        return dataclasses.replace(self, **{
            field: getattr(self, field)[kept] for field in _ARRAYS})

    def below(self, maximum_frequency_hz: float) -> 'FrequencyResponse':
        """Return the points up to a frequency, hertz."""
        return self.select(self.frequency_hz <= maximum_frequency_hz)


_ARRAYS = (
    'frequency_hz', 'response', 'variance', 'coherence', 'distortion', 'amplitude', 'offset')


def merge(responses: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """
    Return the points of several records in one response, in order of frequency.

    Parameters
    ----------
    responses : sequence of FrequencyResponse
        At least one, all of the same sample period.

    Raises
    ------
    ValueError
        If there is none, or the sample periods or the units differ.

    """
    if not responses:
        raise ValueError('responses is empty, at least one frequency response is needed')
    first = responses[0]
    for number, other in enumerate(responses):
        if other.sample_period_s != first.sample_period_s:
            raise ValueError(
                f'responses[{number}] has sample_period_s {other.sample_period_s:g} s and '
                f'responses[0] {first.sample_period_s:g} s; they must be equal')
        if other.input_unit != first.input_unit:
            raise ValueError(
                f'responses[{number}] is one to {other.input_unit!r} and responses[0] to '
                f'{first.input_unit!r}; they must be equal')
    arrays = {
        field: np.concatenate([getattr(response, field) for response in responses])
        for field in _ARRAYS}
    together = FrequencyResponse(
        **arrays, sample_period_s=first.sample_period_s,
        excluded=tuple(point for response in responses for point in response.excluded),
        samples_used=sum(response.samples_used for response in responses),
        samples_lost=sum(response.samples_lost for response in responses),
        losses=tuple(loss for response in responses for loss in response.losses),
        input_unit=first.input_unit,
        notes=tuple(note for response in responses for note in response.notes))
    return together.select(np.argsort(together.frequency_hz, kind='stable'))


def frequency_response(
    input_: ArrayLike,
    output: ArrayLike,
    sample_period_s: float,
    *,
    excitation: Excitation | Sequence[Window],
    voltage_v: ArrayLike | None = None,
    amplifier: Amplifier | None = None,
    distortion_limit: float = 0.1,
) -> FrequencyResponse:
    """
    Return the frequency response of a record of a stepped sine or a multisine.

    ``output[k]`` is measured at ``k * sample_period_s``, ``input_[k]`` is held from then on: the
    response includes the zero-order hold.

    Parameters
    ----------
    input_ : array_like, shape (N,)
        Command, micrometres, or voltage, volts.
    output : array_like, shape (N,)
        Measured displacement, micrometres. Samples of input and output that are NaN or infinite are
        lost ones: a window does without them, or is left out where too many of it are.
    sample_period_s : float
        Sample period, seconds.
    excitation : Excitation or sequence of Window
        Samples of the record in which each frequency is excited; other samples (ramp to the
        offset, transients) are ignored.
    voltage_v : array_like, shape (N,), optional
        Amplifier input, for the check against its limits; the input itself by default if
        `amplifier` is given.
    amplifier : Amplifier, optional
        Limits; points that reach one are left out.
    distortion_limit : float, optional
        Points of more distortion are left out. Distortion is a coarse sign of an amplifier that
        slews or saturates, as the stage attenuates harmonics; where the limits are known, give
        `amplifier`.

    Returns
    -------
    FrequencyResponse
        The points in order of frequency, and those left out with the reason.

    Raises
    ------
    ValueError
        If lengths differ, a window is not inside the record or too short, a frequency is not in
        the input, or no point is left.

    """
    inputs = _record('input_', input_)
    outputs = _record('output', output)
    volts = inputs if voltage_v is None else _record('voltage_v', voltage_v)
    for name, values in (('output', outputs), ('voltage_v', volts)):
        if values.size != inputs.size:
            raise ValueError(f'{name} has {values.size} samples and input_ {inputs.size}')
    windows = excitation.windows if isinstance(excitation, Excitation) else tuple(excitation)
    if not windows:
        raise ValueError('excitation has no window')
    limits = amplifier or Amplifier()
    bad = ~(np.isfinite(inputs) & np.isfinite(outputs))
    stretches = []
    for window in windows:
        if not 0 <= window.start < window.stop <= inputs.size:
            raise ValueError(
                f'window {window.start} … {window.stop} at {window.fundamental_hz:g} Hz is not '
                f'inside the record of {inputs.size} samples')
        part = slice(window.start, window.stop)
        stretches.append(_evaluate(
            window, inputs[part], outputs[part], volts[part], sample_period_s, limits))
    response = _assemble(stretches, sample_period_s, distortion_limit)
    return dataclasses.replace(
        response, samples_lost=int(bad.sum()), losses=tuple(_losses(bad, windows)))


def _losses(bad: NDArray[np.bool_], windows: Sequence[Window]) -> list[str]:
    """Return which samples are lost, window by window, and outside of all of them."""
    outside = bad.copy()
    sentences = []
    for window in windows:
        lost = window.start + np.flatnonzero(bad[window.start:window.stop])
        outside[window.start:window.stop] = False
        if lost.size:
            low, high = window.frequency_hz.min(), window.frequency_hz.max()
            which = f'{low:g} Hz' if low == high else f'{low:g} … {high:g} Hz'
            sentences.append(
                f'{which}: {lost.size} of {window.stop - window.start} samples are lost, from '
                f'sample {lost[0]} to {lost[-1]} of the record')
    lost = np.flatnonzero(outside)
    if lost.size:
        sentences.append(
            f'outside of all frequencies: {lost.size} samples are lost, from sample {lost[0]} to '
            f'{lost[-1]} of the record, which costs no point')
    return sentences


class _Stretch(NamedTuple):
    """Points of one window, before they are judged by their distortion."""

    frequency_hz: NDArray[np.float64]  # (L,)
    response: NDArray[np.complex128]
    variance: NDArray[np.float64]
    coherence: NDArray[np.float64]
    amplitude: float
    offset: float
    distortion: float
    reason: str
    samples_used: int = 0


def _record(name: str, values: ArrayLike) -> NDArray[np.float64]:
    record = np.asarray(values, dtype=np.float64)
    if record.ndim != 1:
        raise ValueError(f'{name} has shape {record.shape}, it must be one-dimensional')
    return record


def _evaluate(
    window: Window, inputs: NDArray[np.float64], outputs: NDArray[np.float64],
    voltage_v: NDArray[np.float64], sample_period_s: float, limits: Amplifier,
) -> _Stretch:
    fundamental = window.fundamental_hz * sample_period_s  # turns per sample
    finite = inputs[np.isfinite(inputs)]
    peak = float(np.ptp(finite)) / 2.0 if finite.size else math.nan
    offset = float(finite.mean()) if finite.size else math.nan
    lines = np.array(window.lines, dtype=np.float64)
    extra = _detection_lines(window.lines, fundamental)
    signals = np.stack([inputs, outputs])
    reason, reached = limit_reached(voltage_v, limits, sample_period_s)
    if reason:
        signals = np.where(settled_samples(reached, 1.0 / fundamental), signals, np.nan)
    is_whole = bool(np.isfinite(signals).all())
    try:
        fit = fit_lines(
            signals, window.start, fundamental * np.concatenate([lines, extra]), 1.0 / fundamental)
    except ValueError as refusal:
        if is_whole:
            raise
        nothing = np.full(lines.size, np.nan)
        return _Stretch(
            window.frequency_hz, nothing.astype(np.complex128), nothing, nothing, peak, offset,
            math.nan, reason or str(refusal))
    count = lines.size
    x, y = fit.phasor[:, :count]
    uncertain = np.sqrt(fit.residual_variance[0] * fit.unit_variance[:count])
    for frequency_hz, size, error in zip(
            window.frequency_hz.tolist(), np.abs(x).tolist(), uncertain.tolist(), strict=True):
        if not size > max(5.0 * error, 1e-9 * peak):
            raise ValueError(
                f'the input does not contain {frequency_hz:g} Hz in samples {window.start} … '
                f'{window.stop}: its amplitude there is {size:.3g} +/- {error:.3g}, of {peak:.3g}')
    response = y / x
    variance, coherence = _confidence(fit, response, count)
    return _Stretch(
        window.frequency_hz, response, variance, coherence, peak, float(fit.mean[0]),
        _distortion(fit, count), '', fit.samples_used)


def _distortion(fit: LineFit, count: int) -> float:
    """Return the output at lines that are not excited, relative to that at the excited ones."""
    noise = fit.residual_variance[1] * fit.unit_variance[count:]
    extra = np.maximum(np.abs(fit.phasor[1, count:])**2 - noise, 0.0)
    if extra.size == 0:
        return 0.0
    wanted = float(np.mean(np.abs(fit.phasor[1, :count])**2))
    # All harmonics of a sine together; for a multisine the mean per line.
    unwanted = float(extra.sum() if count == 1 else extra.mean())
    return math.sqrt(unwanted / wanted) if wanted > 0.0 else math.inf


def _detection_lines(lines: tuple[int, ...], fundamental: float) -> NDArray[np.float64]:
    """Return lines that are not excited: harmonics of a sine, gaps of a multisine."""
    nyquist = math.ceil(0.5 / fundamental) - 1  # the highest line below it
    if len(lines) == 1:
        harmonics = lines[0] * np.arange(2, _HIGHEST_HARMONIC + 1)
        return np.asarray(harmonics[harmonics <= nyquist], dtype=np.float64)
    gaps = np.setdiff1d(np.arange(1, max(lines)), lines)
    chosen = np.linspace(0, gaps.size - 1, min(gaps.size, _MOST_DETECTION_LINES))
    return np.asarray(gaps[np.unique(np.round(chosen).astype(int))], dtype=np.float64)


def _confidence(
    fit: LineFit, response: NDArray[np.complex128], count: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return variance and coherence of the response."""
    x = fit.phasor[0, :count]
    power = np.abs(x)**2
    gain_squared = np.abs(response)**2
    variance = (
        (fit.residual_variance[1] + gain_squared * fit.residual_variance[0])
        * fit.unit_variance[:count] / power)
    groups = fit.deviation.shape[0]
    coherence = np.full(count, np.nan)
    if groups > 1:
        error = fit.deviation[:, 1, :count] - response * fit.deviation[:, 0, :count]
        scatter = groups / (groups - 1) * (fit.share**2 @ np.abs(error)**2) / power
        variance = np.maximum(variance, scatter)
        group_x = x + fit.deviation[:, 0, :count]
        group_y = fit.phasor[1, :count] + fit.deviation[:, 1, :count]
        cross = np.abs(np.sum(group_y * group_x.conj(), axis=0))**2
        coherence = cross / (
            np.sum(np.abs(group_x)**2, axis=0) * np.sum(np.abs(group_y)**2, axis=0))
    return np.maximum(variance, _RELATIVE_FLOOR**2 * gain_squared), coherence


def _assemble(
    stretches: list[_Stretch], sample_period_s: float, distortion_limit: float,
) -> FrequencyResponse:
    """Merge the windows that pass the limits; list the others with the reason."""
    kept: list[FrequencyResponse] = []
    excluded: list[ExcludedPoint] = []
    for stretch in stretches:
        distortion = stretch.distortion
        reason = stretch.reason
        if not reason and distortion > distortion_limit:
            reason = (
                f'distorted by {distortion:.3g} of the response, the limit is '
                f'{distortion_limit:.3g}: the amplifier may slew or saturate')
        if reason:
            excluded += [
                ExcludedPoint(value, stretch.amplitude, stretch.offset, reason)
                for value in stretch.frequency_hz.tolist()]
            continue
        size = stretch.frequency_hz.size
        kept.append(FrequencyResponse(
            stretch.frequency_hz, stretch.response, stretch.variance, stretch.coherence,
            np.full(size, distortion), np.full(size, stretch.amplitude),
            np.full(size, stretch.offset), sample_period_s, samples_used=stretch.samples_used))
    if not kept:
        raise ValueError(f'no point is left: {excluded[0].reason}')
    return dataclasses.replace(merge(kept), excluded=tuple(excluded))
