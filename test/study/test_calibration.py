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

from piezo_ros.study.calibration import calibrate_rig


@pytest.mark.slow
def test_every_scipy_tells_how_far_the_calibration_is():
    told = []
    calibrate_rig(generations=2, progress=told.append)
    assert told == [0.5, 1.0]
