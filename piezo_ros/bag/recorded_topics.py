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
Which topic carries which stream of which rig.

As a rule a stream is on ``<namespace>/<stream>``. Where it was remapped, the metadata record of the
bag says so: ``topic.<stream>`` is the topic, ``namespace`` that of the rig. A foreign recording has
no such record; there the label that every block carries tells the stream.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from mcap.records import Channel, Metadata, Schema

from piezo_ros.parameters.role_parameters import full_name
from piezo_ros.streams import STREAMS
from piezo_ros.streams.message_type import TYPE_NAME

__all__ = [
    'NAMESPACE_KEY',
    'TOPIC_KEY',
    'Place',
    'Rigs',
    'array_topic',
    'check_topics',
    'named_topics',
    'remapped_entries',
    'remapped_part',
    'unlike_stream',
    'unlike_words',
]

NAMESPACE_KEY: Final = 'namespace'
TOPIC_KEY: Final = 'topic.'
_COPIES: Final = '/recorded'  # <namespace>/recorded/<stream>: the same samples, for a recorder
_ABSOLUTE: Final = re.compile(r'(/[A-Za-z0-9_]+)+')


class Place(NamedTuple):
    """Namespace of a rig and one of its streams."""

    namespace: str
    stream: str


def array_topic(schemas: Mapping[int, Schema], channel: Channel | None) -> str | None:
    """Return the topic of a channel, None if its messages are of a type that no stream has."""
    if channel is None or channel.message_encoding != 'cdr':
        return None
    schema = schemas.get(channel.schema_id)
    return None if schema is None or schema.name != TYPE_NAME else channel.topic


def unlike_stream(schemas: Mapping[int, Schema], channel: Channel) -> str | None:
    """Return why a topic with the name of a stream is none, and the remedy; None if it is one."""
    if _last(channel.topic) not in STREAMS:
        return None
    schema = schemas.get(channel.schema_id)
    type_name = 'an unknown type' if schema is None else schema.name
    encoding = channel.message_encoding
    if encoding == 'ros1':
        return (
            f'carries {type_name} of ROS 1, `rosbags-convert` of the package rosbags turns it into '
            'ROS 2')
    if encoding != 'cdr':
        return (
            f'has the encoding {encoding!r}, a stream is in cdr: publish it in ROS 2, as '
            'foxglove_bridge does, and record it with `ros2 bag record -s mcap`')
    if type_name != TYPE_NAME:
        return (
            f'is of type {type_name}, a stream is of {TYPE_NAME}: `ros2 bag play` it into a node '
            'that publishes this type, and record that')
    return None


def unlike_words(unlike: Mapping[str, str]) -> str:
    """Return the end of a sentence that says why topics with the names of streams are none."""
    return ''.join(f'; {topic} {why}' for topic, why in sorted(unlike.items()))


def check_topics(topics: Mapping[str, str], namespace: str | None) -> None:
    """
    Refuse topics and namespaces that a bag cannot contain.

    Raises
    ------
    ValueError
        If there is no such stream, a name is not absolute, or two streams share a topic.

    """
    if namespace not in (None, '/') and not _ABSOLUTE.fullmatch(str(namespace)):
        raise ValueError(f'namespace {namespace!r} must be / or absolute, such as /rig')
    streams: dict[str, str] = {}
    for stream, name in topics.items():
        if stream not in STREAMS:
            raise ValueError(f'stream {stream!r} is none of {", ".join(STREAMS)}')
        if not _ABSOLUTE.fullmatch(name):
            raise ValueError(
                f'topic name {name!r} of {stream!r} must be absolute, such as /rig/{stream}')
        if name in streams:
            raise ValueError(
                f'topic name {name!r} is that of {streams[name]!r} and of {stream!r}, each stream '
                'needs one of its own')
        streams[name] = stream


def remapped_entries(topics: Mapping[str, str], namespace: str | None) -> dict[str, str]:
    """
    Return the entries of the metadata record that tell where remapped streams are.

    Parameters
    ----------
    topics : mapping of str to str
        Stream to topic.
    namespace : str or None
        Namespace of the rig; None for the longest one that the topics have in common.

    Returns
    -------
    dict of str to str
        Empty where the topics tell their streams by name.

    """
    if namespace is None:
        if all(_last(name) == stream for stream, name in topics.items()):
            return {}
        namespace = _common_parent(topics.values())
    remapped = {
        f'{TOPIC_KEY}{stream}': name for stream, name in topics.items()
        if name != full_name(namespace, stream)}
    return {NAMESPACE_KEY: namespace, **remapped} if remapped else {}


