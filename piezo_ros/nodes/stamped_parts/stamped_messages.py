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

"""What a stamped message says of a sample: its value in the unit of ROS, and its stamp."""

from typing import Any, NamedTuple

import numpy as np
from std_msgs.msg import Float64MultiArray

from piezo_ros.bag import STREAMS
from piezo_ros.streams import MalformedBlockError, block_from_message_fields

__all__ = ['Sample', 'joint_state_fields', 'newest_sample', 'time_of']

_UM_PER_M = 1e6  # 2.5 um over this are 2.5e-6 m to the last bit
_LATEST_S = 2**31 - 1  # that a stamp can have


class Sample(NamedTuple):
    """One sample of a stream, in the stream's unit."""

    index: int  # type: ignore[assignment]  # hides tuple.index, which samples do not need
    sample_period_s: float
    value: float


def newest_sample(stream: str, message: Float64MultiArray) -> Sample | None:
    """
    Return the last sample of a block, None for the end of its stream.

    Raises
    ------
    MalformedBlockError
        If the message is no block of that stream.

    """
    layout = message.layout
    label = f'{stream}_{STREAMS[stream]}'
    labels = [dimension.label for dimension in layout.dim]
    if labels != [label]:
        raise MalformedBlockError(f'layout.dim has the labels {labels}, {stream!r} has {[label]}')
    index, sample_period_s, samples = block_from_message_fields(
        label, layout.dim[0].size, layout.dim[0].stride, layout.data_offset,
        np.asarray(message.data))
    if not samples.size:
        return None
    return Sample(index + samples.size - 1, sample_period_s, float(samples[-1]))


def time_of(sample: Sample) -> tuple[int, int]:
    """
    Return the simulated time of a sample, k·Ts, as ``clock`` and bags have it.

    Returns
    -------
    seconds, nanoseconds : int, int
        As in ``builtin_interfaces/msg/Time``.

    Raises
    ------
    ValueError
        If it is too late for that type.

    """
    seconds, nanoseconds = divmod(
        round(sample.index * sample.sample_period_s * 1e9), 10**9)
    if seconds > _LATEST_S:
        raise ValueError(
            f'sample {sample.index} with a period of {sample.sample_period_s} s is at {seconds} s, '
            f'a stamp is at most {_LATEST_S} s')
    return seconds, nanoseconds


def joint_state_fields(stream: str, value: float, joint: str) -> dict[str, list[Any]]:
    """
    Return what a ``sensor_msgs/msg/JointState`` has of a sample beside its header.

    Parameters
    ----------
    stream : str
        One of `STREAMS`.
    value : float
        In the unit of the stream.
    joint : str
        The joint that gets a length as its position, in metres. No message has a field for volts:
        they go into the effort of a joint of another name, which is not taken for a force on this
        one.

    """
    if STREAMS[stream] == 'um':
        return {'name': [joint], 'position': [value / _UM_PER_M]}
    return {'name': [f'{joint}_{stream}_{STREAMS[stream]}'], 'effort': [value]}
