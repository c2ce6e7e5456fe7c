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
What feedback beside a planned scan makes of its error.

With the delays aligned, e[k] = y_d[k-d] - y[k-d], and S = 1/(1 + K G z^-d) over the harmonics,

    y_d - y = S (y_d - y_ff)

of the displacement y_ff that the feedforward alone would give. Where the amplifier keeps y_ff from
y_d, K works in vain on the difference and costs slew. It then compares with the planned output y_p,

    y = S y_ff + (1 - S) y_p

by a command that has K(z) z^-d (y_p - y_d) beside the feedforward.
"""

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import ControllerParameters
from piezo_ros.control.controller_step import lead_coefficients
from piezo_ros.control.pi_controller import PiController
from piezo_ros.planning.periodic_stage import PeriodicStage

__all__ = ['check_aligned', 'feedback_command_um', 'filtered', 'periodic_sensitivity']

_UNLIMITED_UM = 1e4

_Floats = NDArray[np.float64]
_Complexes = NDArray[np.complex128]


def check_aligned(law: ControllerParameters) -> None:
    """
    Refuse a controller that works against a feedforward that is right.

    Raises
    ------
    ValueError
        If its scheme is not fbff, or its delays differ.

    """
    if law.scheme != 'fbff':
        raise ValueError(f'scheme is {law.scheme!r}, beside a planned scan allowed is ff or fbff')
    if law.reference_delay_samples != law.measurement_delay_samples:
        raise ValueError(
            f'reference_delay_samples is {law.reference_delay_samples}, beside a planned scan it '
            f'must equal measurement_delay_samples, {law.measurement_delay_samples}')


def periodic_sensitivity(
    stage: PeriodicStage, law: ControllerParameters, sample_period_s: float,
) -> _Complexes:
    """
    Return S at the harmonics of the samples after which a scan repeats, shape (P//2 + 1,).

    Parameters
    ----------
    stage : PeriodicStage
        The identified stage; its hysteresis counts as compensated.
    law : ControllerParameters
        Gains, lead and age of the measurement.
    sample_period_s : float
        Sample period, seconds.

    """
    back = np.exp(-2j * np.pi * np.fft.rfftfreq(stage.samples))
    controller = np.full(back.size, law.proportional_gain, dtype=np.complex128)
    controller[1:] += law.integral_gain_per_s * sample_period_s / (1.0 - back[1:])
    if law.lead_zero_hz:
        gain, zero, pole = lead_coefficients(law.lead_zero_hz, law.lead_pole_hz, sample_period_s)
        controller *= gain * (1.0 - zero * back) / (1.0 - pole * back)
    loop = controller * stage.linear_response * back**law.measurement_delay_samples
    sensitivity = np.asarray(1.0 / (1.0 + loop))
    if law.integral_gain_per_s > 0.0:
        sensitivity[0] = 0.0
    return sensitivity


def filtered(response: _Complexes, values: _Floats) -> _Floats:
    """Return periodic values, shape (P,) or (P, M), behind a response, shape (P//2 + 1,)."""
    spectrum = np.fft.rfft(values, axis=0)
    shaped = response.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.fft.irfft(shaped * spectrum, values.shape[0], axis=0))


def feedback_command_um(
    law: ControllerParameters, difference_um: _Floats, sample_period_s: float,
) -> _Floats:
    """
    Return the command by which a controller compares with another reference, shape (N,).

    Parameters
    ----------
    law : ControllerParameters
        The controller, its delays aligned.
    difference_um : ndarray, shape (N,)
        The other reference less that of the run, from the first sample on.
    sample_period_s : float
        Sample period, seconds.

    """
    alone = law.replaced(
        scheme='fb', bumpless_start=False, command_minimum_um=-_UNLIMITED_UM,
        command_maximum_um=_UNLIMITED_UM)
    zeros = np.zeros_like(difference_um)
    return PiController(alone, sample_period_s).answer(0, difference_um, zeros, zeros)
