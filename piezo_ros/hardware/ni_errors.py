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

"""Errors of NI-DAQmx as errors of a device, by their codes: these are the same on every way."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from piezo_ros.hardware.device import (
    DeviceError,
    Gone,
    MissingPackage,
    Overflow,
    RateRefused,
    Refused,
    Reserved,
    Underflow,
)

__all__ = ['NOT_YET', 'NO_ROOM', 'code_of', 'is_underflow', 'client_library', 'translated']

NOT_YET: Final = -200284  # fewer readings than asked for within the timeout
NO_ROOM: Final = -200292  # fewer samples written than asked for within the timeout

_UNDERFLOW: Final = frozenset({-200290, -200621, -200462})
_OVERFLOW: Final = frozenset({-200279, -200361})
_RESERVED: Final = frozenset({-50103, -201420, -201105, -200587, -201477})
_GONE: Final = frozenset({-201003, -88705, -88708, -88710, -50405, -50104, -201401, -200088})
_RATE: Final = frozenset({-200332, -200081})
_HELP: Final = {
    -200220: 'no such device; `piezo device list` names those that are there',
    -200170: 'no such channel on the device',
    -200963: 'the analogue output is in use with another timing; end that program',
    -200560: 'the output did not finish in time',
}


def client_library() -> Any:
    """
    Return the module nidaqmx.

    Raises
    ------
    MissingPackage
        If it is not installed.

    """
    try:
        import nidaqmx
    except ImportError as error:
        raise MissingPackage(
            f'the device ni needs the package nidaqmx ({error}): '
            "pip install 'piezo_ros[ni]'") from None
    return nidaqmx


def code_of(error: Exception) -> int | None:
    """Return the code of an error of NI-DAQmx, None if it has none."""
    code = getattr(error, 'error_code', None)
    return None if code is None else int(code)


def is_underflow(error: Exception) -> bool:
    """Return whether the output has run out of samples."""
    return code_of(error) in _UNDERFLOW


@contextmanager
def translated(name: str, generated: int = 0) -> Iterator[None]:
    """
    Raise what nidaqmx raises as errors of a device.

    Parameters
    ----------
    name : str
        Device and channels, for the message.
    generated : int, optional
        Voltages that have gone out, for an underflow.

    """
    nidaqmx = client_library()
    try:
        yield
    except nidaqmx.errors.Error as error:
        raise _device_error(name, error, generated) from error


def _device_error(name: str, error: Exception, generated: int) -> DeviceError:
    code = code_of(error)
    # The first paragraph says it; then follow the task and the code.
    text = str(error).split('\n\n')[0].replace('\n', ' ').strip()
    if code is None:
        if hasattr(error, 'rpc_code'):
            return Gone(f'{name}: the device server does not answer ({text}); is it running?')
        if type(error).__name__ in ('DaqNotFoundError', 'DaqNotSupportedError'):
            return Gone(
                f'{name}: the NI-DAQmx driver is not installed on this machine; install it, or '
                "set address to 'host:port' of a device server")
        return DeviceError(f'{name}: {text}')
    told = f'{name}: {text} (code {code})'
    if code in _UNDERFLOW:
        return Underflow(
            f'{name}: the output ran out of samples at index {generated} (code {code}); write '
            'voltages sooner, or prefill more', generated)
    if code in _OVERFLOW:
        return Overflow(f'{told}; read more often, or in larger blocks')
    if code in _RESERVED:
        return Reserved(
            f'{told}; another program or session holds it: end that program, or restart the '
            'device server')
    if code in _GONE:
        return Gone(f'{told}; is it connected and powered?')
    if code in _RATE:
        return RateRefused(f'{told}; take a longer sample period')
    return Refused(f'{told}; {_HELP[code]}' if code in _HELP else told)
