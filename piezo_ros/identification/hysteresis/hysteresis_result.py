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

"""What an identification of hysteresis hands back: the elements, their errors, the verdict."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.hysteresis_file import hysteresis_facts, parameter_yaml
from piezo_ros.identification.hysteresis.hysteresis_validation import Validation
from piezo_ros.identification.verdict import Verdict
from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.hysteresis_and_inverse import MaxwellResistiveCapacitor

__all__ = ['Coverage', 'HysteresisFit']

_MOST_AT_REST: Final = 1000  # samples at the beginning of a record
_HIDDEN: Final = 3.0  # standard errors

_Floats = NDArray[np.float64]


class Coverage(NamedTuple):
    """
    The range of voltage that the excitation covers, and the one in which the model will be used.

    Attributes
    ----------
    minimum_v, maximum_v : float
        Excited voltages.
    minimum_um, maximum_um : float
        Measured displacements.
    wanted_v : tuple of float
        Lowest and highest voltage of use; the excited ones where none were given.

    """

    minimum_v: float
    maximum_v: float
    minimum_um: float
    maximum_um: float
    wanted_v: tuple[float, float]

    @property
    def warning(self) -> str:
        """The part that is not covered, in one sentence; empty if there is none."""
        low, high = self.wanted_v
        if self.minimum_v <= low and high <= self.maximum_v:
            return ''
        return (
            f'the excitation covers {self.minimum_v:g} … {self.maximum_v:g} V of the '
            f'{low:g} … {high:g} V asked for; beyond it the model is a straight line without '
            'hysteresis')


@dataclass(frozen=True, kw_only=True)
class HysteresisFit:
    """
    An identified MRC hysteresis.

    Attributes
    ----------
    parameters : HysteresisParameters
        The elements in the order in which they saturate; always monotone and invertible.
    kappa_standard_error_um_per_v : ndarray, shape (n + 1,)
        Standard errors of the compliances; NaN for an element that the data do not need.
    saturation_standard_error_v : ndarray, shape (n,)
        Standard errors of the saturation voltages, likewise.
    delay_samples : float
        Samples by which the displacement lags behind the voltage; not part of the parameters.
    offset_um : float
        Displacement at rest; not part of the parameters.
    voltage_v, displacement_um : ndarray, shape (N,)
        The data, all runs concatenated.
    residual_um : ndarray, shape (N,)
        Measured minus predicted displacement; NaN where a sample was left out.
    rms_um : float
        Root mean square of the residual.
    coverage : Coverage
        The range of the excitation; its `warning` names the part that is missing.
    cross_validated_rms_um : dict of int to float
        Number of elements to cross-validated rms error, where the number was chosen.
    drift_um_per_sample : float
        Drift that was taken from the displacement before the fit; 0 where the data show none.
    validation : Validation
        What the model leaves of loops that it has not seen.
    verdict : Verdict
        How far it may be trusted.
    samples_used, samples_lost : int
        Samples of the recording in the fit, and without a finite displacement.

    """

    parameters: HysteresisParameters
    kappa_standard_error_um_per_v: _Floats
    saturation_standard_error_v: _Floats
    delay_samples: float
    offset_um: float
    voltage_v: _Floats
    displacement_um: _Floats
    residual_um: _Floats
    rms_um: float
    coverage: Coverage
    cross_validated_rms_um: dict[int, float]
    drift_um_per_sample: float
    validation: Validation
    verdict: Verdict
    samples_used: int
    samples_lost: int

    @property
    def elements(self) -> int:
        """Number n of voltage-limited elements."""
        return len(self.parameters.saturation_v)

    @property
    def model(self) -> MaxwellResistiveCapacitor:
        """The operator, forward and inverse."""
        return MaxwellResistiveCapacitor.of(self.parameters)

    @property
    def loop_offset_um(self) -> float:
        """
        Displacement by which the loops lie beside those of the model, seen from the virgin stage.

        The offset of the fit is that of the loops. What the stage was off from it before its first
        loop is what a scan without feedback will be off later. 0 where the noise hides it.
        """
        noise_um = self.validation.noise_rms_um
        first_um = self.model.forward(self.voltage_v[:_MOST_AT_REST])[0]
        at_rest = int(np.argmax(np.append(np.abs(first_um) > noise_um, True)))
        first = self.displacement_um[:at_rest]
        first = first[np.isfinite(first)]
        if not first.size:
            return 0.0
        offset_um = self.offset_um - float(first.mean())
        hidden_um = _HIDDEN * noise_um / math.sqrt(first.size)
        return offset_um if abs(offset_um) > hidden_um else 0.0

    def to_parameter_yaml(self, *, source: str, sample_period_s: float | None = None) -> str:
        """
        Return a ROS parameter file for the compensator node.

        Parameters
        ----------
        source : str
            Where the data come from, usually the bag.
        sample_period_s : float, optional
            Sample period of the recording, for the delay in seconds.

        Returns
        -------
        str
            YAML; the numbers are bit-equal to `parameters`.

        """
        notes = [
            f'source: {source}',
            f'verdict: {self.verdict}',
            f'residual: {1e3 * self.rms_um:.4g} nm rms',
            f'samples: {self.samples_used} used, {self.samples_lost} lost',
            f'excitation: {self.coverage.minimum_v:.4g} to {self.coverage.maximum_v:.4g} V',
            f'removed delay: {self.delay_samples:.4g} samples',
            f'removed offset: {1e3 * self.offset_um:.4g} nm',
        ]
        if self.coverage.warning:
            notes.append(f'WARNING: {self.coverage.warning}')
        return parameter_yaml(
            self.parameters, self.kappa_standard_error_um_per_v,
            self.saturation_standard_error_v, notes,
            hysteresis_facts(
                self.validation, self.verdict, rms_um=self.rms_um, samples_used=self.samples_used,
                samples_lost=self.samples_lost, delay_samples=self.delay_samples,
                offset_um=self.offset_um, loop_offset_um=self.loop_offset_um,
                drift_um_per_sample=self.drift_um_per_sample, sample_period_s=sample_period_s,
                range_v=(self.coverage.minimum_v, self.coverage.maximum_v)))
