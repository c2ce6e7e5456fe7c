"""The handshake before a run: every stream must have its peers before the first sample."""

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from piezo_ros.nodes.stage import Stage

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
    began = time.monotonic()
    deadline = began + stage.settings.handshake_timeout_s
    tell_at = began + _TELL_WAITING_S
    while problem := _missing_writer(stage) or _missing_reader(stage) or stage.missing_peers():
        if stage.stop_requested:
            return 'stopped while waiting for the peers'
        now = time.monotonic()
        if now > deadline:
            return f'{problem} after {stage.settings.handshake_timeout_s:g} s'
        if now > tell_at:
            tell_at += _TELL_WAITING_S
            stage.get_logger().info(f'waiting: {problem}')
        time.sleep(_LOOK_S)
    return ''


def _missing_writer(stage: 'Stage') -> str:
    required = stage.required_inputs()
    for stream, reader in stage.readers.items():
        writers = reader.subscription.get_publisher_count()
        if stream in required and writers != 1:
            return (
                f'{reader.subscription.topic_name} has {writers} writers, exactly one is needed')
    return ''


def _missing_reader(stage: 'Stage') -> str:
    needed = stage.settings.required_readers
    for writer in stage.writers.values():
        # A recorder reads the stream or its copy.
        readers = sum(publisher.get_subscription_count() for publisher in writer.publishers)
        if readers < needed:
            return f'{writer.publisher.topic_name} has {readers} readers, {needed} are needed'
    return ''
