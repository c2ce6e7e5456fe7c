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

"""The check of a device finds nothing wrong with a right one, and each fault of a wrong one."""

import math
from contextlib import suppress

import numpy as np
import pytest

from piezo_ros.hardware.checks.device_check import check_device
from piezo_ros.hardware.device import DeviceError
from piezo_ros.hardware.simulated import SimulatedDevice, SimulatedDeviceParameters

PERIOD_S = 1e-5


def device(kind=SimulatedDevice, **parameters):
    return kind(SimulatedDeviceParameters(noise_rms_um=1e-6, **parameters), compiled=False)


def wrong(made):
    return {finding.what for finding in check_device(made, PERIOD_S, 1.0) if finding.right is False}


@pytest.mark.parametrize('parameters', [
    {}, {'most_samples': 2000}, {'held_v': 2.0, 'buffer_samples': 5000}])
def test_a_right_device_has_nothing_wrong(parameters):
    findings = [*check_device(device(**parameters), PERIOD_S, 1.0)]
    assert [f for f in findings if f.right is not True] == []
    assert len(findings) > 25


class Late(SimulatedDevice):
    """Streams come one sample later than blocks."""

    def read(self, samples):
        readings_um = super().read(samples)
        kept, self._kept = getattr(self, '_kept', readings_um[:1]), readings_um[-1:]
        return np.concatenate([kept, readings_um[:-1]])


class Short(SimulatedDevice):
    def play(self, voltage_v):
        return super().play(voltage_v)[1:]


class TakesAnything(SimulatedDevice):
    def play(self, voltage_v):
        return super().play([v if math.isfinite(v) else 0.0 for v in voltage_v])


class Jumps(SimulatedDevice):
    def ramp_to(self, voltage_v, slew_v_per_s):
        super().ramp_to(0.9 * voltage_v, slew_v_per_s)


class Raises(SimulatedDevice):
    def play(self, voltage_v):
        if len(voltage_v) == 0:
            raise ValueError('empty')
        return super().play(voltage_v)


class Advanced(SimulatedDevice):
    """Blocks come before the voltages that they answer."""

    def play(self, voltage_v):
        readings_um = super().play(voltage_v)
        return np.append(readings_um[15:], readings_um[-15:])[:readings_um.size]


@pytest.mark.parametrize(('kind', 'words'), [
    (Late, 'as late in a stream as in a block'), (Short, '1 voltages have 2 readings'),
    (TakesAnything, 'refuses a voltage that is no number'),
    (Jumps, 'after a ramp to the amplitude'),
    (Raises, 'it refuses an empty block'), (Advanced, 'equally late in every block')])
def test_a_wrong_device_is_named_wrong(kind, words):
    found = wrong(device(kind))
    assert any(words in what for what in found), found


class Left(SimulatedDevice):
    """Tells what its output held as it was closed."""

    held_at_close = None

    def close(self):
        with suppress(DeviceError):  # It may be closed.
            self.held_at_close = super().hold()
        super().close()


class Fails(Left):
    """It fails once, while its output is at the amplitude."""

    is_lost = False

    def hold(self):
        held_v = super().hold()
        if held_v == 1.0 and not self.is_lost:
            self.is_lost = True
            raise DeviceError('the cable is off')
        return held_v


def test_a_device_that_fails_is_left_at_rest():
    made = device(Fails, held_v=2.0)
    findings = [*check_device(made, PERIOD_S, 1.0)]
    assert 'the cable is off' in next(f.detail for f in findings if f.right is False)
    assert made.held_at_close == 0.0


class StaysAway(Fails):
    def ramp_to(self, voltage_v, slew_v_per_s):
        if self.is_lost:
            raise DeviceError('no answer')
        super().ramp_to(voltage_v, slew_v_per_s)


def test_of_a_device_that_fails_and_comes_to_no_rest_both_are_told():
    found = [f for f in check_device(device(StaysAway), PERIOD_S, 1.0) if f.right is False]
    assert [f.detail for f in found] == [
        'DeviceError: no answer; before that DeviceError: the cable is off']


@pytest.mark.parametrize('number', range(3, 20, 4))
def test_a_check_that_is_left_leaves_the_device_at_rest(number):
    made = device(Left, held_v=2.0)
    findings = check_device(made, PERIOD_S, 1.0)
    for _ in range(number):
        next(findings)
    findings.close()
    assert made.held_at_close == 0.0
