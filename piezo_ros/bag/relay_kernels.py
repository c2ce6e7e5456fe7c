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
Compiled answers from message to message, for the stages of a closed loop.

Each kernel looks whether serialized bytes are simply the next sample of a stream, alone in its
block as `BlockCodec.encode_one` writes it; if so, it does the stage's step and writes the answer
over the message before, and its number among the recent ones. If not, nothing is changed: whoever
calls looks at the message closely.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_ros.control import stepping as control_stepping
from piezo_ros.model import stepping
from piezo_ros.model.compiled import brief_kernel, bytes_at, floats_at, integers_at
from piezo_ros.model.step import step

__all__ = ['relay_controller', 'relay_inverse', 'relay_rig']

# Index, sample period and sample are the last three numbers of a message.
_INDEX, _PERIOD, _SAMPLE = 24, 16, 8
_controller_packed = control_stepping.controller_packed
_hold_packed = stepping.hold_packed
_hold_packed_creeping = stepping.hold_packed_creeping
_inverse_packed = stepping.inverse_packed
_Places = NDArray[np.int64]  # of the operands, see `Operands`


@step
def _number(raw: Any, at: int) -> Any:
    """Return the little-endian double at a place that need not be aligned."""
    bits = np.uint64(
        np.uint64(raw[at])
        | np.uint64(raw[at + 1]) << np.uint64(8)
        | np.uint64(raw[at + 2]) << np.uint64(16)
        | np.uint64(raw[at + 3]) << np.uint64(24)
        | np.uint64(raw[at + 4]) << np.uint64(32)
        | np.uint64(raw[at + 5]) << np.uint64(40)
        | np.uint64(raw[at + 6]) << np.uint64(48)
        | np.uint64(raw[at + 7]) << np.uint64(56))
    return bits.view(np.float64)


@step
def _put(message: Any, at: int, value: float) -> None:
    number = np.float64(value)
    bits = number.view(np.uint64)
    for byte in range(8):
        message[at + byte] = (bits >> np.uint64(8 * byte)) & np.uint64(255)


@step
def _is_next(raw: Any, expected: Any, index: int) -> bool:
    """Return whether a message is one finite sample of this index, all else as expected."""
    size = len(expected)
    if len(raw) != size:
        return False
    # Without a way out in the middle, so that many bytes are compared at once.
    difference = np.uint8(0)
    for at in range(size - _INDEX):
        difference |= raw[at] ^ expected[at]
    for at in range(size - _PERIOD, size - _SAMPLE):
        difference |= raw[at] ^ expected[at]
    if difference != 0:
        return False
    sample = _number(raw, size - _SAMPLE)
    is_next: bool = _number(raw, size - _INDEX) == index and sample - sample == 0.0
    return is_next


@step
def _expected(places: Any, last: int, raw: Any) -> bool:
    """Return whether a message is simply the next one, by the last five of the operands."""
    return _is_next(raw, bytes_at(places, last - 4), integers_at(places, last - 1)[0])


@step
def _answer(places: Any, last: int, value: float) -> None:
    message, recent = bytes_at(places, last - 3), floats_at(places, last - 2)
    asked, answered = integers_at(places, last - 1), integers_at(places, last)
    size, index = len(message), answered[0]
    recent[index % len(recent)] = value
    _put(message, size - _INDEX, index)
    _put(message, size - _SAMPLE, value)
    asked[0] += 1
    answered[0] = index + 1


@brief_kernel
def relay_inverse(places: _Places, raw: bytes) -> bool:
    """
    Answer a command with its voltage, see `inverse_packed`.

    Operands: memory, and what the relay adds: expected and own message, recent answers, index of
    the next message and of the next answer.
    """
    if not _expected(places, 5, raw):
        return False
    _answer(places, 5, _inverse_packed(floats_at(places, 0), _number(raw, len(raw) - _SAMPLE)))
    return True


@brief_kernel
def relay_rig(places: _Places, raw: bytes) -> bool:
    """
    Answer a voltage with a reading, see `hold_packed` and `hold_packed_creeping`.

    Operands: memory; where the voltage is left; whether the rig creeps; index of the first noise,
    noise; and what the relay adds.
    """
    noise = floats_at(places, 4)
    at = integers_at(places, 9)[0] - places[6]
    if not (0 <= at < len(noise) and _expected(places, 9, raw)):
        return False
    memory, held_v = floats_at(places, 0), floats_at(places, 1)
    voltage_v = _number(raw, len(raw) - _SAMPLE)
    held_v[0] = voltage_v
    if places[4]:
        displacement_um = _hold_packed_creeping(memory, voltage_v, noise[at])
    else:
        displacement_um = _hold_packed(memory, voltage_v, noise[at])
    _answer(places, 9, displacement_um)
    return True


@brief_kernel
def relay_controller(places: _Places, raw: bytes) -> bool:
    """
    Answer a displacement with a command, see `controller_packed`.

    Operands: memory; index of the first sample of the run, and of the first target; reference,
    feedforward; and what the relay adds.
    """
    reference_um = floats_at(places, 3)
    index = integers_at(places, 9)[0]
    at = index - places[4]
    if not (0 <= at < len(reference_um) and _expected(places, 9, raw)):
        return False
    command_um = _controller_packed(
        floats_at(places, 0), index - places[2], reference_um[at], floats_at(places, 4)[at],
        _number(raw, len(raw) - _SAMPLE))
    _answer(places, 9, command_um)
    return True
