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

"""Makes the device that a plan or a parameter names."""

from collections.abc import Mapping
from typing import Any

from piezo_ros.hardware.device import Device
from piezo_ros.model.parameters import ParameterError, ParameterSet

__all__ = ['DEVICE_KINDS', 'device_parameters', 'open_device']

DEVICE_KINDS = ('simulated', 'ni', 'gcs')


def device_parameters(kind: str) -> type[ParameterSet]:
    """
    Return the parameters of a kind of device; no library of a vendor is needed for it.

    Raises
    ------
    ParameterError
        For a kind that there is not.

    """
    if kind == 'simulated':
        from piezo_ros.hardware.simulated import SimulatedDeviceParameters
        return SimulatedDeviceParameters
    if kind == 'ni':
        from piezo_ros.hardware.ni import NiParameters
        return NiParameters
    if kind == 'gcs':
        from piezo_ros.hardware.gcs import GcsParameters
        return GcsParameters
    raise ParameterError(f'device is {kind!r}, allowed are {", ".join(DEVICE_KINDS)}')


def open_device(kind: str, parameters: Mapping[str, Any]) -> Device:
    """
    Return a device, connected, so that its constraints are known; `Device.open` is the next step.

    Parameters
    ----------
    kind : str
        One of `DEVICE_KINDS`.
    parameters : mapping of str to value
        Any subset of its parameters (`device_parameters`).

    Raises
    ------
    ParameterError
        For a kind or a parameter that there is not, or a value out of range.
    MissingPackage
        If the library of the vendor is not installed; the text names the extra.
    Gone, Reserved
        If it does not answer, or another program holds it.

    Examples
    --------
    >>> open_device('simulated', {'seed': 3}).constraints.identity
    'simulated stage, seed 3'

    """
    values = device_parameters(kind).from_mapping(parameters)
    if kind == 'simulated':
        from piezo_ros.hardware.simulated import SimulatedDevice
        return SimulatedDevice(values)  # type: ignore[arg-type]
    if kind == 'ni':
        from piezo_ros.hardware.ni import NiDevice
        return NiDevice(values)  # type: ignore[arg-type]
    from piezo_ros.hardware.gcs import GcsDevice
    return GcsDevice(values)  # type: ignore[arg-type]
