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
Brings inputs of the controller to one index: in mid-stream, or where a scheme needs another input.

Each function is called until it has what it waits for.
"""

from collections.abc import Sequence

from piezo_ros.control.control_law import ControlLaw
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.stream_reader import StreamReader

__all__ = [
    'begin_feedforward',
    'join_streams',
    'reason_to_stop',
    'recall_displacement',
    'unfed_topic',
]


def join_streams(readers: Sequence[StreamReader]) -> int | None:
    """
    Drop what comes before the first sample that all streams have.

    Returns
    -------
    int or None
        Index of that sample, None as long as it has not come.

    """
    while True:
        for reader in readers:
            if not reader.queue and not reader.fill():
                return None
        first = max(reader.queue_index for reader in readers)
        for reader in readers:
            reader.drop_before(first)
        if all(reader.queue for reader in readers):
            return first


def begin_feedforward(feedforward: StreamReader, index: int) -> bool:
    """
    Wait for the feedforward of a sample, and drop what comes before it.

    Parameters
    ----------
    feedforward : StreamReader
        The stream.
    index : int
        Index of the first sample that needs it.

    Returns
    -------
    bool
        Whether it is there.

    Raises
    ------
    StreamFault
        If it will not come: the stream ended before it or begins after it.

    """
    while feedforward.take_from(index):
        pass
    topic = feedforward.subscription.topic_name
    if feedforward.ended and not feedforward.queue:
        raise StreamFault(
            f'{topic} ended before sample {index}, from which on the scheme needs it')
    if not feedforward.queue:
        return False
    if feedforward.queue_index > index:
        raise StreamFault(
            f'{topic} begins at sample {feedforward.queue_index}, the scheme needs it from sample '
            f'{index} on')
    return True


def recall_displacement(
    displacement: StreamReader, index: int, first: int, law: ControlLaw,
) -> bool:
    """
    Tell a control law of the readings that came while the scheme had no use for them.

    Parameters
    ----------
    displacement : StreamReader
        The stream.
    index : int
        Index of the first sample with feedback.
    first : int
        Index of the first sample of the run.
    law : ControlLaw
        Counts samples from the first one of the run.

    Returns
    -------
    bool
        Whether the readings up to the one before the index have come.

    Raises
    ------
    StreamFault
        If the stream begins after the index.

    """
    if displacement.next_index < index:
        displacement.fill()
    while displacement.queue and displacement.queue_index < index:
        law.recall(displacement.queue_index - first, displacement.queue.popleft())
    if displacement.queue_index > index:
        raise StreamFault(
            f'{displacement.subscription.topic_name} begins at sample {displacement.queue_index}, '
            f'feedback at sample {index}')
    return displacement.queue_index == index


def reason_to_stop(displacement: StreamReader, targets: Sequence[StreamReader]) -> str:
    """
    Return which input has ended so early that no command can follow, '' where none has.

    Parameters
    ----------
    displacement : StreamReader
        The readings.
    targets : sequence of StreamReader
        What the scheme needs of the trajectory, the reference first.

    """
    reference = targets[0]
    if displacement.ended:
        # The plant was stopped, or there was a fault, its own or upstream of it.
        return _ended_before(displacement, 'the trajectory')
    # The trajectory was stopped when it had sent one of its streams.
    short = [reader for reader in targets if reader.ended and not reader.queue]
    if short and reference.queue:
        return _ended_before(short[0], reference.subscription.topic_name)
    return ''


def _ended_before(reader: StreamReader, what: str) -> str:
    return f'{reader.subscription.topic_name} ended at sample {reader.next_index}, before {what}'


def unfed_topic(feedforward: StreamReader) -> str:
    """Return the topic of the feedforward if it has no writer and has had none, else ''."""
    subscription = feedforward.subscription
    is_fed = feedforward.received or subscription.get_publisher_count()
    return '' if is_fed else str(subscription.topic_name)
