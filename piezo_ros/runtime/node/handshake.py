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

"""The handshake before a run: every stream must have its peers before the first sample."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from piezo_ros.runtime.process.running_time import RunningTime

if TYPE_CHECKING:
    from piezo_ros.runtime.node.stage import Stage

__all__ = ['await_peers']

_TELL_WAITING_S = 3.0
_LOOK_S = 0.005


def await_peers(stage: 'Stage') -> str:
    """
    Wait until each needed input of a stage has exactly one writer and each output its readers.

    Parameters
    ----------
    stage : Stage
        The stage, configured.

    Returns
    -------
    str
        '' once all are there, else what is missing after ``handshake_timeout_s``.

    """
    waited = RunningTime()
    if stage.subscribes_late and not stage.readers:
        problem = _wait_while(stage, waited, lambda: _unknown_writer(stage))
        if problem:
            return problem
        stage.create_readers()
    return _wait_while(
        stage, waited,
        lambda: _missing_writer(stage) or _missing_reader(stage) or stage.missing_peers())


def _wait_while(stage: 'Stage', waited: RunningTime, look: Callable[[], str]) -> str:
    """Wait while something is missing; return what it is in the end, '' for nothing."""
    tell_at_s = waited.elapsed_s() + _TELL_WAITING_S
    while problem := look():
        if stage.given_up:
            return 'stopped while waiting for the peers'
        waited_s = waited.elapsed_s()
        if waited_s > stage.settings.handshake_timeout_s:
            return f'{problem} after {stage.settings.handshake_timeout_s:g} s'
        if waited_s > tell_at_s:
            tell_at_s += _TELL_WAITING_S
            stage.get_logger().info(f'waiting: {problem}')
        time.sleep(_LOOK_S)
    return ''


def _unknown_writer(stage: 'Stage') -> str:
    """Return which needed stream has no writer that discovery has told of."""
    for stream in stage.required_inputs():
        topic = stage.resolve_topic_name(stage.input_topic(stream))
        writers = stage.count_publishers(topic)
        if writers != 1:
            return _wrong_number(topic, writers)
    return ''


def _missing_writer(stage: 'Stage') -> str:
    required = stage.required_inputs()
    for stream, reader in stage.readers.items():
        writers = reader.subscription.get_publisher_count()
        if stream in required and writers != 1:
            return _wrong_number(reader.subscription.topic_name, writers)
    return ''


def _wrong_number(topic: str, writers: int) -> str:
    return f'{topic} has {writers} writers, exactly one is needed'


def _missing_reader(stage: 'Stage') -> str:
    needed = stage.settings.required_readers
    for writer in stage.writers.values():
        readers = writer.count_readers()
        if readers < needed:
            return (
                f'{writer.publisher.topic_name} has {readers} reliable readers, {needed} are '
                'needed')
    return ''
