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

import dataclasses
import math

from piezo_ros.report.page.run_sections import harmonics_sections

PREDICTED = {1: 3.0, 3: 1.5, 9: 0.5}


def test_runs_of_the_same_scan_are_what_was_measured_of_each_number_of_harmonics(scored_runs):
    _, ff, fbff, sine = scored_runs
    fewer = dataclasses.replace(ff, harmonics=3, bag='bags/fewer', nrmse_percent=1.6)
    (section,) = harmonics_sections([ff, fewer, fbff, sine], {ff.bag: PREDICTED})
    (picture,) = section.content
    (curve,) = picture.figure.args[0]
    assert curve.label == 'FF, 2 µm, 300 Hz'
    assert (curve.harmonics, curve.predicted_percent) == ([1, 3, 9], [3.0, 1.5, 0.5])
    assert math.isnan(curve.measured_percent[0])
    assert curve.measured_percent[1:] == [1.6, ff.nrmse_percent]
    assert curve.chosen == 9


def test_where_there_was_nothing_to_choose_there_is_no_section(scored_runs):
    assert harmonics_sections(scored_runs, {}) == []
    assert harmonics_sections(scored_runs, {scored_runs[1].bag: {9: 0.5}}) == []
