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
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.imaging.synthetic_sample import SyntheticSample

__all__ = ['RasterImages', 'raster_images']

_LEAST_LINES: Final = 2


@dataclass(frozen=True)
class RasterImages:
    """
    Positions of the tip at every pixel of L lines of N pixels.

    Attributes
    ----------
    nominal_x_um : ndarray, shape (N,)
        Places of the pixels on a line.
    nominal_y_um : ndarray, shape (L,)
        Places of the lines: reference of the slow axis at the centre of the trace.
    trace_x_um, trace_y_um, retrace_x_um, retrace_y_um : ndarray, shape (L, N)
        Displacements at the times of the pixels; the retrace is from left to right too.

    """

    nominal_x_um: NDArray[np.float64]
    nominal_y_um: NDArray[np.float64]
    trace_x_um: NDArray[np.float64]
    trace_y_um: NDArray[np.float64]
    retrace_x_um: NDArray[np.float64]
    retrace_y_um: NDArray[np.float64]

    @property
    def pixel_um(self) -> float:
        """Width of a pixel."""
        return float(self.nominal_x_um[1] - self.nominal_x_um[0])

    @property
    def line_um(self) -> float:
        """Distance of the lines."""
        return float(self.nominal_y_um[1] - self.nominal_y_um[0])

    def ideal(self, sample: SyntheticSample) -> NDArray[np.float64]:
        """Return the image without any error, shape (L, N), micrometres of height."""
        return sample.height_um(self.nominal_x_um[None, :], self.nominal_y_um[:, None])

    def trace(self, sample: SyntheticSample) -> NDArray[np.float64]:
        """Return the image of the lines on which the reference rises, shape (L, N)."""
        return sample.height_um(self.trace_x_um, self.trace_y_um)

    def retrace(self, sample: SyntheticSample) -> NDArray[np.float64]:
        """Return the image of the lines on which the reference falls, shape (L, N)."""
        return sample.height_um(self.retrace_x_um, self.retrace_y_um)


def raster_images(
    fast_reference_um: NDArray[np.float64], fast_displacement_um: NDArray[np.float64],
    slow_reference_um: NDArray[np.float64], slow_displacement_um: NDArray[np.float64],
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
        If the streams differ in length, or hold fewer than two whole lines.

    """
    streams = (
        fast_reference_um, fast_displacement_um, slow_reference_um, slow_displacement_um)
    if len({stream.shape for stream in streams}) != 1:
        raise ValueError(
            'fast and slow reference and displacement have '
            f'{", ".join(str(stream.size) for stream in streams)} samples, they must have as many')
    if pixels < 2:
        raise ValueError(f'pixels is {pixels}, it must be 2 at least')
    if not 0.0 < central <= 1.0:
        raise ValueError(f'central is {central}, allowed is above 0 … 1')
    half_um = 0.5 * central * float(np.ptp(fast_reference_um))
    middle_um = 0.5 * float(fast_reference_um.max() + fast_reference_um.min())
    places_um = middle_um + half_um * (2.0 * (np.arange(pixels) + 0.5) / pixels - 1.0)
    times = _line_times(fast_reference_um, places_um)
    traces, retraces = times[True], times[False]
    # A line is a trace with the retrace that follows.
    lines = [
        (trace, next((back for back in retraces if back[-1] > trace[-1]), None))
        for trace in traces]
    pairs = [(trace, back) for trace, back in lines if back is not None]
    if len(pairs) < _LEAST_LINES:
        raise ValueError(
            f'the fast reference holds {len(pairs)} whole lines, at least {_LEAST_LINES} are '
            'needed')
    trace_times, retrace_times = (
        np.array([pair[which] for pair in pairs]) for which in (0, 1))
    samples = np.arange(fast_reference_um.size, dtype=np.float64)

    def at(times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(times, samples, values))

    return RasterImages(
        nominal_x_um=places_um,
        nominal_y_um=at(trace_times.mean(axis=1), slow_reference_um),
        trace_x_um=at(trace_times, fast_displacement_um),
        trace_y_um=at(trace_times, slow_displacement_um),
        retrace_x_um=at(retrace_times, fast_displacement_um),
        retrace_y_um=at(retrace_times, slow_displacement_um))


def _line_times(
    reference_um: NDArray[np.float64], places_um: NDArray[np.float64],
) -> dict[bool, list[NDArray[np.float64]]]:
    """Return when each rising and each falling line passes the places, in samples."""
    rises = np.diff(reference_um) > 0.0
    turns = np.flatnonzero(rises[1:] != rises[:-1]) + 1
    found: dict[bool, list[NDArray[np.float64]]] = {True: [], False: []}
    for start, stop in zip([0, *turns.tolist()], [*turns.tolist(), rises.size], strict=True):
        line = reference_um[start:stop + 1]
        if line.min() > places_um[0] or line.max() < places_um[-1]:
            continue
        ascends = bool(line[-1] > line[0])
        index = np.arange(start, stop + 1, dtype=np.float64)
        order = slice(None) if ascends else slice(None, None, -1)
        found[ascends].append(np.interp(places_um, line[order], index[order]))
    return found
