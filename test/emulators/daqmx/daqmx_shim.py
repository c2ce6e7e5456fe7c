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
The virtual card behind the C functions of NI-DAQmx, in place of the local driver.

`build` makes libnidaqmx.so.1 of daqmx_shim.c; `installed` lets the vendor's client find it, and
connects it to a card, in this process only.
"""

import contextlib
import ctypes
import subprocess
from pathlib import Path
from unittest import mock

import numpy as np
from daqmx.daqmx_service import DRIVER_VERSION, device_attribute, set_task_attribute
from daqmx.virtual_card import DaqmxFault

SOURCE = Path(__file__).with_name('daqmx_shim.c')
P, U, D, S = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_double, ctypes.c_char_p
INT = ctypes.c_int32
DOUBLE_ATTRIBUTES = (0x298C, 0x298E, 0x2997, 0x2998)


def build(compiler, folder):
    """Build the library with a C compiler and return its path."""
    library = Path(folder) / 'libnidaqmx.so.1'
    subprocess.run(
        [compiler, '-shared', '-fPIC', '-Wl,-soname,libnidaqmx.so.1', '-o', library, SOURCE],
        check=True)
    return library


SIGNATURES = {
    'CreateTask': (S, P), 'ClearTask': (P,), 'StartTask': (P,), 'StopTask': (P,),
    'IsTaskDone': (P, P), 'WaitUntilTaskDone': (P, D),
    'CreateAIVoltageChan': (P, S, S, INT, D, D, INT, S),
    'CreateAOVoltageChan': (P, S, S, D, D, INT, S),
    'CfgSampClkTiming': (P, S, D, INT, INT, ctypes.c_uint64),
    'ReadAnalogF64': (P, INT, D, U, P, U, P, P), 'ReadAnalogScalarF64': (P, D, P, P),
    'WriteAnalogF64': (P, INT, U, D, U, P, P, P), 'WriteAnalogScalarF64': (P, U, D, D, P),
    'GetTaskAttribute': (P, INT, P, U), 'GetTimingAttribute': (P, INT, P, U),
    'GetWriteAttribute': (P, INT, P, U), 'SetWriteAttribute': (P, INT, U),
    'SetBufferAttribute': (P, INT, U), 'GetDeviceAttribute': (S, INT, P, U),
    'GetSystemInfoAttribute': (INT, P, U), 'GetErrorString': (INT, P, U),
    'GetExtendedErrorInfo': (P, U)}


class Functions:
    """What each C function does with the card; each returns a code."""

    def __init__(self, card):
        self.card = card
        self.text = ''
        self._names = {}

    def call(self, name, *arguments):
        try:
            return getattr(self, name)(*arguments) or 0
        except DaqmxFault as fault:
            self.text = fault.text
            return fault.code

    def CreateTask(self, name, task):  # noqa: N802
        handle = len(self._names) + 1
        self._names[handle] = self.card.create_task(name.decode())
        P.from_address(task).value = handle

    def ClearTask(self, task):  # noqa: N802
        self.card.clear_task(self._names[task])

    def StartTask(self, task):  # noqa: N802
        self.card.start(self._names[task])

    def StopTask(self, task):  # noqa: N802
        self.card.stop(self._names[task])

    def IsTaskDone(self, task, done):  # noqa: N802
        U.from_address(done).value = self.card.is_done(self._names[task])

    def WaitUntilTaskDone(self, task, timeout_s):  # noqa: N802
        self.card.wait_until_done(self._names[task], timeout_s)

    def CreateAIVoltageChan(self, task, channel, _1, _2, low, high, _3, _4):  # noqa: N802
        self.card.add_channels(self._names[task], channel.decode(), low, high, is_output=False)

    def CreateAOVoltageChan(self, task, channel, _1, low, high, _2, _3):  # noqa: N802
        self.card.add_channels(self._names[task], channel.decode(), low, high, is_output=True)

    def CfgSampClkTiming(self, task, source, rate_hz, _edge, mode, samples):  # noqa: N802
        self.card.configure_clock(
            self._names[task], rate_hz, (source or b'').decode(), mode, samples)

    def ReadAnalogF64(self, task, samples, timeout_s, _fill, values, size, read, _):  # noqa: N802
        code = 0
        try:
            readings_v = self.card.read(self._names[task], samples, timeout_s)
        except DaqmxFault as fault:
            if fault.readings is None:
                raise
            self.text, code, readings_v = fault.text, fault.code, fault.readings
        array = np.ctypeslib.as_array((D * size).from_address(values))
        for index, row in enumerate(readings_v):
            array[index * samples:index * samples + row.size] = row
        INT.from_address(read).value = readings_v.shape[1]
        return code

    def ReadAnalogScalarF64(self, task, timeout_s, value, _):  # noqa: N802
        D.from_address(value).value = self.card.read(self._names[task], 1, timeout_s)[0, 0]

    def WriteAnalogF64(  # noqa: N802
            self, task, samples, start, timeout_s, _layout, values, written, _):
        array = np.ctypeslib.as_array((D * samples).from_address(values)).copy()
        count = INT.from_address(written)
        try:
            count.value = self.card.write(self._names[task], array, timeout_s, bool(start))
        except DaqmxFault as fault:
            count.value = fault.count or 0
            raise

    def WriteAnalogScalarF64(self, task, start, timeout_s, value, _):  # noqa: N802
        self.card.write(self._names[task], [value], timeout_s, bool(start))

    def GetTaskAttribute(self, task, _attribute, value, size):  # noqa: N802
        return put_text(self._names[task], value, size)

    def GetTimingAttribute(self, task, _attribute, value, _):  # noqa: N802
        D.from_address(value).value = self.card.actual_rate_hz(self._names[task])

    def GetWriteAttribute(self, task, _attribute, value, _):  # noqa: N802
        ctypes.c_uint64.from_address(value).value = self.card.generated(self._names[task])

    def SetWriteAttribute(self, task, attribute, value):  # noqa: N802
        set_task_attribute(self.card, self._names[task], attribute, value)

    SetBufferAttribute = SetWriteAttribute

    def GetDeviceAttribute(self, device, attribute, value, size):  # noqa: N802
        self.card.require(device.decode())
        found = device_attribute(self.card, attribute)
        if isinstance(found, str):
            return put_text(found, value, size)
        if isinstance(found, list):
            if not size:
                return len(found)
            np.ctypeslib.as_array((D * size).from_address(value))[:len(found)] = found
        else:
            kind = D if attribute in DOUBLE_ATTRIBUTES else U
            kind.from_address(value).value = found
        return 0

    def GetSystemInfoAttribute(self, attribute, value, size):  # noqa: N802
        if attribute in DRIVER_VERSION:
            U.from_address(value).value = DRIVER_VERSION[attribute]
            return 0
        return put_text(self.card.name, value, size)

    def GetErrorString(self, code, text, size):  # noqa: N802
        return put_text(f'Status {code}', text, size)

    def GetExtendedErrorInfo(self, text, size):  # noqa: N802
        return put_text(self.text, text, size)


def put_text(text, address, size):
    """Put a text into a buffer; without one, return the size that it needs."""
    encoded = text.encode()[:max(0, size - 1) if size else None] + b'\0'
    if not size:
        return len(encoded)
    ctypes.memmove(address, encoded, len(encoded))
    return 0


@contextlib.contextmanager
def installed(library, card):
    """Let nidaqmx take a built library for the driver, with a card behind it."""
    from nidaqmx import _lib, _library_interpreter
    functions = Functions(card)
    loaded = ctypes.CDLL(str(library))
    kept, before = [], {}
    for name, signature in SIGNATURES.items():
        def forward(*arguments, name=name):
            return functions.call(name, *arguments)
        kept.append(ctypes.CFUNCTYPE(INT, *signature)(forward))
        pointer = P.in_dll(loaded, f'forward_{name}')
        before[name] = pointer.value
        pointer.value = ctypes.cast(kept[-1], P).value
    importer = _lib.DaqLibImporter()
    with mock.patch.object(_lib, 'find_library', return_value=str(library)), \
            mock.patch.object(_lib, 'lib_importer', importer), \
            mock.patch.object(_library_interpreter, 'lib_importer', importer):
        yield functions
    for name, address in before.items():
        P.in_dll(loaded, f'forward_{name}').value = address