def remapped_part(record: Mapping[str, str]) -> dict[str, str]:
    """Return the entries of a metadata record that `remapped_entries` has made."""
    return {
        key: value for key, value in record.items()
        if key == NAMESPACE_KEY or key.startswith(TOPIC_KEY)}


def named_topics(records: Iterable[Metadata]) -> dict[str, Place]:
    """Return the topics that metadata records of this package name; later records win."""
    return {
        name: Place(record.metadata.get(NAMESPACE_KEY, '/'), key[len(TOPIC_KEY):])
        for record in records for key, name in record.metadata.items()
        if key.startswith(TOPIC_KEY) and key[len(TOPIC_KEY):] in STREAMS}


class Rigs:
    """
    The streams of a bag by rig.

    A topic that the record names belongs to the rig that the record names. Any other topic belongs
    to the rig in the namespace of its own name if its last component is the name of its stream. A
    topic that only the label of its blocks identifies belongs to the one rig that there is,
    provided that no other topic carries this stream; else it counts as a stream of a rig in the
    namespace of its own name.

    Parameters
    ----------
    streams : mapping of str to str
        Topic to the stream that its blocks are of.
    named : mapping of str to Place
        As returned by `named_topics`.

    Attributes
    ----------
    topics : dict of str to dict
        Namespace to its streams, and these to their topics; several topics where it is not clear
        which of them carries the stream.
    choices : list of str
        Namespaces to choose from, without those that only repeat streams of other namespaces.
    labelled : list of str
        The topics that only the label of their blocks identifies.

    """

    def __init__(self, streams: Mapping[str, str], named: Mapping[str, Place]) -> None:
        self.topics: dict[str, dict[str, list[str]]] = {}
        self.labelled: list[str] = []
        for topic, stream in streams.items():
            if topic in named:
                self._put(named[topic].namespace, stream, topic)
            elif _last(topic) == stream:
                self._put(_parent(topic), stream, topic)
            else:
                self.labelled.append(topic)
        copies = self._copies({streams[topic] for topic in self.labelled})
        clear = {
            stream for namespace, own in self.topics.items() if namespace not in copies
            for stream in own}
        rigs = {_parent(name) if name in copies else name for name in self.topics}
        self._put_labelled(streams, clear, rigs)
        self.choices = [
            namespace for namespace, own in self.topics.items()
            if not (namespace in copies and own.keys() <= self.topics.get(
                _parent(namespace), {}).keys())
            and not (namespace not in rigs | copies and own.keys() <= clear)]

    def _put(self, namespace: str, stream: str, topic: str) -> None:
        self.topics.setdefault(namespace, {}).setdefault(stream, []).append(topic)

    def _copies(self, labelled: set[str]) -> set[str]:
        """Return the namespaces of copies for a recorder; a rig may have such a name too."""
        return {
            namespace for namespace, own in self.topics.items() if namespace.endswith(_COPIES)
            and (_parent(namespace) in self.topics or labelled & own.keys())}

    def _put_labelled(
        self, streams: Mapping[str, str], clear: set[str], rigs: set[str],
    ) -> None:
        """Find a namespace for each topic that only the label of its blocks identifies."""
        counts = Counter(streams[topic] for topic in self.labelled)
        common = _common_parent(self.labelled)
        one_rig = not rigs and all(count == 1 for count in counts.values())
        for topic in self.labelled:
            stream, parent = streams[topic], _parent(topic)
            if stream in clear:
                # A repetition, as topic_tools relay publishes it, unless the rig in this namespace
                # lacks the stream.
                if stream not in self.topics.get(parent, {}) or parent not in rigs:
                    self._put(parent, stream, topic)
            elif counts[stream] == 1 and len(rigs) == 1:
                self._put(next(iter(rigs)), stream, topic)
            else:
                self._put(common if one_rig else parent, stream, topic)


def _last(topic: str) -> str:
    return topic.rpartition('/')[2]


def _parent(topic: str) -> str:
    return topic.rpartition('/')[0] or '/'


def _common_parent(topics: Iterable[str]) -> str:
    """Return the longest namespace that topics have in common."""
    common: list[str] | None = None
    for topic in topics:
        parts = topic.split('/')[1:-1]
        if common is None:
            common = parts
        while common != parts[:len(common)]:
            common.pop()
    return '/' + '/'.join(common or [])
