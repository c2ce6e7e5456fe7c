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

"""What a block of voltages must keep to before it goes out."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros.hardware.device import Refused

__all__ = ['refuse_beyond_rails']


def refuse_beyond_rails(
    device: str, name: str, voltage_v: ArrayLike, lowest_v: float, highest_v: float,
) -> NDArray[np.float64]:
    """
    Return a block as an array, shape (N,), if every voltage of it is finite and within the rails.

    Parameters
    ----------
    device, name : str
        The device and what the caller calls the block, for the message.
    voltage_v : array_like, shape (N,)
        The block, volts; N is 1 or more.
    lowest_v, highest_v : float
        Rails, volts.

    Raises
    ------
    Refused
        Names the first sample that is not allowed, its value and the range.

    """
    block_v = np.ascontiguousarray(voltage_v, dtype=np.float64)
    if block_v.ndim != 1 or not block_v.size:
        raise Refused(
            f'{device}: {name} has shape {block_v.shape}, it must be one-dimensional and not empty')
    # NaN is on neither side.
    allowed = (block_v >= lowest_v) & (block_v <= highest_v)
    if not allowed.all():
        first = int(np.argmin(allowed))
        raise Refused(
            f'{device}: {name}[{first}] is {block_v[first]} V, allowed is {lowest_v:g} … '
            f'{highest_v:g} V')
    return block_v
