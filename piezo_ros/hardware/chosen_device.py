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

"""The device that a parameter chooses: one of the package, or one of your own as MODULE:CLASS."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, Final

from piezo_ros.hardware.device import Device, DeviceError, Refused
from piezo_ros.hardware.opening import DEVICE_KINDS, device_parameters, open_device
from piezo_ros.model.parameters import ParameterError

__all__ = ['choose_device', 'own_values']

_NEEDED: Final = ('constraints', 'open', 'hold', 'reading', 'ramp_to', 'play', 'close')


def own_values(device: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the values that a device of the package takes, by the names that it has for them.

    Parameters
    ----------
    device : str
        One of `DEVICE_KINDS`.
    values : mapping of str to value
        Parameters of the hardware plant; an empty address is the device's own default.

    """
    names = device_parameters(device).names()
    return {
        name: value for name, value in values.items()
        if name in names and (name, value) != ('address', '')}


def choose_device(device: str, values: Mapping[str, Any]) -> Device:
    """
    Return the device that a text chooses.

    Parameters
    ----------
    device : str
        One of `DEVICE_KINDS`, or MODULE:CLASS; the class is given the values.
    values : mapping of str to value
        Parameters of the hardware plant; a device of the package takes those that it has.

    Raises
    ------
    DeviceError
        If it cannot be reached or made; the text names it.
    ParameterError
        If it refuses a value.

    """
    if device in DEVICE_KINDS:
        return open_device(device, own_values(device, values))
    module_name, _, class_name = device.partition(':')
    try:
        make = getattr(import_module(module_name), class_name)
    except (AttributeError, ImportError, SyntaxError, ValueError) as error:
        raise Refused(
            f'device is {device}: {error}; the module must be in the Python path, and have a '
            f'class {class_name}') from None
    if not callable(make):
        raise Refused(f'device is {device}: {class_name} is a {type(make).__name__}, no class')
    return _made(device, make, values)


def _made(
    device: str, make: Callable[[Mapping[str, Any]], Device], values: Mapping[str, Any],
) -> Device:
    try:
        made = make(values)
        missing = [name for name in _NEEDED if not hasattr(made, name)]
    except (DeviceError, ParameterError):
        raise
    except Exception as error:  # of code that is not of this package
        raise Refused(
            f'device is {device}, which cannot be made of the parameters: '
            f'{type(error).__name__}: {error}') from error
    if missing:
        raise Refused(
            f'device is {device}, which is no device: it has no {", ".join(missing)}; see '
            'piezo_ros.hardware.device.Device')
    return made
