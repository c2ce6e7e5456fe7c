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
"""The slow axis: its reference from line to line, and commands that lead the stage along it."""

import numpy as np
import pytest

from piezo_ros.control import ControllerParameters
from piezo_ros.control.closed_loop import run_loop
from piezo_ros.experiment.raster.slow_axis import (
    LEAD_LINES,
    approach_samples,
    rest_samples,
    slow_motion,
    slow_reference_um,
)
from piezo_ros.model import HysteresisParameters, RigParameters

RIG = RigParameters(noise_rms_um=0.0, adc_bits=0, dac_bits=0)
TS = 1e-5
RATE = 800.0 * TS
LINES = 16


def reference(lines=LINES, size_um=3.2):
    first = int(np.ceil(LEAD_LINES + RATE * approach_samples(RIG, TS)))
    samples = round((first + lines) / RATE)
    return first, samples, slow_reference_um(
        samples + 130, lines, size_um, RATE, first, rest_samples(RIG, TS))


def test_the_lines_are_even_and_the_approach_is_smooth():
    first, _, y_um = reference()
    turns = RATE * np.arange(y_um.size)
    centres_um = np.interp(np.arange(first, first + LINES), turns, y_um)
    np.testing.assert_allclose(centres_um, np.linspace(-1.6, 1.6, LINES), atol=1e-9)
    rest = rest_samples(RIG, TS)
    assert not y_um[:rest].any()
    # It waits before the first trace.
    waiting = y_um[int((first - 2.0) / RATE):int((first - 1.3) / RATE)]
    assert np.ptp(waiting) == 0.0
    assert np.abs(np.diff(y_um)).max() < 0.02


def test_the_chain_of_inverses_keeps_the_time_of_the_fast_axis():
    _, samples, y_um = reference()
    table = slow_motion(y_um, samples, TS, RIG, preview=True)
    y_um = y_um[:samples]
    np.testing.assert_array_equal(table.reference_um, y_um)
    run = run_loop(
        RIG, HysteresisParameters(), ControllerParameters(scheme='ff'), TS, y_um,
        table.command_um)
    error_um = run.displacement_um[:-1] - y_um
    plain = run_loop(
        RIG, HysteresisParameters(), ControllerParameters(scheme='ff'), TS, y_um,
        y_um / RIG.dc_gain)
    assert np.sqrt(np.mean(error_um**2)) < 0.002
    assert np.sqrt(np.mean((plain.displacement_um[:-1] - y_um)**2)) > 0.01


def test_even_few_large_lines_begin_smoothly():
    _, samples, y_um = reference(lines=3)
    table = slow_motion(y_um, samples, TS, RIG.replaced(slew_limit_v_per_s=18200.0), preview=True)
    assert table.command_um.size == samples
    assert np.ptp(y_um[-4:]) == 0.0


def test_a_plain_axis_has_no_commands():
    _, samples, y_um = reference()
    table = slow_motion(y_um, samples, TS, RIG, preview=False)
    assert table.command_um is None
    assert table.reference_um.size == samples


def test_an_axis_that_moves_at_once_is_refused():
    y_um = np.concatenate([[0.0], np.linspace(0.0, 1.0, 3000)])
    with pytest.raises(ValueError, match='moves within its first 35 samples'):
        slow_motion(y_um, 3000, TS, RIG, preview=True)


def test_what_the_amplifier_cannot_do_is_refused():
    _, samples, y_um = reference()
    slow_rig = RIG.replaced(slew_limit_v_per_s=100.0)
    with pytest.raises(ValueError, match='the slope of the voltage is'):
        slow_motion(y_um, samples, TS, slow_rig, preview=True)
