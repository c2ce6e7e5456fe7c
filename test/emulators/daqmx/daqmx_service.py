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

"""The virtual card behind the stubs that the vendor has generated for its device server."""

import contextlib
import threading
from concurrent import futures

import grpc
from daqmx.virtual_card import DaqmxFault
from nidaqmx._stubs import nidaqmx_pb2, nidaqmx_pb2_grpc

DRIVER_VERSION = {0x1272: 26, 0x1923: 8, 0x2F22: 0}
ATTACH, NEW = 2, 1
LARGEST_MESSAGE = 4 * 2**20  # the default of gRPC


class DaqmxService(nidaqmx_pb2_grpc.NiDAQmxServicer):
    """What the package calls of the 451 methods, and no more."""

    def __init__(self, card):
        self.card = card
        self._lock = threading.RLock()
        self.log = []  # (method, request), for tests of what was asked for

    @contextlib.contextmanager
    def _answered(self, context, request):
        """Hand the fault of a card over as the vendor's server does."""
        self.log.append(request)
        try:
            with self._lock:
                yield
        except DaqmxFault as fault:
            metadata = [('ni-error', str(fault.code))]
            if fault.count is not None:
                kind = 'written' if 'Write' in type(request).__name__ else 'read'
                metadata.append((f'ni-samps-per-chan-{kind}', str(fault.count)))
            context.set_trailing_metadata(metadata)
            context.abort(grpc.StatusCode.UNKNOWN, fault.text)

    # The system and the card

    def GetSystemInfoAttributeUInt32(self, request, context):  # noqa: N802
        return nidaqmx_pb2.GetSystemInfoAttributeUInt32Response(
            value=DRIVER_VERSION[request.attribute_raw or request.attribute])

    def GetSystemInfoAttributeString(self, request, context):  # noqa: N802
        return nidaqmx_pb2.GetSystemInfoAttributeStringResponse(value=self.card.name)

    def _device(self, request, context, response):
        with self._answered(context, request):
            self.card.require(request.device_name)
            return response(value=device_attribute(
                self.card, request.attribute_raw or request.attribute))

    def GetDeviceAttributeString(self, request, context):  # noqa: N802
        return self._device(request, context, nidaqmx_pb2.GetDeviceAttributeStringResponse)

    def GetDeviceAttributeUInt32(self, request, context):  # noqa: N802
        return self._device(request, context, nidaqmx_pb2.GetDeviceAttributeUInt32Response)

    def GetDeviceAttributeDouble(self, request, context):  # noqa: N802
        return self._device(request, context, nidaqmx_pb2.GetDeviceAttributeDoubleResponse)

    def GetDeviceAttributeDoubleArray(self, request, context):  # noqa: N802
        return self._device(request, context, nidaqmx_pb2.GetDeviceAttributeDoubleArrayResponse)

    def ResetDevice(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.reset()
        return nidaqmx_pb2.ResetDeviceResponse()

    # Tasks

    def CreateTask(self, request, context):  # noqa: N802
        known = request.session_name in self.card.tasks
        if request.initialization_behavior == ATTACH and not known:
            context.abort(
                grpc.StatusCode.FAILED_PRECONDITION,
                f'Cannot attach to a session that does not exist: {request.session_name}')
        if request.initialization_behavior == NEW and known:
            context.abort(
                grpc.StatusCode.ALREADY_EXISTS,
                f'Cannot initialize a session that exists: {request.session_name}')
        response = nidaqmx_pb2.CreateTaskResponse(new_session_initialized=not known)
        with self._answered(context, request):
            response.task.name = (
                request.session_name if known else self.card.create_task(request.session_name))
        return response

    def ClearTask(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.clear_task(request.task.name)
        return nidaqmx_pb2.ClearTaskResponse()

    def GetTaskAttributeString(self, request, context):  # noqa: N802
        return nidaqmx_pb2.GetTaskAttributeStringResponse(value=request.task.name)

    def _add_channels(self, request, context, *, is_output):
        with self._answered(context, request):
            self.card.add_channels(
                request.task.name, request.physical_channel, request.min_val, request.max_val,
                is_output=is_output)

    def CreateAIVoltageChan(self, request, context):  # noqa: N802
        self._add_channels(request, context, is_output=False)
        return nidaqmx_pb2.CreateAIVoltageChanResponse()

    def CreateAOVoltageChan(self, request, context):  # noqa: N802
        self._add_channels(request, context, is_output=True)
        return nidaqmx_pb2.CreateAOVoltageChanResponse()

    def CfgSampClkTiming(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.configure_clock(
                request.task.name, request.rate, request.source,
                request.sample_mode_raw or request.sample_mode, request.samps_per_chan)
        return nidaqmx_pb2.CfgSampClkTimingResponse()

    def GetTimingAttributeDouble(self, request, context):  # noqa: N802
        with self._answered(context, request):
            return nidaqmx_pb2.GetTimingAttributeDoubleResponse(
                value=self.card.actual_rate_hz(request.task.name))

    def SetWriteAttributeInt32(self, request, context):  # noqa: N802
        with self._answered(context, request):
            set_task_attribute(
                self.card, request.task.name, request.attribute_raw or request.attribute,
                request.value_raw or request.value)
        return nidaqmx_pb2.SetWriteAttributeInt32Response()

    def SetBufferAttributeUInt32(self, request, context):  # noqa: N802
        with self._answered(context, request):
            set_task_attribute(
                self.card, request.task.name, request.attribute_raw or request.attribute,
                request.value)
        return nidaqmx_pb2.SetBufferAttributeUInt32Response()

    def StartTask(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.start(request.task.name)
        return nidaqmx_pb2.StartTaskResponse()

    def StopTask(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.stop(request.task.name)
        return nidaqmx_pb2.StopTaskResponse()

    def IsTaskDone(self, request, context):  # noqa: N802
        with self._answered(context, request):
            return nidaqmx_pb2.IsTaskDoneResponse(
                is_task_done=self.card.is_done(request.task.name))

    def WaitUntilTaskDone(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.wait_until_done(request.task.name, request.time_to_wait)
        return nidaqmx_pb2.WaitUntilTaskDoneResponse()

    def GetWriteAttributeUInt64(self, request, context):  # noqa: N802
        with self._answered(context, request):
            return nidaqmx_pb2.GetWriteAttributeUInt64Response(
                value=self.card.generated(request.task.name))

    # Samples

    def WriteAnalogF64(self, request, context):  # noqa: N802
        with self._answered(context, request):
            count = self.card.write(
                request.task.name, list(request.write_array), request.timeout, request.auto_start)
            return nidaqmx_pb2.WriteAnalogF64Response(samps_per_chan_written=count)

    def WriteAnalogScalarF64(self, request, context):  # noqa: N802
        with self._answered(context, request):
            self.card.write(request.task.name, [request.value], request.timeout, True)
        return nidaqmx_pb2.WriteAnalogScalarF64Response()

    def ReadAnalogF64(self, request, context):  # noqa: N802
        with self._answered(context, request):
            try:
                readings_v = self.card.read(
                    request.task.name, request.num_samps_per_chan, request.timeout)
                status = 0
            except DaqmxFault as fault:
                if fault.readings is None:
                    raise
                readings_v, status = fault.readings, fault.code
            return nidaqmx_pb2.ReadAnalogF64Response(
                status=status, samps_per_chan_read=readings_v.shape[1],
                read_array=padded(readings_v, request.num_samps_per_chan))

    def ReadAnalogScalarF64(self, request, context):  # noqa: N802
        with self._answered(context, request):
            readings_v = self.card.read(request.task.name, 1, request.timeout)
            return nidaqmx_pb2.ReadAnalogScalarF64Response(value=readings_v[0, 0])

    def GetErrorString(self, request, context):  # noqa: N802
        return nidaqmx_pb2.GetErrorStringResponse(error_string=f'Status {request.error_code}')


def padded(readings_v, samples):
    """Return readings grouped by channel, each filled up to what was asked for."""
    rows = [[*row, *[0.0] * (samples - len(row))] for row in readings_v.tolist()]
    return [value for row in rows for value in row]


def device_attribute(card, attribute):
    """Return an attribute of the card by its number in the C interface."""
    return {
        0x631: card.product,
        0x632: card.serial,
        0x231E: ', '.join(f'{card.name}/ai{index}' for index in range(32)),
        0x231F: ', '.join(f'{card.name}/{channel}' for channel in card.held_v),
        0x298C: card.highest_input_rate_hz,
        0x298E: card.lowest_rate_hz,
        0x2997: card.highest_output_rate_hz,
        0x2998: card.lowest_rate_hz,
        0x299B: [-card.range_v, card.range_v],
    }[attribute]


def set_task_attribute(card, name, attribute, value):
    """Set regeneration or a buffer by the number in the C interface."""
    task = card._task(name)
    if attribute == 0x1453:
        task.regeneration = value
    elif attribute in (0x186C, 0x186D):
        task.buffer_samples = value
    else:
        raise DaqmxFault(-200077, f'attribute {attribute:#x} is not in this emulator')


@contextlib.contextmanager
def served(card, address='127.0.0.1:0'):
    """Serve a card on loopback; yields the service and its address."""
    server = grpc.server(futures.ThreadPoolExecutor(4), options=[
        ('grpc.max_receive_message_length', LARGEST_MESSAGE), ('grpc.so_reuseport', 0)])
    service = DaqmxService(card)
    nidaqmx_pb2_grpc.add_NiDAQmxServicer_to_server(service, server)
    port = server.add_insecure_port(address)
    server.start()
    try:
        yield service, f'127.0.0.1:{port}'
    finally:
        server.stop(None).wait()
