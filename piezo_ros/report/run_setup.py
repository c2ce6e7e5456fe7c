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
"""What a report says of a run beside its scores: gains, amplifier, date, and its first periods."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import Recording, Run
from piezo_ros.bag.recording_date import recorded_utc
from piezo_ros.parameters.roles import parameters_by_role
from piezo_ros.report.amplifier_use import AmplifierLimits, amplifier_limits

__all__ = ['RunSetup', 'RunStart', 'run_setup', 'run_start']

_SHOWN_PERIODS: Final = 4


class RunSetup(NamedTuple):
    """
    How a run was made.

    Attributes
    ----------
    proportional_gain, integral_gain_per_s : float or None
        Gains kP and kI (1/s) of the controller at its start; None where they are not known, or
        where the scheme has no feedback.
    changes : str
        Changes of the controller during the run, as its parameter has them; empty without any.
    limits : AmplifierLimits or None
        Limits of the amplifier; None where they are not known.
    recorded : str
        Day and time of the first sample, UTC; empty for a simulation without a clock.

    """

    proportional_gain: float | None = None
    integral_gain_per_s: float | None = None
    changes: str = ''
    limits: AmplifierLimits | None = None
    recorded: str = ''


@dataclass(frozen=True)
class RunStart:
    """
    The first periods of a run.

    Attributes
    ----------
    time_s, reference_um, displacement_um, voltage_v : ndarray, shape (n,)
        From the first sample on.

    """

    time_s: NDArray[np.float64] = field(repr=False)
    reference_um: NDArray[np.float64] = field(repr=False)
    displacement_um: NDArray[np.float64] = field(repr=False)
    voltage_v: NDArray[np.float64] = field(repr=False)


def run_setup(run: Run | Recording, scheme: str) -> RunSetup:
    """
    Return how a run was made, as far as its bag tells.

    Parameters
    ----------
    run : piezo_ros.bag.Run or piezo_ros.bag.Recording
        The run.
    scheme : str
        Its control scheme.

    """
    roles = parameters_by_role(run.parameters)
    controller = roles.get('controller', {})
    has_feedback = scheme in ('fb', 'fbff')
    return RunSetup(
        proportional_gain=_number(controller, 'proportional_gain') if has_feedback else None,
        integral_gain_per_s=_number(controller, 'integral_gain_per_s') if has_feedback else None,
        changes=str(controller.get('changes', '')),
        limits=amplifier_limits(roles.get('plant') or roles.get('hardware_plant') or {}),
        recorded=recorded_utc(run.path))


def run_start(run: Run | Recording, frequency_hz: float, *, before: int) -> RunStart | None:
    """
    Return the first periods of a run, where they are not a part of what is scored.

    Parameters
    ----------
    run : piezo_ros.bag.Run or piezo_ros.bag.Recording
        The run.
    frequency_hz : float
        Fundamental frequency, hertz.
    before : int
        Samples before the scored window.

    Returns
    -------
    RunStart or None
        At most four periods; None where the scored window begins before their end.

    """
    samples = math.ceil(_SHOWN_PERIODS / (frequency_hz * run.sample_period_s))
    if before < samples:
        return None
    part = run.part(0, samples)
    return RunStart(*(
        np.array(getattr(part, name), dtype=np.float64)
        for name in ('time_s', 'reference_um', 'displacement_um', 'voltage_v')))


def _number(parameters: Mapping[str, Any], name: str) -> float | None:
    value = parameters.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
