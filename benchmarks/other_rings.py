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
The ring of `benchmarks.bare_ring` over other transports, to compare ROS 2 with them.

Run as ``python -m benchmarks.other_rings TRANSPORT ROUNDS HOP DIRECTORY``, one process for each
hop, TRANSPORT being ``socket`` (UNIX datagrams) or ``cyclone`` (Cyclone DDS without ROS). The
process of hop 0 prints the messages per second that complete the ring.
"""

import importlib.util
import os
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from piezo_ros.bag import BlockCodec

__all__ = ['HOPS', 'TRANSPORTS', 'main', 'missing_transport']

HOPS: Final = 3
_TIMEOUT_S: Final = 20.0


class _Link(Protocol):
    """The connections of a hop: from the hop before it and to the one after it."""

    def take(self) -> bytes:
        """Wait for a message."""

    def send(self, message: bytes) -> None:
        """Send a message."""


class _SocketLink:
    """UNIX datagram sockets with addresses in a directory."""

    def __init__(self, hop: int, directory: Path) -> None:
        self._inbox = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._inbox.bind(str(directory / f'hop_{hop}'))
        self._inbox.settimeout(_TIMEOUT_S)
        following = directory / f'hop_{(hop + 1) % HOPS}'
        _wait_for(following.exists)
        self._outbox = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._outbox.connect(str(following))

    def take(self) -> bytes:
        return self._inbox.recv(4096)

    def send(self, message: bytes) -> None:
        self._outbox.send(message)


class _CycloneLink:
    """Topics of Cyclone DDS, reliable and KEEP_ALL, polled as the bare ring polls."""

    def __init__(self, hop: int, directory: Path) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.types import sequence, uint8
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        @dataclass
        class Message(IdlStruct):
            data: sequence[uint8]

        self._message = Message
        participant = DomainParticipant(int(os.environ.get('ROS_DOMAIN_ID', '0')))
        quality = Qos(
            Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepAll)
        name = directory.name
        topics = [
            Topic(participant, f'{name}_{number}', Message)
            for number in (hop, (hop + 1) % HOPS)]
        self._reader = DataReader(participant, topics[0], qos=quality)
        self._writer = DataWriter(participant, topics[1], qos=quality)
        _wait_for(lambda: bool(
            self._reader.get_matched_publications() and self._writer.get_matched_subscriptions()))

    def take(self) -> bytes:
        deadline = time.perf_counter() + _TIMEOUT_S
        while not (taken := self._reader.take(1)):
            os.sched_yield()
            if time.perf_counter() > deadline:
                raise TimeoutError('the ring has stopped')
        return bytes(taken[0].data)

    def send(self, message: bytes) -> None:
        self._writer.write(self._message(message))


TRANSPORTS: Final[dict[str, Callable[[int, Path], _Link]]] = {
    'socket': _SocketLink, 'cyclone': _CycloneLink}


def missing_transport(transport: str) -> str:
    """Return the reason why a transport cannot be used on this machine, '' if it can."""
    if transport == 'socket':
        return '' if hasattr(socket, 'AF_UNIX') else 'this system has no UNIX sockets'
    if importlib.util.find_spec('cyclonedds') is None:
        return 'needs the package cyclonedds (pip install cyclonedds)'
    return ''


def main() -> int:
    """Run one hop."""
    transport, rounds, hop, directory = (
        sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
    codec = BlockCodec('voltage')
    end = codec.encode(0, 1e-5, [])
    try:
        link = TRANSPORTS[transport](hop, directory)
        if hop > 0:
            while True:
                message = link.take()
                link.send(message)
                if message == end:
                    time.sleep(0.2)  # the last message may not have arrived yet
                    return 0
        # The other hops may see the match a little later.
        time.sleep(0.5)
        message = codec.encode_one(0, 1e-5, 0.5)
        start = time.perf_counter()
        for _ in range(rounds):
            link.send(message)
            message = link.take()
        print(rounds / (time.perf_counter() - start), flush=True)
        link.send(end)
        link.take()
    except (OSError, TimeoutError) as error:
        print(f'hop {hop}: {error}', file=sys.stderr)
        return 1
    return 0


def _wait_for(ready: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _TIMEOUT_S
    while not ready():
        if time.monotonic() > deadline:
            raise TimeoutError('the ring is not closed')
        time.sleep(0.005)


if __name__ == '__main__':
    sys.exit(main())
