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

"""Streams that were remapped in the nodes that write them and not in the node that waits."""

from typing import Final

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.streams.writer_names import names_of_endpoints
from piezo_ros.streams import STREAMS
from piezo_ros.streams.message_type import TYPE_NAME

__all__ = ['streams_elsewhere']

_MOST: Final = 5  # topics to name


def streams_elsewhere(node: NodeHooks) -> str:
    """
    Return what to add to a message that an input has no writer: where blocks may be instead.

    Parameters
    ----------
    node : NodeHooks
        The node that waits, configured.

    Returns
    -------
    str
        '' where every input has a writer, or no other topic has messages of the type of a stream.

    """
    missing = [
        stream for stream in node.required_inputs()
        if not node.count_publishers(node.resolve_topic_name(node.input_topic(stream)))]
    # Copies and newest samples have the name of their stream too.
    others = [
        topic for topic, types in node.get_topic_names_and_types()
        if TYPE_NAME in types and topic.rpartition('/')[2] not in STREAMS
        and node.count_publishers(topic)] if missing else []
    if not others:
        return ''
    names = ', '.join(
        f'{topic} ({names_of_endpoints(node.get_publishers_info_by_topic(topic))})'
        for topic in others[:_MOST])
    return (
        f'; a stream may be on {names}: what is remapped in one node must be remapped in all, as '
        f'by -r {node.input_topic(missing[0])}:={others[0]}')
