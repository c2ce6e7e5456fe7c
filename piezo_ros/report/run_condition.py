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
What a run says of itself beside its tracking error: whether the number may be believed.

A run is *unstable* if an oscillation of its own does not decay, or if it is conspicuous and the
loop of the gains and dynamics in its bag is unstable; *not settled* if the error still changes from
period to period; *slewing* or *at the rails* where the amplifier could not follow.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.changes import parse_changes, segments
from piezo_ros.model import LinearDynamics
from piezo_ros.parameters.roles import parameters_by_role
from piezo_ros.report.amplifier_use import amplifier_limits, limited_samples
from piezo_ros.report.settling import settling

__all__ = ['RunCondition', 'run_condition']

# Of a run with feedback: from here on the loop in the bag is asked whether it is stable. A limit
# cycle that locks into the reference repeats with it.
_CONSPICUOUS_NRMSE_PERCENT: Final = 25.0
_HIGH_HARMONIC: Final = 5
_HIGH_SHARE: Final = 0.5  # of the power of the error
_HIGH_NRMSE_PERCENT: Final = 5.0
_LEAST_SHOWN_PERCENT: Final = 0.1


class RunCondition(NamedTuple):
    """
    The condition of a run in its scored samples.

    Attributes
    ----------
    slewing_percent, rail_percent : float or None
        Share of the scored samples at which the amplifier slews, or is beyond a rail, percent; None
        where its limits are not known.
    change_percent : float or None
        RMS by which the displacement changes over half of the scored periods, percent of the
        peak-to-peak reference, without noise; None where the reference does not repeat.
    is_settled, is_stable : bool or None
        Verdicts; None where they cannot be told.

    """

    slewing_percent: float | None = None
    rail_percent: float | None = None
    change_percent: float | None = None
    is_settled: bool | None = None
    is_stable: bool | None = None

    @property
    def words(self) -> str:
        """The condition in words, 'ok' where there is nothing to say."""
        words = []
        if self.is_stable is False:
            words.append('unstable')
        elif self.is_settled is False:
            words.append('not settled')
        elif self.is_settled is None:
            words.append('settling not known')
        for name, percent in (
                ('slewing', self.slewing_percent), ('at the rails', self.rail_percent)):
            if percent:
                words.append(f'{name} {_percent_text(percent)}')
        if self.slewing_percent is None:
            words.append('limits not known')
        return ', '.join(words) or 'ok'

    def record(self) -> dict[str, str | float]:
        """Return it as entries of report.json; what is not known is left out."""
        numbers = {
            name: value for name in ('slewing_percent', 'rail_percent', 'change_percent')
            if (value := getattr(self, name)) is not None}
        return {'condition': self.words, **numbers}


def _percent_text(percent: float) -> str:
    if percent < _LEAST_SHOWN_PERCENT:
        return f'< {_LEAST_SHOWN_PERCENT} %'
    return f'{percent:.2g} %' if percent < 99.5 else '100 %'


def run_condition(
    parameters: Mapping[str, Mapping[str, Any]], *, reference_um: NDArray[np.float64],
    displacement_um: NDArray[np.float64], voltage_v: NDArray[np.float64], frequency_hz: float,
    sample_period_s: float, scored_periods: float, scored_samples: int, samples: int,
) -> RunCondition:
    """
    Return the condition of a run.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Node to parameters, as a bag has them; empty for a foreign one.
    reference_um, displacement_um, voltage_v : ndarray, shape (N,)
        The end of the run: the scored samples, and those before as far as they are there.
    frequency_hz : float
        Fundamental frequency of the reference, hertz.
    sample_period_s : float
        Sample period, seconds.
    scored_periods : float
        Periods that are scored.
    scored_samples : int
        How many of the samples, at the end, are scored.
    samples : int
        Length of the run.

    """
    roles = parameters_by_role(parameters)
    scored = slice(reference_um.size - scored_samples, None)
    slewing_percent = rail_percent = None
    limits = amplifier_limits(roles.get('plant') or roles.get('hardware_plant') or {})
    if limits is not None:
        at_rails, slewing = limited_samples(voltage_v, limits, sample_period_s)
        if limits.slew_limit_v_per_s is not None:
            slewing_percent = 100.0 * float(slewing[scored].mean())
        rail_percent = 100.0 * float(at_rails[scored].mean())
    found = settling(
        reference_um, displacement_um, 1.0 / (frequency_hz * sample_period_s), scored_periods)
    is_stable = None if found is None else found.is_stable
    if is_stable is not False and (
            slewing_percent or rail_percent
            or _is_conspicuous(reference_um[scored], displacement_um[scored], scored_periods)
            or (found is not None and not found.is_settled)) and _has_unstable_loop(roles, samples):
        is_stable = False
    return RunCondition(
        slewing_percent, rail_percent, None if found is None else found.change_percent,
        None if found is None else found.is_settled, is_stable)


def _is_conspicuous(
    reference_um: NDArray[np.float64], displacement_um: NDArray[np.float64], periods: float,
) -> bool:
    """Return whether the error is of a kind that an oscillation of the loop makes."""
    error_um = reference_um - displacement_um
    span_um = float(np.ptp(reference_um))
    power = np.abs(np.fft.rfft(error_um)) ** 2
    first_high = round(_HIGH_HARMONIC * periods)
    high_share = power[first_high:].sum() / max(power[1:].sum(), np.finfo(float).tiny)
    nrmse_percent = 100.0 * float(np.sqrt(np.mean(error_um**2))) / max(
        span_um, np.finfo(float).tiny)
    return nrmse_percent > _CONSPICUOUS_NRMSE_PERCENT or bool(
        nrmse_percent > _HIGH_NRMSE_PERCENT and high_share > _HIGH_SHARE)


def _has_unstable_loop(roles: Mapping[str, Mapping[str, Any]], samples: int) -> bool:
    """Return whether the loop of the gains and dynamics of a run is known to be unstable."""
    if not {'controller', 'trajectory'} <= roles.keys():
        return False
    try:
        trajectory = TrajectoryParameters.among(roles['trajectory'])
        law = segments(
            ControllerParameters.among(roles['controller']),
            parse_changes(roles['controller'].get('changes', '')), samples)[-1].law
    except ValueError:  # of foreign nodes
        return False
    if not law.uses_feedback:
        return False
    # Imported here: it costs a second, and few runs are conspicuous.
    from piezo_ros.identification.tuning.pi_loop import Lead, PiLoop
    if law.proportional_gain == law.integral_gain_per_s == 0.0:
        return False
    return not PiLoop.of(
        LinearDynamics(trajectory), law.proportional_gain, law.integral_gain_per_s,
        trajectory.sample_period_s, law.measurement_delay_samples, Lead.of(law)).is_stable
