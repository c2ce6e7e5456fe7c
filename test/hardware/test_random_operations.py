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

"""Whatever is done to a card, in whatever order: it tells what the simulated device tells."""

import random

import numpy as np
import pytest

from piezo_ros.hardware.device import Refused, Underflow
from piezo_ros.hardware.simulated import SimulatedDevice

OPERATIONS = {
    'hold': lambda device, _: device.hold(),
    'reading': lambda device, _: device.reading(),
    'play': lambda device, voltage_v: device.play(voltage_v),
    'ramp_to': lambda device, voltage_v: device.ramp_to(voltage_v[0], 5000.0),
    'start': lambda device, voltage_v: device.start(voltage_v),
    'write': lambda device, voltage_v: device.write(voltage_v),
    'read': lambda device, voltage_v: device.read(voltage_v.size),
    'generated': lambda device, _: device.generated(),
    'finish': lambda device, _: device.finish(),
    'set_output': lambda device, voltage_v: device.set_output(voltage_v[0]),
    'reopen': lambda device, _: (device.close(), device.open(1e-5))[1],
}


def told(device, operation, voltage_v):
    try:
        result = OPERATIONS[operation](device, voltage_v)
    except Underflow as error:
        return f'underflow at {error.index}'
    except Refused:
        return 'refused'
    return np.array([]) if result is None else np.asarray(result, dtype=float)


@pytest.mark.slow  # Many orders of what the quick tests do in one.
@pytest.mark.parametrize('seed', range(40))
def test_random_operations_have_the_outcome_of_the_simulated_device(make_card, ni, seed):
    choose, values = random.Random(seed), np.random.default_rng(seed)
    card, reference = ni(make_card()), SimulatedDevice(compiled=False)
    reference.open(1e-5)
    same_time = True
    done = []
    for _ in range(40):
        operation = choose.choice([*OPERATIONS])
        voltage_v = np.cumsum(values.normal(0.0, 0.01, choose.choice([1, 2, 3, 10, 100, 700])))
        if operation == 'reading' and reference._stream is not None:
            continue  # the simulated device allows it
        if operation in ('reading', 'play', 'read') and not same_time:
            break
        done.append((operation, voltage_v.size))
        one, other = (told(device, operation, voltage_v) for device in (card, reference))
        if isinstance(one, str) or isinstance(other, str):
            assert str(one) == str(other), done
        else:
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9, err_msg=str(done))
        # The clock of a card goes on after the last voltage, and so does the noise.
        if (operation == 'finish' and not isinstance(other, str)) or 'underflow' in str(other):
            same_time = False
