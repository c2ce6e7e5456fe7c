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

"""The best known voltages: data that belong to one rig, and the search that finds them."""

from pathlib import Path

import pytest

from piezo_ros.model import RigParameters
from piezo_ros.parameters.parameter_file import read_parameter_set
from piezo_ros.study.beyond.best_known import BestKnown, best_known_csv, read_best_known
from piezo_ros.study.beyond.optimum import find_optimum
from piezo_ros.study.table_4 import table_cells

RIG = read_parameter_set(
    Path(__file__).parents[3] / 'config' / 'rig.yaml', 'plant', RigParameters)


def test_every_cell_of_the_shipped_rig_has_a_best_known_error():
    known = read_best_known(RIG)
    assert set(known) == set(table_cells())
    assert all(0.02 < percent < 1.3 for percent in known.values())


@pytest.mark.parametrize('changes', [
    {'slew_limit_v_per_s': 20_000.0}, {'gain_mismatch': 0.0}, {'creep_per_decade': 0.02},
    {'average_slew_limit_v_per_s': 9100.0}])
def test_another_rig_has_none(changes):
    assert read_best_known(RIG.replaced(**changes)) == {}


def test_another_sensor_does_not_make_another_rig():
    assert read_best_known(RIG.replaced(
        noise_rms_um=0.005, seed=7, sensor_scale_um_per_v=1.5)) == read_best_known(RIG)


def test_what_was_found_is_read_back(tmp_path):
    path = tmp_path / 'found.csv'
    path.write_text(best_known_csv(RIG, [BestKnown(1.0, 500.0, 0.12345, 15_000.0)]))
    assert read_best_known(RIG, path) == {(1.0, 500.0): 0.12345}


def test_the_search_in_a_narrow_band_comes_near_to_the_best_known():
    found = find_optimum(RIG, 0.5, 800.0, bands_hz=(15_000.0,), spreads=(0.0,))
    best = read_best_known(RIG)[0.5, 800.0]
    assert best <= found.nrmse_percent < 1.5 * best
