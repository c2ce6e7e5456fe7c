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
Images of a raster scan: where the tip really was at the time of each pixel.

A pixel of a line is recorded when the *reference* of the fast axis passes its place; its height is
that of the sample at the *displacement* then. The lines on which the reference rises give the
trace, the others the retrace. Of each line its central part is taken, the turns are left out.

The frame consists of those consecutive lines between which the slow reference goes on in one
direction by even steps: not of those of an approach, a rest, or the way back. Of several frames the
longest is taken, of equal ones the first.
"""

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.imaging.synthetic_sample import SyntheticSample

__all__ = ['RasterImages', 'raster_images']

_LEAST_LINES: Final = 2
_UNEVEN: Final = 0.05  # how far a step of the slow axis may be off the one before
_UNEVEN_SAMPLES: Final = 4.0  # and so many samples more: lines begin at whole ones
_SLOW_SHARE: Final = 0.01  # of the travel of the slow axis, that it goes from line to line
_STANDSTILL: Final = 1e-9  # of the travel of the slow axis

_Floats = NDArray[np.float64]
_Line = tuple[int, int]  # first and last sample


@dataclass(frozen=True)
class RasterImages:
    """
    Positions of the tip at every pixel of L lines of N pixels.

    Attributes
    ----------
    nominal_x_um : ndarray, shape (N,)
        Places of the pixels on a line.
    nominal_y_um : ndarray, shape (L,)
        Places of the lines: reference of the slow axis, mean over the trace.
    trace_x_um, trace_y_um, retrace_x_um, retrace_y_um : ndarray, shape (L, N)
        Displacements at the times of the pixels; the retrace is from left to right too.
    trace_wanted_y_um, retrace_wanted_y_um : ndarray, shape (L, N)
        Reference of the slow axis at the times of the pixels: a slow axis that goes on steadily
        moves during a line.
    travel_um : float
        Travel of the fast reference on a line, turns included.
    samples : tuple of int
        First and last sample of the frame.

    """

    nominal_x_um: _Floats
    nominal_y_um: _Floats
    trace_x_um: _Floats
    trace_y_um: _Floats
    retrace_x_um: _Floats
    retrace_y_um: _Floats
    trace_wanted_y_um: _Floats
    retrace_wanted_y_um: _Floats
    travel_um: float
    samples: tuple[int, int]

    @property
    def pixel_um(self) -> float:
        """Width of a pixel."""
        return float(self.nominal_x_um[1] - self.nominal_x_um[0])

    @property
    def line_um(self) -> float:
        """Distance of the lines."""
        return float(np.mean(np.abs(np.diff(self.nominal_y_um))))

    @property
    def trace_deviation_px(self) -> tuple[_Floats, _Floats]:
        """Displacement less reference of the trace along x, in pixels, and along y, in lines."""
        return (
            (self.trace_x_um - self.nominal_x_um[None, :]) / self.pixel_um,
            (self.trace_y_um - self.trace_wanted_y_um) / self.line_um)

    @property
    def retrace_deviation_px(self) -> tuple[_Floats, _Floats]:
        """The same of the retrace."""
        return (
            (self.retrace_x_um - self.nominal_x_um[None, :]) / self.pixel_um,
            (self.retrace_y_um - self.retrace_wanted_y_um) / self.line_um)

    def ideal(self, sample: SyntheticSample) -> _Floats:
        """Return the trace of stages without any error, shape (L, N), micrometres of height."""
        return sample.height_um(self.nominal_x_um[None, :], self.trace_wanted_y_um)

    def trace(self, sample: SyntheticSample) -> _Floats:
        """Return the image of the lines on which the reference rises, shape (L, N)."""
        return sample.height_um(self.trace_x_um, self.trace_y_um)

    def retrace(self, sample: SyntheticSample) -> _Floats:
        """Return the image of the lines on which the reference falls, shape (L, N)."""
        return sample.height_um(self.retrace_x_um, self.retrace_y_um)


def raster_images(
    fast_reference_um: _Floats, fast_displacement_um: _Floats,
    slow_reference_um: _Floats, slow_displacement_um: _Floats,
    *, pixels: int = 256, central: float = 0.8,
) -> RasterImages:
    """
    Return where the tip was at every pixel of a raster scan.

    Parameters
    ----------
    fast_reference_um, fast_displacement_um : ndarray, shape (K,)
        The axis that goes to and fro on each line.
    slow_reference_um, slow_displacement_um : ndarray, shape (K,)
        The axis that goes from line to line, on the same samples.
    pixels : int, optional
        Pixels N of a line.
    central : float, optional
        Share of a line that is taken, above 0 and up to 1.

    Raises
    ------
    ValueError
        If the streams differ in length or are not finite, if the fast reference has fewer than
        two whole lines, or if the slow one does not go from line to line.

    """
    _check(
        fast_reference_um, fast_displacement_um, slow_reference_um, slow_displacement_um,
        pixels, central)
    pairs = _pairs(fast_reference_um)
    centres_um = np.array([
        float(np.mean(slow_reference_um[trace[0]:trace[1] + 1])) for trace, _ in pairs])
    line_samples = float(np.median([back[1] - trace[0] for trace, back in pairs]))
    pairs = pairs[_frame(
        centres_um, float(np.ptp(slow_reference_um)), _UNEVEN + _UNEVEN_SAMPLES / line_samples)]
    low_um, high_um = _ends(fast_reference_um, pairs)
    half_um = 0.5 * central * (high_um - low_um)
    places_um = 0.5 * (high_um + low_um) + half_um * (
        2.0 * (np.arange(pixels) + 0.5) / pixels - 1.0)
    # Lines of a soft start, or cut by an end of the record, do not reach all pixels.
    pairs = _enough([pair for pair in pairs if _reaches(fast_reference_um, pair, places_um)])
    trace_times, retrace_times = (
        np.array([_line_times(fast_reference_um, pair[which], places_um) for pair in pairs])
        for which in (0, 1))
    samples = np.arange(fast_reference_um.size, dtype=np.float64)

    def at(times: _Floats, values: _Floats) -> _Floats:
        return np.asarray(np.interp(times, samples, values))

    wanted_y_um = at(trace_times, slow_reference_um)
    return RasterImages(
        nominal_x_um=places_um,
        nominal_y_um=wanted_y_um.mean(axis=1),
        trace_x_um=at(trace_times, fast_displacement_um),
        trace_y_um=at(trace_times, slow_displacement_um),
        retrace_x_um=at(retrace_times, fast_displacement_um),
        retrace_y_um=at(retrace_times, slow_displacement_um),
        trace_wanted_y_um=wanted_y_um,
        retrace_wanted_y_um=at(retrace_times, slow_reference_um),
        travel_um=high_um - low_um, samples=(pairs[0][0][0], pairs[-1][1][1]))


def _check(
    fast_reference_um: _Floats, fast_displacement_um: _Floats, slow_reference_um: _Floats,
    slow_displacement_um: _Floats, pixels: int, central: float,
) -> None:
    streams = {
        'fast reference': fast_reference_um, 'fast displacement': fast_displacement_um,
        'slow reference': slow_reference_um, 'slow displacement': slow_displacement_um}
    if len({stream.shape for stream in streams.values()}) != 1:
        raise ValueError(
            'fast and slow reference and displacement have '
            f'{", ".join(str(stream.size) for stream in streams.values())} samples, they must have '
            'as many')
    if pixels < 2:
        raise ValueError(f'pixels is {pixels}, it must be 2 at least')
    if not 0.0 < central <= 1.0:
        raise ValueError(f'central is {central}, allowed is above 0 … 1')
    for name, values in streams.items():
        finite = np.isfinite(values)
        if not finite.all():
            place = int(np.argmin(finite))
            raise ValueError(f'{name} is {values[place]} at sample {place}, it must be finite')


def _pairs(reference_um: _Floats) -> list[tuple[_Line, _Line]]:
    """Return every rising line with the falling one that follows, as samples."""
    extremes = _extremes(reference_um)
    lines = list(itertools.pairwise(extremes))
    pairs = [
        (trace, back) for trace, back in itertools.pairwise(lines)
        if reference_um[trace[1]] > reference_um[trace[0]]]
    return _enough(pairs)


def _enough(pairs: list[tuple[_Line, _Line]]) -> list[tuple[_Line, _Line]]:
    if len(pairs) < _LEAST_LINES:
        raise ValueError(
            f'the fast reference holds {len(pairs)} whole lines, at least {_LEAST_LINES} are '
            'needed: it must be that of the axis that goes to and fro on each line')
    return pairs


def _reaches(reference_um: _Floats, pair: tuple[_Line, _Line], places_um: _Floats) -> bool:
    """Return whether a trace and its retrace pass all pixels."""
    (start, top), (_, stop) = pair
    return bool(
        max(reference_um[start], reference_um[stop]) <= places_um[0]
        and reference_um[top] >= places_um[-1])


def _extremes(reference_um: _Floats) -> list[int]:
    """Return the samples of the turns; what turns back within an eighth of the travel is none."""
    low_um, high_um = _levels(reference_um)
    side = np.where(reference_um > high_um, 1, np.where(reference_um < low_um, -1, 0))
    beyond = np.flatnonzero(side)
    if not beyond.size:
        return []
    changes = np.flatnonzero(np.diff(side[beyond])) + 1
    groups = np.split(beyond, changes)
    # The first and the last may be cut off by the ends of the record.
    found = [
        group[0] + int(np.argmax(side[group[0]] * reference_um[group[0]:group[-1] + 1]))
        for group in groups]
    return [int(sample) for sample in found]


def _levels(reference_um: _Floats) -> tuple[float, float]:
    """Return two levels about the usual middle of a line, an eighth of its travel off each."""
    # Most of the time is spent on lines: an approach counts for little.
    low_um, high_um = np.quantile(reference_um, [0.05, 0.95])
    middle_um, reach_um = 0.5 * (low_um + high_um), 0.125 * (high_um - low_um)
    return float(middle_um - reach_um), float(middle_um + reach_um)


def _ends(reference_um: _Floats, pairs: list[tuple[_Line, _Line]]) -> tuple[float, float]:
    """Return between which places all lines go."""
    starts_um = reference_um[[trace[0] for trace, _ in pairs]]
    backs_um = reference_um[[back[1] for _, back in pairs]]
    tops_um = reference_um[[trace[1] for trace, _ in pairs]]
    return float(np.median(np.concatenate([starts_um, backs_um]))), float(np.median(tops_um))


def _frame(centres_um: _Floats, travel_um: float, uneven: float) -> slice:
    """Return which consecutive lines the slow axis goes through in one direction, evenly."""
    steps_um = np.diff(centres_um)
    moves = np.abs(steps_um) > _STANDSTILL * float(np.ptp(centres_um))
    # Whether a step goes on as the one before.
    sizes_um = np.abs(steps_um)
    goes_on = moves[1:] & moves[:-1] & (
        np.abs(np.diff(steps_um)) < uneven * np.minimum(sizes_um[1:], sizes_um[:-1]))
    best = (0, 0)
    first = 0
    for place in range(1, steps_um.size + 1):
        if place == steps_um.size or not goes_on[place - 1]:
            if moves[first] and place - first > best[1] - best[0]:
                best = (first, place)
            first = place
    # Another fast axis moves within its lines; rounding alone makes its lines differ.
    if best == (0, 0) or np.ptp(centres_um) < _SLOW_SHARE * travel_um:
        raise ValueError(
            'the slow reference does not go from line to line: it stays within '
            f'{float(np.ptp(centres_um)):.3g} um, so that there is no image')
    return slice(best[0], best[1] + 1)


def _line_times(reference_um: _Floats, line: _Line, places_um: _Floats) -> _Floats:
    """Return when a line passes the places, in samples."""
    start, stop = line
    index = np.arange(start, stop + 1, dtype=np.float64)
    values_um = reference_um[start:stop + 1]
    if values_um[-1] > values_um[0]:
        return np.asarray(np.interp(places_um, np.maximum.accumulate(values_um), index))
    falling_um = np.minimum.accumulate(values_um)
    return np.asarray(np.interp(places_um, falling_um[::-1], index[::-1]))
