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
The demand: how far the trajectory may send, published by the node that consumes its samples.

It only grows during a run. A zero says that nothing more is wanted.
"""

from collections.abc import Iterable

from std_msgs.msg import UInt64

from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.running_time import RunningTime
from piezo_ros.runtime.streams.fault import StreamFault
from piezo_ros.runtime.streams.qos import LATCHED
from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.writer_names import names_of_endpoints, wrong_writers

__all__ = ['DemandReader', 'DemandWriter']


class DemandWriter:
    """
    Publishes an index that leads the consumed one, renewed each half.

    Parameters
    ----------
    node : LoopNode
        The consumer.

    """

    def __init__(self, node: LoopNode) -> None:
        self._node = node
        self._lookahead = 0
        self._publisher = node.create_own_publisher(UInt64, 'demand', LATCHED)
        self._renew_at = 0

    def start(self, consumed: int, lookahead_samples: int) -> None:
        """Ask for the first samples, and from now on lead what is consumed by so many."""
        self._lookahead = lookahead_samples
        self._renew_at = consumed
        self.update(consumed)

    def update(self, consumed: int) -> None:
        """Ask for more once half of it is consumed."""
        if consumed >= self._renew_at:
            self._renew_at = consumed + (self._lookahead + 1) // 2
            self._publisher.publish(UInt64(data=consumed + self._lookahead))

    def check_kept(self, readers: Iterable[StreamReader], max_buffer_samples: int) -> None:
        """
        Check that no source ignores the demand and sends far too much.

        Raises
        ------
        StreamFault
            If more samples wait than are allowed.

        """
        for reader in readers:
            waiting = len(reader.queue)
            if waiting > max_buffer_samples:
                raise StreamFault(
                    f'{waiting} samples of {reader.subscription.topic_name} wait, allowed are '
                    f'{max_buffer_samples} (max_buffer_samples): its writer does not keep to '
                    f'{self._publisher.topic_name}, or another node writes that too; '
                    f'{self._names_of_writers(reader)}')

    def _names_of_writers(self, reader: StreamReader) -> str:
        """Return which nodes write a stream and the demand, as far as known."""
        return ', '.join(
            f'{topic} is written by {names_of_endpoints(writers) or "no node that is known"}'
            for topic in (reader.subscription.topic_name, self._publisher.topic_name)
            for writers in [self._node.get_publishers_info_by_topic(topic)])

    def end(self) -> None:
        """Ask for nothing more."""
        self._publisher.publish(UInt64(data=0))


class DemandReader:
    """
    Takes the newest demand.

    Parameters
    ----------
    node : LoopNode
        The trajectory.
    topic : str, optional
        Where the demand is.

    Attributes
    ----------
    limit : int
        Samples below this index are demanded.
    newest : int or None
        The newest demand, None before any.
    ended : bool
        Whether nothing more is wanted.

    """

    def __init__(self, node: LoopNode, topic: str = 'demand') -> None:
        self._node = node
        self._subscription = node.create_own_subscription(UInt64, topic, LATCHED)
        self._take_message = self._subscription.handle.take_message
        self.start()

    def start(self) -> None:
        """Begin a run."""
        self.limit = 0
        self.newest: int | None = None
        self.ended = False
        self._lost: RunningTime | None = None  # since when it has had no writer

    @property
    def topic_name(self) -> str:
        """The full name of the topic."""
        return self._subscription.topic_name

    @property
    def writers(self) -> int:
        """Number of its writers."""
        return self._subscription.get_publisher_count()

    def wrong_writers(self) -> str:
        """Return which writers it has, if that is not exactly one, else ''."""
        count = self.writers
        return '' if count == 1 else wrong_writers(self._node, self.topic_name, count)

    def why_ended(self) -> str:
        """
        Return what has ended the demand.

        Raises
        ------
        StreamFault
            If it has several writers, so that it may have been a foreign one.

        """
        why = f'{self.topic_name} is 0: no more samples are demanded'
        if self.writers > 1:
            raise StreamFault(f'{why}; {self.wrong_writers()}')
        return f'{why}{self._by_writers()}'

    def why_none(self) -> str:
        """Return why no sample has been demanded in this run, '' where some were."""
        if self.limit:
            return ''
        said = 'nothing' if self.newest is None else '0 alone, which demands no sample'
        by_writers = self._by_writers() or ' by no node that is known'
        return f'{self.topic_name} has said {said}; it is written{by_writers}'

    def _by_writers(self) -> str:
        writers = names_of_endpoints(self._node.get_publishers_info_by_topic(self.topic_name))
        return f' by {writers}' if writers else ''

    def take(self) -> bool:
        """Take the newest demand; return whether there is a new one."""
        taken = self._take_message(UInt64, False)
        if taken is None:
            return False
        self.newest = taken[0].data
        # A zero before anything was demanded is the end of an earlier run.
        self.ended = taken[0].data == 0 and self.limit > 0
        self.limit = max(self.limit, taken[0].data)
        return True

    def check_writer(self, timeout_s: float) -> None:
        """
        Check that the demand still has a writer.

        Raises
        ------
        StreamFault
            If it has had none for some time, or has several.

        """
        if self.writers > 1:
            raise StreamFault(self.wrong_writers())
        if self.writers:
            self._lost = None
        elif self._lost is None:
            self._lost = RunningTime()
        elif self._lost.elapsed_s() > timeout_s:
            raise StreamFault(f'{self.topic_name} lost its writer')
