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
The compiled part of the relay: looks at one raw message, computes and writes the answer.

The numbers of a block are little-endian doubles at the end of its message: index, sample period and
samples.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numpy as np
from numba import typeof

from piezo_ros.model.compiled import brief_kernel
from piezo_ros.model.step import step

__all__ = ['relay_kernel']

# Index, sample period and sample are the last three numbers of a message of one sample.
_INDEX, _PERIOD, _SAMPLE = 24, 16, 8


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


def relay_kernel(sample_step: Callable[..., float], *arguments: Any) -> Callable[..., bool]:
    """
    Return the compiled answer of an element from message to message.

    It takes arguments of the types of these alone, arrays contiguous: to look at the types of each
    call costs as much as the call.

    Parameters
    ----------
    sample_step : callable
        The marked step of the element.
    *arguments
        Those of a call.

    """
    types = tuple(map(typeof, arguments))
    return cast('Callable[..., bool]', _kernel(sample_step).compile(types))


@cache
def _kernel(sample_step: Callable[..., float]) -> Any:

    @brief_kernel
    def relay(
        raw: bytes, expected: Any, message: Any, recent: Any, memory: Any, beside: Any, at: int,
        k: int, index: int, answer_index: int,
    ) -> bool:
        if beside.shape[0] and not 0 <= at < beside.shape[1]:
            return False
        if not _is_next(raw, expected, index):
            return False
        value = sample_step(memory, beside, at, k, _number(raw, len(raw) - _SAMPLE))
        recent[answer_index % len(recent)] = value
        _put(message, len(message) - _INDEX, answer_index)
        _put(message, len(message) - _SAMPLE, value)
        return True

    return relay
