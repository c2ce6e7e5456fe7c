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

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_ros.hardware.ramp import ramp_voltage

VOLTS = st.floats(-20.0, 20.0)


@given(VOLTS, VOLTS, st.floats(100.0, 1e4), st.floats(1e-4, 1e-2))
def test_every_step_of_a_ramp_is_within_the_slew(from_v, to_v, slew_v_per_s, sample_period_s):
    ramp_v = ramp_voltage(from_v, to_v, slew_v_per_s, sample_period_s)
    steps_v = np.diff([from_v, *ramp_v])
    assert np.abs(steps_v).max() <= slew_v_per_s * sample_period_s * (1.0 + 1e-9) + 1e-14
    assert ramp_v[-1] == to_v
    assert np.all(steps_v * np.sign(to_v - from_v) >= 0.0)


@pytest.mark.parametrize(('arguments', 'told'), [
    ((np.nan, 0.0, 1.0, 1.0), 'from_v is nan'),
    ((0.0, np.inf, 1.0, 1.0), 'to_v is inf'),
    ((0.0, 1.0, 0.0, 1.0), 'slew_v_per_s is 0.0'),
    ((0.0, 1.0, 1.0, -1.0), 'sample_period_s is -1.0'),
    ((0.0, 1.0, 1e-6, 1e-5), 'allowed is 0.001 V/s or more'),
])
def test_a_ramp_that_would_not_end_is_refused(arguments, told):
    with pytest.raises(ValueError, match=told):
        ramp_voltage(*arguments)
