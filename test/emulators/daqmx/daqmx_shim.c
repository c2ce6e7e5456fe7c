/* Copyright 2026 piezo_ros maintainers
 *
 * Licensed under the Apache License, Version 2.0 (the "License");
 * you may not use this file except in compliance with the License.
 * You may obtain a copy of the License at
 *
 *     http://www.apache.org/licenses/LICENSE-2.0
 *
 * Unless required by applicable law or agreed to in writing, software
 * distributed under the License is distributed on an "AS IS" BASIS,
 * WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
 * See the License for the specific language governing permissions and
 * limitations under the License.
 */

/* The C functions of NI-DAQmx that the package comes to by the vendor's client, each forwarded to a
 * function of Python (daqmx_shim.py). Functions of the vendor with variable arguments are called
 * with pointers and integers only, which on the ABIs of Linux are passed like those of others.
 */

#include <stdint.h>

typedef void *task_t;
typedef const char *text_t;
typedef uint32_t bool32_t;

#define FORWARD(name, parameters, arguments) \
    int32_t (*forward_##name) parameters; \
    int32_t DAQmx##name parameters { return forward_##name arguments; }

FORWARD(CreateTask, (text_t name, task_t *task), (name, task))
FORWARD(ClearTask, (task_t task), (task))
FORWARD(StartTask, (task_t task), (task))
FORWARD(StopTask, (task_t task), (task))
FORWARD(IsTaskDone, (task_t task, bool32_t *done), (task, done))
FORWARD(WaitUntilTaskDone, (task_t task, double timeout), (task, timeout))
FORWARD(CreateAIVoltageChan,
    (task_t task, text_t channel, text_t name, int32_t terminals, double low, double high,
     int32_t units, text_t scale), (task, channel, name, terminals, low, high, units, scale))
FORWARD(CreateAOVoltageChan,
    (task_t task, text_t channel, text_t name, double low, double high, int32_t units,
     text_t scale), (task, channel, name, low, high, units, scale))
FORWARD(CfgSampClkTiming,
    (task_t task, text_t source, double rate, int32_t edge, int32_t mode, uint64_t samples),
    (task, source, rate, edge, mode, samples))
FORWARD(ReadAnalogF64,
    (task_t task, int32_t samples, double timeout, bool32_t fill, double *values, uint32_t size,
     int32_t *read, bool32_t *reserved),
    (task, samples, timeout, fill, values, size, read, reserved))
FORWARD(ReadAnalogScalarF64,
    (task_t task, double timeout, double *value, bool32_t *reserved),
    (task, timeout, value, reserved))
FORWARD(WriteAnalogF64,
    (task_t task, int32_t samples, bool32_t start, double timeout, bool32_t layout,
     const double *values, int32_t *written, bool32_t *reserved),
    (task, samples, start, timeout, layout, values, written, reserved))
FORWARD(WriteAnalogScalarF64,
    (task_t task, bool32_t start, double timeout, double value, bool32_t *reserved),
    (task, start, timeout, value, reserved))
FORWARD(GetTaskAttribute, (task_t task, int32_t attribute, void *value, uint32_t size),
    (task, attribute, value, size))
FORWARD(GetTimingAttribute, (task_t task, int32_t attribute, void *value, uint32_t size),
    (task, attribute, value, size))
FORWARD(GetWriteAttribute, (task_t task, int32_t attribute, void *value, uint32_t size),
    (task, attribute, value, size))
FORWARD(SetWriteAttribute, (task_t task, int32_t attribute, uint32_t value),
    (task, attribute, value))
FORWARD(SetBufferAttribute, (task_t task, int32_t attribute, uint32_t value),
    (task, attribute, value))
FORWARD(GetDeviceAttribute, (text_t device, int32_t attribute, void *value, uint32_t size),
    (device, attribute, value, size))
FORWARD(GetSystemInfoAttribute, (int32_t attribute, void *value, uint32_t size),
    (attribute, value, size))
FORWARD(GetErrorString, (int32_t code, char *text, uint32_t size), (code, text, size))
FORWARD(GetExtendedErrorInfo, (char *text, uint32_t size), (text, size))
