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
A measured frequency response as CSV, with the points that were left out, and back.

Each column has one unit, which its name says; the response is told by gain and phase, to be looked
at, and by its real and imaginary part, to be read back.

Without a standard error in the table, it is estimated from the error e_k of the cubic through the
two points before and the two behind, in log(frequency), with the weights w of these four::

    |H_k|^2 r^2 = median over 9 points of |e_k|^2 / (1 + sum w^2) / ln 2

A table that is no sampled record is turned into the response behind a hold of a sample period that
is short against every frequency, so that it can be fitted like a recorded one.
"""

import csv
import io
import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from piezo_ros.identification.response.frequency_response import (
    ExcludedPoint,
    FrequencyResponse,
)
from piezo_ros.identification.response.response_table import ResponseTable, parse_table

__all__ = ['read_response', 'response_csv']

_DEFAULT_ERROR: Final = 0.01  # relative, of tables too short to estimate it
_LEAST_ERROR: Final = 1e-4  # relative, where it is estimated
_LEAST_POINTS: Final = 9
# Equivalent sample period of a continuous response, times the highest frequency: aliases of 1e-6.
_PERIOD_SHARE: Final = 1e-3


def response_csv(response: FrequencyResponse) -> str:
    """
    Return a frequency response as CSV, all digits kept.

    Parameters
    ----------
    response : FrequencyResponse
        The points.

    Returns
    -------
    str
        One line per point, in order of frequency: gain, phase (degrees), real and imaginary part
        and their standard error (micrometres per unit of the input), coherence (empty where there
        was one group of periods only), distortion, amplitude, offset and sample period; for a point
        left out the reason.

    """
    unit = response.input_unit
    ratio = f'um_per_{unit}'
    header = (
        'frequency_hz', f'gain_{ratio}', 'phase_deg', f'real_{ratio}', f'imaginary_{ratio}',
        f'standard_error_{ratio}', 'coherence', 'distortion', f'amplitude_{unit}',
        f'offset_{unit}', 'sample_period_s', 'left_out')
    rows: list[tuple[float | str, ...]] = [
        (*(_number(value) for value in values), response.sample_period_s, '') for values in zip(
            response.frequency_hz, np.abs(response.response),
            np.angle(response.response, deg=True), response.response.real, response.response.imag,
            response.standard_error, response.coherence, response.distortion, response.amplitude,
            response.offset, strict=True)]
    rows += [
        (point.frequency_hz, *[''] * 7, _number(point.amplitude), _number(point.offset),
         response.sample_period_s, point.reason)
        for point in response.excluded]
    rows.sort(key=_frequency)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def read_response(path: Path | str, *, sample_period_s: float | None = None) -> FrequencyResponse:
    """
    Read a frequency response from what `response_csv` wrote, or from another table.

    Parameters
    ----------
    path : Path or str
        The file. Columns are separated by comma, semicolon, tab or blanks and named by a header;
        the response is real and imaginary part, or magnitude (linear or dB) and phase (degrees or
        radians). Touchstone files are read too.
    sample_period_s : float, optional
        Sample period of the record that the response was made of, behind a zero-order hold; by
        default that in the file. Without one the response is that of the continuous stage, without
        hold, and is turned into that behind a hold of a very short sample period.

    Returns
    -------
    FrequencyResponse
        The points; `notes` says what has been assumed of them.

    Raises
    ------
    ValueError
        If the table cannot be read; the message names file, line, column, value and what is
        allowed.
    OSError
        If there is no such file.

    """
    path = Path(path)
    try:
        text = path.read_text(encoding='utf-8')
    except UnicodeDecodeError as error:
        raise ValueError(f'{path} is no text: {error}') from None
    table = parse_table(text, str(path))
    columns = table.columns
    period_s = sample_period_s or _sample_period_s(table, str(path))
    response = columns['real'] + 1j * columns['imaginary']
    reasons = _reasons(columns['frequency'], response, period_s, table)
    used = np.array([not reason for reason in reasons])
    order = np.flatnonzero(used)[np.argsort(columns['frequency'][used], kind='stable')]
    if not order.size:
        raise ValueError(f'{path} has no point that can be used: {reasons[0]}')
    frequency_hz, response = columns['frequency'][order], response[order]
    notes: list[str] = []
    variance = _variance(columns, order, frequency_hz, response, str(path), notes)
    amplitude, offset = (_column(columns, key, np.arange(used.size)) for key in (
        'amplitude', 'offset'))
    if not period_s:
        period_s = _PERIOD_SHARE / float(frequency_hz[-1])
        turn = 1j * np.pi * frequency_hz * period_s
        response = response * np.exp(-turn) * np.sinc(frequency_hz * period_s)
        notes.append(
            'the response is taken as that of the continuous stage, and fitted as that behind a '
            f'hold of {period_s:.3g} s; --sample-period-s tells that of a sampled record')
    return FrequencyResponse(
        frequency_hz, response, variance, _column(columns, 'coherence', order),
        np.nan_to_num(_column(columns, 'distortion', order)), amplitude[order], offset[order],
        period_s,
        excluded=tuple(
            point for point in map(
                ExcludedPoint, columns['frequency'].tolist(), amplitude.tolist(),
                offset.tolist(), reasons) if point.reason),
        input_unit=table.input_unit or 'um', notes=tuple(notes))


def _column(
    columns: dict[str, NDArray[np.float64]], key: str, order: NDArray[np.intp],
) -> NDArray[np.float64]:
    return columns[key][order] if key in columns else np.full(order.size, np.nan)


def _reasons(
    frequency_hz: NDArray[np.float64], response: NDArray[np.complex128], period_s: float,
    table: ResponseTable,
) -> list[str]:
    """Return why a point cannot be used, '' for those that can."""
    reasons = []
    for hertz, value, line, reason in zip(
            frequency_hz.tolist(), response.tolist(), table.lines, table.left_out, strict=True):
        if not reason and not (math.isfinite(value.real) and math.isfinite(value.imag)):
            reason = f'the response in line {line} is not finite'
        elif not reason and hertz == 0.0:
            reason = 'a response at 0 Hz is the one of a very slow run, in which the stage creeps'
        elif not reason and period_s and hertz >= 0.5 / period_s:
            reason = (
                f'not below the Nyquist frequency {0.5 / period_s:g} Hz of the sample period '
                f'{period_s:g} s')
        reasons.append(reason)
    return reasons


def _sample_period_s(table: ResponseTable, name: str) -> float:
    periods = np.unique(table.columns.get('sample_period', np.zeros(0)))
    periods = periods[np.isfinite(periods)]
    if periods.size > 1:
        raise ValueError(
            f'{name} has the sample periods {", ".join(f"{each:g}" for each in periods)} s, '
            'allowed is one')
    period_s = float(periods[0]) if periods.size else table.sample_period_s
    if period_s < 0.0:
        raise ValueError(f'{name}: the sample period is {period_s:g} s, it must be above 0')
    return period_s


def _variance(
    columns: dict[str, NDArray[np.float64]], order: NDArray[np.intp],
    frequency_hz: NDArray[np.float64], response: NDArray[np.complex128], name: str,
    notes: list[str],
) -> NDArray[np.float64]:
    """Return E|error|^2 of the points, as the table says it or by how smooth they are."""
    if 'standard_error' in columns or 'confidence_radius' in columns:
        told = (
            2.0 * columns['standard_error']**2 if 'standard_error' in columns
            else columns['confidence_radius']**2 / -math.log(0.05))[order]
        wrong = ~(told >= 0.0) | ~np.isfinite(told)
        if wrong.any():
            raise ValueError(
                f'{name}: the standard error at {frequency_hz[np.argmax(wrong)]:g} Hz is missing '
                'or not finite, it must be at least 0')
        floor = (1e-9 * np.abs(response))**2
        return np.maximum(told, floor)
    estimate = _smoothness(frequency_hz, response)
    if estimate is None:
        notes.append(
            f'no standard error is told, and {frequency_hz.size} points are too few to estimate '
            f'it: {100.0 * _DEFAULT_ERROR:g} % of the response is assumed')
        return np.asarray(2.0 * (_DEFAULT_ERROR * np.abs(response))**2)
    notes.append(
        'no standard error is told: it is estimated by how smooth the response is, as '
        f'{100.0 * float(np.median(estimate)):.2g} % of the response')
    return np.asarray(2.0 * (estimate * np.abs(response))**2)


def _smoothness(
    frequency_hz: NDArray[np.float64], response: NDArray[np.complex128],
) -> NDArray[np.float64] | None:
    """Return the relative standard error by the deviation from neighbours; None if too few."""
    distinct = np.flatnonzero(np.diff(frequency_hz, prepend=0.0) > 0.0)
    if distinct.size < _LEAST_POINTS:
        return None
    place, value = np.log(frequency_hz[distinct]), response[distinct]
    squares = np.full(distinct.size, np.nan)
    for k in range(2, distinct.size - 2):
        near = np.array([k - 2, k - 1, k + 1, k + 2])
        apart = place[near] - place[k]
        weight = np.array([
            np.prod(np.delete(apart, i) / (np.delete(apart, i) - apart[i])) for i in range(4)])
        error = value[k] - weight @ value[near]
        squares[k] = abs(error)**2 / (1.0 + weight @ weight) / max(abs(value[k])**2, 1e-300)
    squares[:2], squares[-2:] = squares[2], squares[-3]
    local = median_filter(squares, size=_LEAST_POINTS, mode='nearest') / math.log(2.0)
    relative = np.maximum(np.sqrt(0.5 * local), _LEAST_ERROR)
    return np.asarray(np.interp(frequency_hz, frequency_hz[distinct], relative))


def _frequency(row: tuple[float | str, ...]) -> float:
    return float(row[0])


def _number(value: float) -> float | str:
    return float(value) if np.isfinite(value) else ''
