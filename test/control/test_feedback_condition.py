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

import pytest

from piezo_ros.control.feedback_condition import feedback_acceptable_below_hz

AMPLITUDES_UM = (0.5, 1.0, 2.0)
FREQUENCIES_HZ = (400.0, 700.0, 500.0)


@pytest.mark.parametrize(('amplitude_um', 'frequency_hz'), [
    (0.1, 400.0), (0.5, 400.0), (0.75, 550.0), (1.0, 700.0), (1.5, 600.0), (2.0, 500.0),
    (9.0, 500.0)])
def test_straight_lines_run_between_the_amplitudes_and_none_beyond(amplitude_um, frequency_hz):
    found = feedback_acceptable_below_hz(AMPLITUDES_UM, FREQUENCIES_HZ, amplitude_um)
    assert found == pytest.approx(frequency_hz)


@pytest.mark.parametrize('amplitude_um', [0.0, 1.0, 50.0])
def test_one_amplitude_alone_stands_for_all(amplitude_um):
    assert feedback_acceptable_below_hz((0.0,), (425.0,), amplitude_um) == 425.0
