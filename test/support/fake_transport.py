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
Topics in memory, for tests of readers and writers without middleware, processes or rclpy nodes.

A message is in the queue of every subscription of its topic as soon as it is published. There is
no discovery either: publishers and subscriptions match at once. Of the quality of service, history
and transient-local durability are obeyed.
"""

from collections import defaultdict, deque

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, HistoryPolicy

from piezo_ros.runtime.streams.qos import STREAM
from piezo_ros.runtime.streams.stream_reader import StreamReader
from piezo_ros.runtime.streams.stream_writer import StreamWriter
from piezo_ros.streams import BlockCodec

__all__ = ['PERIOD_S', 'FakeLogger', 'FakeOwner', 'FakeTransport', 'take_all']

PERIOD_S = 1e-5
_NAMESPACE = '/rig'


def full_name(topic):
    return f'{_NAMESPACE}/{topic.removeprefix(_NAMESPACE + "/")}'


class FakeTransport:
    """The topics of one test, and the nodes at their ends."""

    def __init__(self):
        self.publishers = defaultdict(list)
        self.subscriptions = defaultdict(list)
        self.foreign_nodes = []  # name and namespace of nodes that nothing else is known of
        self.servers = 1  # of every service

    def owner(self, name='node'):
        return FakeOwner(self, name)

    def reader(self, stream, owner=None, **arguments):
        return StreamReader(owner or self.owner('reader'), stream, **arguments)

    def writer(self, stream, owner=None, **arguments):
        return StreamWriter(owner or self.owner('writer'), stream, **arguments)

    def subscribe(self, topic, qos=STREAM, owner=None):
        """Return a plain subscription."""
        return FakeSubscription(self, owner or self.owner('onlooker'), topic, qos)

    def publish_block(self, stream, index, samples, period_s=PERIOD_S):
        """Put a block into the queues of a stream, from a writer that nothing knows of."""
        self.publish_bytes(stream, BlockCodec(stream).encode(index, period_s, samples))

    def publish_bytes(self, stream, raw):
        for subscription in self.subscriptions[full_name(stream)]:
            subscription.messages.append(raw)


class _Endpoint:
    def __init__(self, ends, owner, topic, qos):
        self.topic_name = full_name(topic)
        self.qos_profile = qos
        self.node_name, self.node_namespace = owner.get_name(), owner.get_namespace()
        self.handle = self  # as rclpy's own endpoints have one with the functions of rcl
        self._ends = ends[self.topic_name]
        self._ends.append(self)

    def destroy(self):
        self._ends.remove(self)


class FakePublisher(_Endpoint):
    """Publishes raw bytes or typed messages; the next ``refusals`` of the raw ones fail."""

    def __init__(self, transport, owner, topic, qos):
        super().__init__(transport.publishers, owner, topic, qos)
        self.refusals = 0
        self.newest = None
        self._readers = transport.subscriptions[self.topic_name]

    def publish_raw(self, raw):
        if self.refusals:
            self.refusals -= 1
            raise rclpy_implementation.RCLError('timeout')
        self.publish(bytes(raw))

    def publish(self, message):
        self.newest = message
        for subscription in self._readers:
            subscription.messages.append(message)

    def get_subscription_count(self):
        return len(self._readers)

    def wait_for_all_acked(self, _timeout):
        return True


class FakeSubscription(_Endpoint):
    """Keeps what was published, oldest first, in ``messages``."""

    def __init__(self, transport, owner, topic, qos):
        super().__init__(transport.subscriptions, owner, topic, qos)
        is_kept = qos.history == HistoryPolicy.KEEP_LAST
        self.messages = deque(maxlen=qos.depth if is_kept else None)
        self._writers = transport.publishers[self.topic_name]
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self.messages.extend(
                writer.newest for writer in self._writers if writer.newest is not None)

    def take_message(self, message_type, is_raw):
        if not self.messages:
            return None
        message = self.messages.popleft()
        assert isinstance(message, bytes if is_raw else message_type)
        return message, None

    def get_publisher_count(self):
        return len(self._writers)

    def blocks(self, stream):
        """Take everything; return index and samples of each block."""
        codec, taken = BlockCodec(stream), list(self.messages)
        self.messages.clear()
        return [(block.index, list(block.samples)) for block in map(codec.decode, taken)]


class FakeLogger:
    """Keeps what is logged: texts by level."""

    def __init__(self):
        self.texts = defaultdict(list)
        self.debug, self.info, self.warning, self.error, self.fatal = (
            self._keeper(level) for level in ('debug', 'info', 'warning', 'error', 'fatal'))

    def _keeper(self, level):
        return lambda text, **_throttling: self.texts[level].append(text)

    @property
    def warnings(self):
        return self.texts['warning']


class FakeOwner:
    """A `StreamOwner`."""

    def __init__(self, transport, name):
        self.set_up(transport, name)

    def set_up(self, transport, name):
        self.transport, self.name, self.logger = transport, name, FakeLogger()
        self.stop_requested = False
        self.begun_at = []

    def create_stream_publisher(self, message_type, topic, qos):
        return FakePublisher(self.transport, self, topic, qos)

    def create_stream_subscription(self, message_type, topic, qos):
        return FakeSubscription(self.transport, self, topic, qos)

    create_own_publisher = create_publisher = create_stream_publisher
    create_own_subscription = create_stream_subscription

    def begin_at(self, index):
        self.begun_at.append(index)

    def get_logger(self):
        return self.logger

    def get_name(self):
        return self.name

    def get_namespace(self):
        return _NAMESPACE

    def resolve_topic_name(self, topic):
        return full_name(topic)

    def count_publishers(self, topic):
        return len(self.transport.publishers[topic])

    def get_publishers_info_by_topic(self, topic):
        return self.transport.publishers[full_name(topic)]

    def get_node_names_and_namespaces(self):
        """Return the nodes that publish something, each once, and the foreign ones."""
        own = {
            (each.node_name, each.node_namespace)
            for ends in self.transport.publishers.values() for each in ends}
        return [*own, *self.transport.foreign_nodes]

    def get_topic_names_and_types(self):
        """Return the topics with writers, all of one type."""
        return [
            (topic, ['std_msgs/msg/Float64MultiArray'])
            for topic, writers in self.transport.publishers.items() if writers]

    def count_services(self, name):
        return self.transport.servers

    def get_subscriptions_info_by_topic(self, topic):
        return self.transport.subscriptions[topic]


def take_all(reader):
    """Return every sample that a reader takes now."""
    samples = []
    while (taken := reader.take_array()) is not None:
        samples.extend(taken.tolist())
    return samples
