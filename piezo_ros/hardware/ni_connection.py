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
The way to an NI-DAQmx card: through the local driver, or through a device server (gRPC).

A session of a device server outlives the program that made it. Sessions therefore have names of
this machine and card: the next program clears what a killed one has left behind, without a reset,
so that the output goes on holding its voltage. A lock that dies with its process tells such
left-overs from the sessions of a program that still runs.
"""

import hashlib
import os
import platform
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from piezo_ros.hardware.device import Gone, MissingPackage, Reserved
from piezo_ros.hardware.ni_errors import client_library, translated
from piezo_ros.user_directories import temporary_directory

__all__ = ['NiConnection']

ROLES: Final = ('input', 'output', 'slow_input', 'slow_output', 'held')
_LARGEST_MESSAGE: Final = 64 * 2**20  # bytes; blocks are sent in pieces far smaller than that


class NiConnection:
    """
    Tasks on one card, by name.

    Parameters
    ----------
    address : str
        '' for the local driver, else host:port of a device server.
    card : str
        Name of the card, for example Dev1.
    deadline_s : float
        Time after which a server that does not answer is gone, seconds.

    """

    def __init__(self, address: str, card: str, deadline_s: float) -> None:
        self.address = address
        self.card = card
        self.name = f'{card} at {address}' if address else card
        self._nidaqmx = client_library()
        self._deadline_s = deadline_s
        self._channel: Any = None
        self._lock: int | None = None
        with translated(self.name):
            version = self.system.driver_version
        # The client swallows every error of its first contact.
        if version.major_version == 0:
            raise Gone(
                f'{self.name}: no answer from the device server; is it running there?' if address
                else f'{self.name}: the NI-DAQmx driver does not tell its version')

    @property
    def system(self) -> Any:
        """The `nidaqmx.system.System` that the card is in."""
        system = self._nidaqmx.system.System
        return system.remote(self._options('')) if self.address else system.local()

    def device(self) -> Any:
        """Return the `nidaqmx.system.Device`."""
        from nidaqmx.system import Device
        return Device(self.card, grpc_options=self._options('')) if self.address else Device(
            self.card)

    def acquire(self) -> None:
        """
        Take the card for this process, and clear what a killed one has left on a server.

        Raises
        ------
        Reserved
            If another process of this machine has it.

        """
        if not self.address:
            return  # the driver ends the tasks of a process that dies
        self._lock = _locked(self.address, self.card)
        for role in ROLES:
            self._clear_left_over(role)

    def close(self) -> None:
        """Let others have the card, and close the way to the server; `acquire` opens it again."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    def task(self, role: str) -> Any:
        """Return a new `nidaqmx.Task`, one for each role at a time."""
        name = self._session_name(role)
        if not self.address:
            # A name may be in use by another device of this process.
            return self._nidaqmx.Task()
        from nidaqmx.grpc_session_options import SessionInitializationBehavior
        return self._nidaqmx.Task(name, grpc_options=self._options(
            name, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION))

    def _clear_left_over(self, role: str) -> None:
        from nidaqmx.grpc_session_options import SessionInitializationBehavior
        name = self._session_name(role)
        try:
            task = self._nidaqmx.Task(name, grpc_options=self._options(
                name, SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION))
        except self._nidaqmx.errors.RpcError as error:
            if _is_unreachable(error):
                with translated(self.name):
                    raise
            return  # no such session, as it should be
        except self._nidaqmx.errors.DaqError:
            return
        with translated(self.name):
            task.close()

    def _session_name(self, role: str) -> str:
        return 'piezo_ros_' + re.sub(r'\W', '_', f'{platform.node()}_{self.card}_{role}')

    def _options(self, name: str, behavior: Any = None) -> Any:
        from nidaqmx import GrpcSessionOptions
        if self._channel is None:
            self._channel = _grpc_channel(self.address, self._deadline_s)
        more = {} if behavior is None else {'initialization_behavior': behavior}
        return GrpcSessionOptions(self._channel, name, **more)


def _is_unreachable(error: Any) -> bool:
    import grpc
    return error.rpc_code in (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)


def _grpc_channel(address: str, deadline_s: float) -> Any:
    """Return a channel on which no call waits for ever."""
    try:
        import grpc
    except ImportError as error:
        raise MissingPackage(
            f'the device ni needs the package grpcio for the address {address!r} ({error}): '
            "pip install 'piezo_ros[ni]'") from None

    class Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc, unused-ignore]
        def intercept_unary_unary(
            self, continuation: Callable[..., Any], details: Any, request: Any,
        ) -> Any:
            # Reads and writes bring a time-out of their own, after which the server answers.
            own_s = getattr(request, 'timeout', None) or getattr(request, 'time_to_wait', 0.0)
            return continuation(
                _Call(details, deadline_s + max(float(own_s or 0.0), 0.0)), request)

    class _Call(grpc.ClientCallDetails):  # type: ignore[misc, unused-ignore]
        def __init__(self, details: Any, timeout_s: float) -> None:
            self.method, self.metadata = details.method, details.metadata
            self.credentials, self.timeout = details.credentials, timeout_s
            self.wait_for_ready = getattr(details, 'wait_for_ready', None)
            self.compression = getattr(details, 'compression', None)

    channel = grpc.insecure_channel(address, options=[
        ('grpc.max_receive_message_length', _LARGEST_MESSAGE),
        ('grpc.max_send_message_length', _LARGEST_MESSAGE),
        # A local server is not behind a proxy.
        ('grpc.enable_http_proxy', 0)])
    return grpc.intercept_channel(channel, Deadline())


def _locked(address: str, card: str) -> int:
    """Return the descriptor of a locked file; the lock goes with the process."""
    import fcntl
    digest = hashlib.sha256(f'{address} {card}'.encode()).hexdigest()[:16]
    path = Path(temporary_directory()) / f'ni-{digest}.lock'
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        holder = os.read(descriptor, 32).decode('ascii', 'replace').strip()
        os.close(descriptor)
        raise Reserved(
            f'{card} at {address}: process {holder or "unknown"} of this machine holds it; end '
            'that one first') from None
    os.truncate(descriptor, 0)
    os.pwrite(descriptor, str(os.getpid()).encode(), 0)
    return descriptor
