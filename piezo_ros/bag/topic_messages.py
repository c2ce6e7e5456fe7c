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
The messages in the pieces of MCAP files by topic, and whether they are as many as the bag counts.

The statistics of each file and ``metadata.yaml`` count the messages of every topic. Where fewer
were read, the rest is lost, even if every record that is left is whole.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag.container.mcap_file import McapFile, Piece
from piezo_ros.bag.recorded_topics import array_topic

__all__ = ['MessageCounts', 'messages_by_topic']


class MessageCounts:
    """The messages of a bag, counted by topic while they are read."""

    def __init__(self) -> None:
        self._channels: dict[McapFile, Counter[int]] = {}
        self._early: dict[McapFile, set[int]] = {}

    def begin(self, file: McapFile) -> None:
        """Count the messages of a file from here on."""
        self._channels[file] = Counter()

    def add(self, file: McapFile, number: int, messages: int) -> None:
        """Count some messages of a channel."""
        self._channels[file][number] += messages
        if number not in file.channels:
            self._early.setdefault(file, set()).add(number)

    def early(self) -> bool:
        """Return whether messages came ahead of the record that names their topic."""
        return any(
            number in file.channels for file, numbers in self._early.items() for number in numbers)

    def nameless(self) -> list[str]:
        """Return sentences that say how many messages are of no topic."""
        return [
            f'{file.path.name}: {messages} messages of channel {number}, of which no record tells '
            'the topic'
            for file, channels in self._channels.items()
            for number, messages in channels.items() if number not in file.channels]

    def missing(self, listed: Mapping[str, int]) -> list[str]:
        """
        Return sentences that say how many messages are missing.

        Parameters
        ----------
        listed : mapping of str to int
            Topic to number of messages, as ``metadata.yaml`` counts them.

        """
        found: Counter[str] = Counter()
        counted: Counter[str] = Counter()
        for file, channels in self._channels.items():
            statistics = file.summary and file.summary.statistics
            counts = statistics.channel_message_counts if statistics else {}
            for number, channel in file.channels.items():
                found[channel.topic] += channels[number]
                counted[channel.topic] += counts.get(number, 0)
        sentences = []
        for topic in sorted({*counted, *listed}):
            source, due = max(
                ('the statistics', counted[topic]), ('metadata.yaml', listed.get(topic, 0)),
                key=lambda pair: pair[1])
            if found[topic] < due:
                sentences.append(
                    f'{due - found[topic]} of {due} messages of {topic} are missing, as {source} '
                    'counts them')
        return sentences


def messages_by_topic(
    file: McapFile, piece: Piece, counts: MessageCounts | None = None,
) -> dict[str, NDArray[np.int64]]:
    """
    Return the messages of the type that streams have.

    Parameters
    ----------
    file : McapFile
        The file.
    piece : Piece
        A piece of it.
    counts : MessageCounts, optional
        Counts all messages, of whatever type.

    Returns
    -------
    dict of str to ndarray of int64
        Topic to the offsets of its messages, in the order of the file, from whichever of its
        channels.

    """
    found: dict[str, NDArray[np.int64]] = {}
    for number, messages in piece.by_channel():
        if counts is not None:
            counts.add(file, number, messages.size)
        topic = array_topic(file.schemas, file.channels.get(number))
        if topic is None:
            continue
        if topic in found:
            messages = np.sort(np.concatenate([found[topic], messages]))
        found[topic] = messages
    return found
