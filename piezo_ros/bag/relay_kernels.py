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
from piezo_ros.model.compiled import brief_kernel, bytes_at, floats_at
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
    return _number(raw, size - _INDEX) == index and sample - sample == 0.0  # type: ignore[no-any-return]


@step
def _answer(message: Any, recent: Any, index: int, value: float) -> None:
    size = len(message)
    recent[index % len(recent)] = value
    _put(message, size - _INDEX, index)
    _put(message, size - _SAMPLE, value)


@brief_kernel
def relay_inverse(places: _Places, raw: bytes, index: int, answer_index: int) -> bool:
    """
    Answer a command with its voltage, see `inverse_packed`.

    Operands: memory, and what the relay adds: expected and own message, recent answers.
    """
    memory, expected = floats_at(places, 0), bytes_at(places, 1)
    if not _is_next(raw, expected, index):
        return False
    voltage_v = _inverse_packed(memory, _number(raw, len(raw) - _SAMPLE))
    _answer(bytes_at(places, 2), floats_at(places, 3), answer_index, voltage_v)
    return True


@brief_kernel
def relay_rig(places: _Places, raw: bytes, index: int, answer_index: int) -> bool:
    """
    Answer a voltage with a reading, see `hold_packed` and `hold_packed_creeping`.

    Operands: memory; where the voltage is left; whether the rig creeps; index of the first noise,
    noise; and what the relay adds.
    """
    noise, expected = floats_at(places, 4), bytes_at(places, 5)
    at = answer_index - places[6]
    if not (0 <= at < len(noise) and _is_next(raw, expected, index)):
        return False
    memory, held_v = floats_at(places, 0), floats_at(places, 1)
    voltage_v = _number(raw, len(raw) - _SAMPLE)
    held_v[0] = voltage_v
    if places[4]:
        displacement_um = _hold_packed_creeping(memory, voltage_v, noise[at])
    else:
        displacement_um = _hold_packed(memory, voltage_v, noise[at])
    _answer(bytes_at(places, 6), floats_at(places, 7), answer_index, displacement_um)
    return True


@brief_kernel
def relay_controller(places: _Places, raw: bytes, index: int, answer_index: int) -> bool:
    """
    Answer a displacement with a command, see `controller_packed`.

    Operands: memory; index of the first sample of the run, and of the first target; reference,
    feedforward; and what the relay adds.
    """
    reference_um, expected = floats_at(places, 3), bytes_at(places, 5)
    at = answer_index - places[4]
    if not (0 <= at < len(reference_um) and _is_next(raw, expected, index)):
        return False
    packed, feedforward_um = floats_at(places, 0), floats_at(places, 4)
    command_um = _controller_packed(
        packed, answer_index - places[2], reference_um[at], feedforward_um[at],
        _number(raw, len(raw) - _SAMPLE))
    _answer(bytes_at(places, 6), floats_at(places, 7), answer_index, command_um)
    return True
