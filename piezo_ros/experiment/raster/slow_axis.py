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
The motion of the slow axis: to the first line, then from line to line.

With the lines n = f Ts k since the start, n_0 of the first line, L lines over the size S and the
step s = S/(L - 1)::

    y_d = -S/2 - 3 s/4 + s (p^3 - p^4/2)         p = n - n_0 + 5/4 = 0 … 1
    y_d = -S/2 + s (n - n_0)                     n = n_0 - 1/4 … n_0 + L - 1/4
    y_d = S/2 + 3 s/4 + s (p - p^3 + p^4/2)      p = n - n_0 - L + 1/4 = 0 … 1

The fast axis is at the middle of its trace where n is a whole number, so that the middle of the
line i is at -S/2 + s i, and its trace begins a quarter of a line before. The line before it is that
in which the axis gathers speed; after the last retrace, where the run is over, it would come to
rest. At first it rests at 0, goes to where it begins as 35 q^4 - 84 q^5 + 70 q^6 - 20 q^7,
q = 0 … 1, and waits.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.tables.motion_table import MotionTable
from piezo_ros.experiment.planned_motion import planned_motion
from piezo_ros.experiment.planned_scan import limits_of
from piezo_ros.model import DynamicsParameters, HysteresisParameters, RigParameters

__all__ = [
    'LEAD_LINES', 'approach_samples', 'rest_samples', 'slow_motion', 'slow_reference_um',
]

_REST_SAMPLES: Final = 256  # more than any chain looks ahead
_TURNS_OF_SLOWEST_POLE: Final = 20.0
LEAD_LINES: Final = 1.25  # that the slow axis moves before the middle of the first trace
_TRACE_LINES: Final = 0.25  # from the begin of a trace to its middle
_WAIT_SHARE: Final = 0.5  # of the approach


def rest_samples(known: RigParameters, sample_period_s: float) -> int:
    """Return how long the slow axis rests at first: the chain of inverses looks ahead."""
    return _REST_SAMPLES + round(known.delay_s / sample_period_s)


def approach_samples(known: RigParameters, sample_period_s: float, approach_s: float = 0.0) -> int:
    """
    Return how many samples pass before the slow axis has come to the first line.

    Parameters
    ----------
    known : RigParameters
        What is known of its rig.
    sample_period_s : float
        Sample period, seconds.
    approach_s : float, optional
        How long it takes; 0 for twenty periods of the slowest pole.

    """
    rates = [*known.rates_rad_per_s, *(frequency for frequency, _ in known.pole_pairs)]
    approach_s = approach_s or _TURNS_OF_SLOWEST_POLE * 2.0 * math.pi / min(rates)
    return rest_samples(known, sample_period_s) + math.ceil(
        (1.0 + _WAIT_SHARE) * approach_s / sample_period_s)


def slow_reference_um(
    samples: int, lines: int, size_um: float, lines_per_sample: float, first_line: int,
    rest: int,
) -> NDArray[np.float64]:
    """
    Return the reference of the slow axis.

    Parameters
    ----------
    samples : int
        Samples N of the run.
    lines : int
        Lines of the image.
    size_um : float
        From the first line to the last.
    lines_per_sample : float
        Lines, to and fro, in a sample period.
    first_line : int
        Lines of the fast axis before the first one of the image.
    rest : int
        Samples at the begin in which the axis stays at 0.

    Returns
    -------
    ndarray, shape (N,)
        The reference, micrometres.

    Examples
    --------
    >>> y_um = slow_reference_um(1000, 5, 4.0, 0.01, 4, 10)
    >>> [round(float(y_um[100 * line]), 12) for line in range(3, 10)]
    [-2.736328125, -2.0, -1.0, 0.0, 1.0, 2.0, 2.986328125]

    """
    turns = lines_per_sample * np.arange(samples)
    step_um = size_um / (lines - 1)
    start_um = -0.5 * size_um - (LEAD_LINES - 0.5) * step_um
    begin = (first_line - LEAD_LINES) / lines_per_sample
    q = np.clip(
        (np.arange(samples) - rest) * (1.0 + _WAIT_SHARE) / max(begin - rest, 1.0), 0.0, 1.0)
    approach = q**4 * (35.0 - q * (84.0 - q * (70.0 - 20.0 * q)))
    p = np.clip(turns - (first_line - LEAD_LINES), 0.0, 1.0)
    last = first_line + lines - _TRACE_LINES
    after = np.clip(turns - last, 0.0, 1.0)
    steady = np.minimum(turns, last) - first_line
    return np.asarray(np.where(
        p < 1.0, start_um * approach + step_um * p**3 * (1.0 - 0.5 * p),
        step_um * (steady + after - after**3 * (1.0 - 0.5 * after)) - 0.5 * size_um))


def slow_motion(
    reference_um: NDArray[np.float64], samples: int, sample_period_s: float, known: RigParameters,
    *, preview: bool,
) -> MotionTable:
    """
    Return the motion of the slow axis as a table for the trajectory.

    Parameters
    ----------
    reference_um : ndarray, shape (M,)
        As `slow_reference_um` returns it, until the axis is at rest again.
    samples : int
        Samples N of the run, fewer: the axis need not be at rest at its end.
    sample_period_s : float
        Sample period, seconds.
    known : RigParameters
        What is known of its rig.
    preview : bool
        Whether the commands come from the chain of inverses, see `planned_motion`; else the
        trajectory makes them of the reference.

    Raises
    ------
    ValueError
        If the motion asks for more than the amplifier has.

    """
    if not preview:
        return MotionTable(reference_um[:samples], None, sample_period_s)
    values = known.to_mapping()
    planned = planned_motion(
        MotionTable(reference_um, None, sample_period_s), DynamicsParameters.among(values),
        HysteresisParameters.among(values), limits_of(known), known.average_slew_time_s)
    # The chain answers later; the axis rests at first, and the fast one does not wait for it.
    late = planned.table
    assert late.command_um is not None
    if late.command_um[:planned.latency].any():
        raise ValueError(
            f'the slow axis moves within its first {planned.latency} samples, which the chain of '
            'inverses looks ahead')
    kept = slice(planned.latency, planned.latency + samples)
    return MotionTable(
        reference_um[:samples], late.command_um[kept].copy(), sample_period_s)
