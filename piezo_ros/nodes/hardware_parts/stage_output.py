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

"""The output to a stage between runs: found as it was left, ramped to rest, demagnetised."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control.demagnetisation import demagnetising_voltage
from piezo_ros.hardware.chosen_device import choose_device
from piezo_ros.hardware.device import Device, DeviceError
from piezo_ros.hardware.limits import DriveLimits
from piezo_ros.hardware.ramp import ramp_voltage
from piezo_ros.model import ParameterError, RigParameters
from piezo_ros.nodes.hardware_parts.block_check import BlockCheck
from piezo_ros.nodes.hardware_parts.reading_check import checked_hold, checked_readings
from piezo_ros.nodes.hardware_parts.sensor_watch import SensorWatch
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import InitialiseParameters
from piezo_ros.parameters.parameter_file import read_parameter_set

__all__ = ['StageOutput']

_CHUNK_S = 0.2  # of the decaying triangle, so that it can be interrupted
_HOLD_S = 0.01  # at rest at the end of what is played
_SETTLE_S = 0.02  # at rest after the last of it


class StageOutput:
    """
    Keeps a device for a run, and knows what the output holds.

    Attributes
    ----------
    device : Device or None
        The device while it is open.
    limits : BlockCheck
        Checks what goes out.
    identity : str
        Product and serial number, '' before it was opened.
    rate_hz : float
        Actual sample rate, 0 before it was opened.
    held_v : float or None
        Voltage that the output holds, as far as known; a deviation from the operating point.
    held_before_v, held_after_v : float or None
        The same before the run and after it.

    """

    def __init__(self) -> None:
        self.device: Device | None = None
        self.identity = ''
        self.rate_hz = 0.0
        self.held_v: float | None = None
        self.held_before_v: float | None = None
        self.held_after_v: float | None = None

    def configure(
        self, hardware: HardwareParameters, initialise: InitialiseParameters,
        sample_period_s: float, slew_v_per_s: float,
    ) -> None:
        """
        Take parameters over for the next run.

        Raises
        ------
        ParameterError
            If they do not go together.
        PlanError
            If there is no such file of a simulated rig.

        """
        for refusal in (
            hardware.refusal_of_period(sample_period_s), hardware.refusal_of_slew(slew_v_per_s),
            hardware.refusal_of_amplitude(initialise.initialise_amplitude_v),
        ):
            if refusal:
                raise ParameterError(refusal)
        file = hardware.simulated_rig_file
        self._simulated_rig: dict[str, Any] = (
            read_parameter_set(Path(file), 'plant', RigParameters).to_mapping() if file else {})
        self._hardware, self._initialise = hardware, initialise
        self._period_s, self._slew_v_per_s = sample_period_s, slew_v_per_s
        self.limits = BlockCheck(DriveLimits.among(hardware.to_mapping()), sample_period_s)

    def open(self) -> None:
        """Open the device, see what the output holds, drive nothing; raises DeviceError."""
        self.close()
        self.held_v = self.held_after_v = None
        self.device = device = choose_device(
            self._hardware.device, {**self._simulated_rig, **self._hardware.to_mapping()})
        try:
            # Two roundings make 99999.99999999999 Hz of 1e-5 s.
            self.rate_hz = float(f'{1.0 / device.open(self._period_s):.12g}')
            self.identity = device.constraints.identity
            self.held_v = self.held_before_v = checked_hold(device)
        except BaseException:
            self.close()
            raise

    @property
    def opened(self) -> Device:
        """The device, which is open."""
        assert self.device is not None
        return self.device

    def use_slew(self, slew_v_per_s: float) -> None:
        """Ramp at another slew from now on."""
        self._slew_v_per_s = slew_v_per_s

    def come_to_rest(self) -> None:
        """Ramp to zero deviation from whatever the output holds; a stream is stopped for it."""
        if self.device is None:
            return
        self.held_v = self.held_after_v = None  # whatever they are, where this fails
        if self.device.hold() != 0.0:
            self.device.ramp_to(0.0, self._slew_v_per_s)
        self.held_v = self.held_after_v = checked_hold(self.device)

    def demagnetise(self, sensor: SensorWatch) -> Iterator[None]:
        """Drive the decaying triangle and wait at rest; each step may be the last."""
        device = self.opened
        voltage_v = np.fromiter(demagnetising_voltage(
            self._amplitude_v, self._initialise.initialise_levels, self._slew_v_per_s,
            self._period_s), np.float64)
        voltage_v = np.append(voltage_v, np.zeros(round(_SETTLE_S / self._period_s)))
        self.limits.begin(self.held_v or 0.0)
        self.limits.check(voltage_v)
        most = device.constraints.most_samples or voltage_v.size
        chunk = min(max(1, round(_CHUNK_S / self._period_s)), most)
        for first in range(0, voltage_v.size, chunk):
            block_v = voltage_v[first:first + chunk]
            displacement_um = checked_readings(device.play(block_v), first, block_v.size + 1)
            self.held_v = float(block_v[-1])
            sensor.play(block_v)
            sensor.check(displacement_um[1:])
            yield

    def describe_triangle(self) -> str:
        """Return what `demagnetise` does in words."""
        return (
            f'{self._initialise.initialise_levels} periods of a triangle, from '
            f'{self._amplitude_v:g} V to 0 V')

    @property
    def _amplitude_v(self) -> float:
        """First amplitude of the triangle: what is set, or all that the rails allow."""
        return self._initialise.initialise_amplitude_v or self._hardware.reach_v

    def way_to_rest(self, last_v: float) -> NDArray[np.float64]:
        """Return the ramp from the last voltage of a run to zero deviation and a hold there."""
        return np.append(
            ramp_voltage(last_v, 0.0, self._slew_v_per_s, self._period_s),
            np.zeros(max(1, round(_HOLD_S / self._period_s))))

    def initialise(self, is_stopped: Callable[[], bool]) -> None:
        """Demagnetise the stage outside of a run, unless stopped; raises DeviceError."""
        self.open()
        try:
            self.come_to_rest()
            for _ in self.demagnetise(SensorWatch(self._hardware.reach_v)):
                if is_stopped():
                    raise DeviceError('stopped within the triangle; the voltage is at rest again')
        finally:
            self.leave()

    def leave(self) -> None:
        """Ramp to rest and release the device, whatever comes of the ramp."""
        try:
            self.come_to_rest()
        finally:
            self.close()

    def close(self) -> None:
        """Release the device; the output holds what it holds."""
        device, self.device = self.device, None
        if device is not None:
            device.close()

    def status_fields(self) -> dict[str, Any]:
        """Return device, rate and the voltages that it holds and held."""
        return {
            'voltage_v': self.held_v, 'device': self.identity, 'device_rate_hz': self.rate_hz,
            'voltage_before_v': self.held_before_v, 'voltage_after_v': self.held_after_v}
