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
The contract of a node's topics as data: what it reads and writes, and what it must refuse.

See docs/topics.md for the contract in words.
"""

import copy
import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from std_msgs.msg import Float64MultiArray, MultiArrayDimension

__all__ = ['CONTRACTS', 'MALFORMED', 'CheckSettings', 'Contract', 'Finding']


class Contract(NamedTuple):
    """The streams of one kind of node."""

    inputs: tuple[str, ...]
    output: str
    opening: int  # samples that it sends before anything has arrived


CONTRACTS: Final[Mapping[str, Contract]] = {
    'plant': Contract(('voltage',), 'displacement', 1),
    'compensator': Contract(('command',), 'voltage', 0),
    'controller': Contract(('reference', 'feedforward', 'displacement'), 'command', 0),
}


class CheckSettings(NamedTuple):
    """How to check."""

    amplitude: float  # of what the node is driven with, in the unit of its input
    sample_period_s: float | None  # None: that of the plant's first block
    discovery_s: float  # how long the node may take to appear and to open
    patience_s: float  # how long it may take for an answer
    watchdog_s: float  # how long a plant may go on without voltage
    look_around_s: float = 0.0  # how long to look for others before taking a place among them
    ahead: bool = False  # send the whole run first: the plant answers once it has its end


class Finding(NamedTuple):
    """One thing that was checked."""

    what: str
    right: bool | None  # None: could not be checked
    detail: str


def _changed(change: Callable[[Float64MultiArray], None]) -> Callable[[Any], Any]:
    def make(message: Float64MultiArray) -> Float64MultiArray:
        changed = copy.deepcopy(message)
        change(changed)
        return changed

    return make


def _set_data(position: int, value: Callable[[float], float]) -> Callable[[Any], Any]:
    def change(message: Float64MultiArray) -> None:
        message.data[position] = value(message.data[position])

    return _changed(change)


def _set_dimension(field: str, value: Any) -> Callable[[Any], Any]:
    return _changed(lambda message: setattr(message.layout.dim[0], field, value))


# What must be refused -> how a good block of two samples becomes it.
MALFORMED: Final[Mapping[str, Callable[[Any], Any]]] = {
    'another label': _set_dimension('label', 'nonsense_um'),
    'a layout without a dimension': _changed(
        lambda message: setattr(message.layout, 'dim', [])),
    'a layout with two dimensions': _changed(
        lambda message: message.layout.dim.append(MultiArrayDimension())),
    'a data_offset of 0': _changed(lambda message: setattr(message.layout, 'data_offset', 0)),
    'a message without data': _changed(lambda message: setattr(message, 'data', [])),
    'a size that is not N': _set_dimension('size', 3),
    'a stride that is not N': _set_dimension('stride', 1),
    'a sample that is no number': _set_data(2, lambda _: math.nan),
    'an infinite sample': _set_data(3, lambda _: math.inf),
    'an index with a fraction': _set_data(0, lambda index: index + 0.5),
    'a negative index': _set_data(0, lambda _: -1.0),
    'a sample period that is no number': _set_data(1, lambda _: math.nan),
    'a sample period of zero': _set_data(1, lambda _: 0.0),
    'consumed samples': _set_data(0, lambda index: index - 2.0),
    'a block that begins with a consumed sample': _set_data(0, lambda index: index - 1.0),
}
