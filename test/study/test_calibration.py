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

from piezo_ros import paper
from piezo_ros.model import RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.study.experiments import rig_that_warms
from piezo_ros.study.rig_calibration import WARMING_RANGES, calibrate_rig
from piezo_ros.study.table_3 import beyond_published_band_hz, crossing_frequencies_hz
from piezo_ros.study.table_4 import agreement, published_errors, table_cells, tracking_errors


def test_the_rig_that_warms_has_the_spread_of_table_3_and_the_errors_of_table_4():
    rig = RigParameters.among(rig_that_warms())
    for name, (low, high) in WARMING_RANGES.items():
        assert low <= getattr(rig, name) <= high, name
    crossings_hz = crossing_frequencies_hz(rig)
    beyond_hz = [
        beyond_published_band_hz(*row)
        for row in zip(paper.TABLE_3, crossings_hz.tolist(), strict=True)]
    assert np.count_nonzero(np.array(beyond_hz) <= 50.0) >= 4, crossings_hz
    found = agreement(tracking_errors(rig, table_cells()), published_errors(table_cells()))
    assert found.median_deviation <= 0.075
    assert found.verdicts >= 27


def test_a_crossing_is_as_far_from_its_band_as_from_the_nearer_end():
    assert beyond_published_band_hz(1.5, 700.0) == 0.0
    assert beyond_published_band_hz(1.5, 600.0) == 50.0
    assert beyond_published_band_hz(1.5, 760.0) == 10.0
    assert beyond_published_band_hz(1.5, np.inf) == np.inf
    assert np.isnan(beyond_published_band_hz(1.5, np.nan))


@pytest.mark.slow
def test_every_scipy_tells_how_far_the_calibration_is():
    told = []
    calibrate_rig(generations=2, progress=told.append)
    assert told == [0.5, 1.0]


@pytest.mark.slow
def test_a_calibration_of_a_rig_that_warms_is_a_parameter_file_with_its_command(tmp_path):
    calibration = calibrate_rig(self_heating=True, generations=1, seed=3)
    text = calibration.to_parameter_yaml()
    assert 'piezo calibrate --self-heating --seed 3 -o config/rig_that_warms.yaml' in text
    path = tmp_path / 'rig.yaml'
    path.write_text(text)
    assert read_parameter_set(path, 'plant', RigParameters) == calibration.rig
