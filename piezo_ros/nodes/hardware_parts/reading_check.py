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

"""Checks what a device hands out, before anything is made of it."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.device import Device, DeviceError

__all__ = ['checked_hold', 'checked_readings']


def checked_hold(device: Device) -> float:
    """Return the voltage that the output of a device holds; raises DeviceError if it is none."""
    held_v = float(device.hold())
    if not math.isfinite(held_v):
        raise DeviceError(
            f'the device says that its output holds {held_v} V: the voltage is not known')
    return held_v


def checked_readings(readings_um: ArrayLike, first: int, count: int) -> NDArray[np.float64]:
    """
    Return the readings y[first] … y[first+count-1] of a device as an array, shape (count,).

    Raises
    ------
    DeviceError
        If there are fewer or more of them, or one is not finite; the text names its index.

    """
    checked_um = np.asarray(readings_um, np.float64)
    if checked_um.shape != (count,):
        raise DeviceError(
            f'the device gave readings of shape {checked_um.shape} where it was asked for {count} '
            f'from index {first} on: the index of every later one would be wrong')
    if not np.all(is_finite := np.isfinite(checked_um)):
        wrong = int(np.argmin(is_finite))
        raise DeviceError(
            f'the device gave {checked_um[wrong]} um as its reading at index {first + wrong}')
    return checked_um
