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
The General Command Set (GCS 2.0) of PI controllers, over TCP or a serial port.

Commands and replies are lines. A reply goes on while a line ends in a space before its line feed.
Whether a command was taken is asked for (``ERR?``) after each.
"""

import socket
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from piezo_ros.hardware.device import DeviceError, Gone, MissingPackage, Refused

__all__ = ['GcsClient', 'recorded_table']

IS_WAVE_RUNNING: Final = b'\x09'
STOP: Final = b'\x18'

_ERRORS: Final = {
    1: 'parameter syntax error',
    2: 'unknown command',
    5: 'unallowable move: is the servo off and the axis free?',
    7: 'position out of limits',
    10: 'stopped by command',
    15: 'invalid axis identifier',
    17: 'parameter out of range',
    23: 'illegal axis',
    54: 'unknown parameter',
    73: 'motion commands are not allowed while a wave generator runs',
}


class _Line(Protocol):
    """A connection of bytes."""

    def send(self, data: bytes) -> None: ...

    def line(self) -> bytes: ...

    def close(self) -> None: ...


class GcsClient:
    """
    Commands and questions to one controller.

    Parameters
    ----------
    address : str
        host:port, or a serial port such as /dev/ttyUSB0.
    baud_rate : int
        Of a serial port.
    timeout_s : float
        How long a reply may take, seconds.

    Raises
    ------
    Gone
        If there is no controller at the address.
    MissingPackage
        If pyserial is not installed, for a serial port.

    """

    def __init__(self, address: str, baud_rate: int, timeout_s: float) -> None:
        self.name = f'controller at {address}'
        try:
            self._line: _Line = (
                _Serial(address, baud_rate, timeout_s) if address.startswith('/')
                else _Tcp(address, timeout_s))
        except OSError as error:
            raise Gone(
                f'{self.name}: no connection ({error}); is it switched on, and free of another '
                'program?') from None

    def ask(self, question: str) -> str:
        """Return the reply to a question, without the line feed at its end."""
        self._send(question.encode('ascii') + b'\n')
        return '\n'.join(self._reply(question))

    def ask_byte(self, command: bytes) -> str:
        """Return the reply to a command of one byte."""
        self._send(command)
        return '\n'.join(self._reply(f'#{command[0]}'))

    def value(self, question: str) -> float:
        """Return the number that a reply of one line is, or has behind its =."""
        reply = self.ask(question)
        try:
            return float(reply.rsplit('=', 1)[-1])
        except ValueError:
            self._raise_error(question)
            raise DeviceError(f'{self.name}: {question} is answered by {reply!r}') from None

    def command(self, text: str) -> None:
        """
        Send a command and ask whether it was taken.

        Raises
        ------
        Refused
            If it was not; the text has the command and the reason.

        """
        self._send(text.encode('ascii') + b'\n')
        self._raise_error(text)

    def stop(self) -> None:
        """Stop everything; the output stays where it is."""
        self._send(STOP)
        self.ask('ERR?')  # 10, as it should be

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def _raise_error(self, text: str) -> None:
        reply = self.ask('ERR?').strip()
        if reply != '0':
            told = _ERRORS.get(int(reply)) if reply.lstrip('-').isdigit() else None
            short = text if len(text) <= 60 else f'{text[:57]}...'
            raise Refused(
                f'{self.name}: {short!r} is refused with error {reply}'
                f'{f", {told}" if told else ""}')

    def _send(self, data: bytes) -> None:
        try:
            self._line.send(data)
        except OSError as error:
            raise self._gone(error) from None

    def _reply(self, question: str) -> list[str]:
        lines = []
        while True:
            try:
                line = self._line.line()
            except TimeoutError:
                line = b''
            except OSError as error:
                raise self._gone(error) from None
            if not line.endswith(b'\n'):
                # A reply that comes late would be taken for that to the next question.
                self.close()
                raise Gone(f'{self.name}: no reply to {question!r} in time; is it still on?')
            text = line[:-1].decode('ascii', 'replace')
            lines.append(text.rstrip(' '))
            if not text.endswith(' '):
                return lines

    def _gone(self, error: Exception) -> Gone:
        self.close()
        return Gone(f'{self.name}: the connection is lost ({error}); is it still on?')


class _Tcp:
    def __init__(self, address: str, timeout_s: float) -> None:
        host, _, port = address.rpartition(':')
        self._socket = socket.create_connection((host, int(port)), timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile('rb')

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def line(self) -> bytes:
        return self._file.readline()

    def close(self) -> None:
        self._file.close()
        self._socket.close()


class _Serial:
    def __init__(self, port: str, baud_rate: int, timeout_s: float) -> None:
        try:
            import serial
        except ImportError as error:
            raise MissingPackage(
                f'a controller on the serial port {port} needs the package pyserial ({error}): '
                "pip install 'piezo_ros[gcs]'") from None
        # Its errors are OSErrors.
        self._port: Any = serial.Serial(port, baud_rate, timeout=timeout_s)

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def line(self) -> bytes:
        return bytes(self._port.readline())

    def close(self) -> None:
        self._port.close()


def recorded_table(reply: str) -> tuple[dict[str, str], NDArray[np.float64]]:
    r"""
    Return header and rows of a table of the data recorder (``DRR?``).

    Parameters
    ----------
    reply : str
        Lines ``# KEY = value`` up to ``# END_HEADER``, then a row for each sample.

    Returns
    -------
    header : dict of str to str
        The header.
    rows : ndarray, shape (samples, columns)
        The values.

    Raises
    ------
    DeviceError
        If it is no such table, or rows are missing.

    Examples
    --------
    >>> header, rows = recorded_table('# DIM = 2\n# NDATA = 1\n# END_HEADER\n1.5\t2.5')
    >>> header['DIM'], rows.tolist()
    ('2', [[1.5, 2.5]])

    """
    head, mark, body = reply.partition('# END_HEADER')
    header = {
        key.strip(): value.strip()
        for key, equals, value in (line.lstrip('# ').partition('=') for line in head.split('\n'))
        if equals}
    try:
        columns, samples = int(header['DIM']), int(header['NDATA'])
        rows = np.array(body.split(), dtype=np.float64).reshape(-1, columns)
    except (KeyError, ValueError) as error:
        raise DeviceError(f'the table of the data recorder cannot be read: {error}') from None
    if not mark or len(rows) != samples or not np.isfinite(rows).all():
        raise DeviceError(
            f'the table of the data recorder has {len(rows)} of {samples} finite rows')
    return header, rows
