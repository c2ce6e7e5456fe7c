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
The handshake before a run, and the acknowledgement after it.

Every stream must have its peers before the first sample, and every reader the end of the run.
"""

import time
from collections.abc import Callable, Iterable

from rclpy.duration import Duration
from rclpy.publisher import Publisher

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.name_twins import warn_of_twins
from piezo_ros.runtime.node.remapped_streams import streams_elsewhere
from piezo_ros.runtime.process.running_time import RunningTime, busy_words
from piezo_ros.runtime.streams.writer_names import wrong_writers

__all__ = ['await_acknowledgements', 'await_peers']

_ACKNOWLEDGE = Duration(seconds=0.1)
_TELL_WAITING_S = 3.0
_LOOK_S = 0.005


def await_peers(node: NodeHooks) -> str:
    """
    Wait until each needed input of a node has exactly one writer and each output its readers.

    Parameters
    ----------
    node : NodeHooks
        The node, configured.

    Returns
    -------
    str
        '' once all are there, else what is missing after ``handshake_timeout_s``.

    """
    waited = RunningTime()
    if node.subscribes_late and not node.readers:
        problem = _wait_while(node, waited, lambda: _unknown_writer(node))
        if problem:
            return problem
        node.create_readers()
    problem = _wait_while(
        node, waited,
        lambda: _missing_writer(node) or _missing_reader(node) or node.missing_peers())
    warn_of_twins(node)
    return problem


def _wait_while(node: NodeHooks, waited: RunningTime, look: Callable[[], str]) -> str:
    """Wait while something is missing; return what it is in the end, '' for nothing."""
    tell_at_s = waited.elapsed_s() + _TELL_WAITING_S
    while problem := look():
        if node.given_up:
            return 'stopped while waiting for the peers'
        waited_s = waited.elapsed_s()
        if waited_s > node.settings.handshake_timeout_s:
            timeout_s = node.settings.handshake_timeout_s
            return (
                f'{problem} after {timeout_s:g} s (handshake_timeout_s)'
                f'{streams_elsewhere(node)}{busy_words()}')
        if waited_s > tell_at_s:
            tell_at_s += _TELL_WAITING_S
            node.get_logger().info(f'waiting: {problem}{streams_elsewhere(node)}{busy_words()}')
        time.sleep(_LOOK_S)
    return ''


def _unknown_writer(node: NodeHooks) -> str:
    """Return which needed stream has no writer that discovery has told of."""
    for stream in node.required_inputs():
        topic = node.resolve_topic_name(node.input_topic(stream))
        writers = node.count_publishers(topic)
        if writers != 1:
            return wrong_writers(node, topic, writers)
    return ''


def _missing_writer(node: NodeHooks) -> str:
    required = node.required_inputs()
    for stream, reader in node.readers.items():
        writers = reader.subscription.get_publisher_count()
        if stream in required and writers != 1:
            return wrong_writers(node, reader.subscription.topic_name, writers)
    return ''


def _missing_reader(node: NodeHooks) -> str:
    needed = node.settings.required_readers
    for writer in node.writers.values():
        readers = writer.count_readers()
        if readers < needed:
            return (
                f'{writer.publisher.topic_name} has {readers} reliable readers, {needed} are '
                'needed')
    return ''


def await_acknowledgements(
    publishers: Iterable[Publisher], has_time: Callable[[], bool],
) -> None:
    """
    Wait until every reader has what was published.

    Parameters
    ----------
    publishers : iterable of Publisher
        What has published it.
    has_time : callable
        Whether to go on waiting for a reader, which may be dead; asked ten times a second.

    """
    for publisher in publishers:
        # Once at least: a reader that has everything already is not waited for.
        while not publisher.wait_for_all_acked(_ACKNOWLEDGE) and has_time():
            pass
