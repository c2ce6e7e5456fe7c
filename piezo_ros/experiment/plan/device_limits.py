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

"""What the runs of a plan ask of a device and its amplifier, before anything is driven."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import simulate, simulate_bare
from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.experiment.plan import Plan
from piezo_ros.experiment.plan.automatic import Known
from piezo_ros.experiment.plan.hardware_entry import rig_is_known, stand_in
from piezo_ros.hardware.device import Refused
from piezo_ros.hardware.limits import BlockFigure, DriveLimits, block_figures, slew
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['DeviceDemand', 'check_device_plan']

_BYTES: Final = 8
_SMALL: Final = {'A': (1e3, 'mA'), 'V/s': (1e-3, 'V/ms')}  # unit -> what is nicer to read


@dataclass(frozen=True)
class DeviceDemand:
    """
    What one run asks of its device, from rest to rest, its demagnetisation included.

    Attributes
    ----------
    name : str
        Name of the run.
    device : str
        The device, and how it is timed.
    rate_hz : float
        Sample rate.
    samples : int
        Length of the run with its ramp to rest.
    prefilled : int
        How many of them wait on the device at the start.
    first_step_v : float
        Step of the output from rest to the first sample.
    figures : tuple of BlockFigure
        What amplifier and stage are asked for, with the limit where there is one.
    unknown : tuple of str
        What could not be checked, and why.

    """

    name: str
    device: str
    rate_hz: float
    samples: int
    prefilled: int
    first_step_v: float
    figures: tuple[BlockFigure, ...]
    unknown: tuple[str, ...] = ()

    @property
    def beyond(self) -> bool:
        """Whether the amplifier or the stage cannot do what is asked."""
        return any(not figure.is_allowed for figure in self.figures)

    @property
    def beyond_text(self) -> str:
        """Every figure that is beyond its limit, with sample, value and range."""
        return '; '.join(
            f'sample {figure.sample}: {_text(figure)}' for figure in self.figures
            if not figure.is_allowed)

    @property
    def text(self) -> str:
        """Some lines for people."""
        how = 'whole run prefilled' if self.prefilled == self.samples else (
            f'streamed, {self.prefilled} of {self.samples} samples ahead')
        return '\n'.join([
            f'{self.name} on {self.device}',
            f'  rate {self.rate_hz:.12g} Hz, {how}',
            f'  memory {_megabytes(self.samples)} of voltages, and as much of readings',
            f'  first step {self.first_step_v:.3f} V',
            *(f'  {_text(figure)}' + ('' if figure.is_allowed else
                                      f': BEYOND at sample {figure.sample}')
              for figure in self.figures),
            *(f'  {what}' for what in self.unknown)])


def _text(figure: BlockFigure) -> str:
    factor, unit = _SMALL.get(figure.unit, (1.0, figure.unit))
    asked = f'{figure.name} {factor * figure.value:.4g} {unit} asked'
    low, high = factor * figure.lowest, factor * figure.highest
    if math.isinf(figure.highest):
        return f'{asked}, no limit'
    allowed = f'{high:g}' if figure.lowest == 0.0 else f'{low:g} … {high:g}'
    return f'{asked}, {allowed} {unit} allowed'


def _megabytes(samples: int) -> str:
    return f'{_BYTES * samples / 1e6:.3g} MB'


def check_device_plan(plan: Plan) -> list[DeviceDemand]:
    """
    Return what every run with a device asks of it.

    Parameters
    ----------
    plan : Plan
        The plan; runs without a device are left out.

    Returns
    -------
    list of DeviceDemand
        In the order of the plan.

    """
    return [
        _demand(run, run.hardware, plan.known) for run in plan.runs if run.hardware is not None]


def _demand(run: PlannedRun, hardware: HardwareParameters, known: Known) -> DeviceDemand:
    period_s = run.trajectory.sample_period_s
    voltage_v, unknown = _voltage(run, known)
    slew_v_per_s = run.parameters['plant']['safe_slew_v_per_s']
    played_v = np.append(
        voltage_v, ramp_voltage(float(voltage_v[-1]), 0.0, slew_v_per_s, period_s))
    limits = DriveLimits.among(hardware.to_mapping())
    try:
        figures = _figures(played_v, period_s, limits)
        if hardware.demagnetise:
            figures += [
                _named(figure, 'of the demagnetisation') for figure in _figures(
                    _triangle(run, hardware, slew_v_per_s), period_s, limits)
                if not figure.is_allowed]
    except Refused as error:  # not finite: a feedback that is not stable
        return _not_finite(run, hardware, str(error))
    if not limits.load_capacitance_f:
        unknown.append('current: not checked, load_capacitance_f is 0')
    if not limits.gain_um_per_v and not rig_is_known(run, known):
        unknown.append(
            'travel: not checked, neither gain_um_per_v nor known_rig_files tell of the stage')
    wanted = hardware.prefill_samples or hardware.buffer_samples
    return DeviceDemand(
        name=run.name, device=f'{hardware.device}, timing {hardware.timing}',
        rate_hz=1.0 / period_s, samples=played_v.size, prefilled=min(wanted, played_v.size),
        first_step_v=float(voltage_v[0]), figures=tuple(figures), unknown=tuple(unknown))


def _not_finite(
    run: PlannedRun, hardware: HardwareParameters, reason: str,
) -> DeviceDemand:
    figure = BlockFigure(
        f'voltage ({reason})', 'V', math.nan, hardware.voltage_minimum_v,
        hardware.voltage_maximum_v, 0)
    return DeviceDemand(
        run.name, hardware.device, 1.0 / run.trajectory.sample_period_s, run.trajectory.samples,
        0, math.nan, (figure,))


def _voltage(run: PlannedRun, known: Known) -> tuple[NDArray[np.float64], list[str]]:
    """Return the voltages of a run, and what is not certain of them."""
    model = stand_in(run, known) if rig_is_known(run, known) else run
    unknown: list[str] = []
    if run.bare:
        return simulate_bare(model.plant, run.trajectory).voltage_v, unknown
    if run.controller.uses_feedback and model is run:
        unknown.append(
            'voltage: that of feedback depends on the stage, which known_rig_files do not tell; '
            'this is with that of the simulated rig')
    # Without feedback no voltage depends on the rig.
    loop = simulate(model.plant, run.compensator, run.controller, run.trajectory, run.changes)
    return loop.voltage_v, unknown


def _figures(
    voltage_v: NDArray[np.float64], period_s: float, limits: DriveLimits,
) -> list[BlockFigure]:
    """Return the figures of a block after rest; the slew also where it has no limit."""
    figures = block_figures(voltage_v, 0.0, period_s, limits)
    if not limits.slew_limit_v_per_s:
        figures.append(slew(voltage_v, 0.0, period_s, math.inf))
    return figures


def _triangle(
    run: PlannedRun, hardware: HardwareParameters, slew_v_per_s: float,
) -> NDArray[np.float64]:
    plant = run.parameters['plant']
    return np.array(demagnetising_voltage(
        plant['initialise_amplitude_v'] or hardware.reach_v, plant['initialise_levels'],
        slew_v_per_s, run.trajectory.sample_period_s))


def _named(figure: BlockFigure, addition: str) -> BlockFigure:
    return BlockFigure(
        f'{figure.name} {addition}', figure.unit, figure.value, figure.lowest, figure.highest,
        figure.sample)
