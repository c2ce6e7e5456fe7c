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

import pytest

from piezo_ros.report.comparison import agreement, cases


def test_runs_of_the_same_reference_are_one_case(scored_runs):
    groups = cases([scored_runs[3], *scored_runs[:3]])
    assert [case.title for case in groups] == ['Sine, 0.5 µm, 450 Hz', 'Triangle, 2 µm, 300 Hz']
    assert [len(case.runs) for case in groups] == [1, 3]


@pytest.mark.parametrize(
    ('ff_percent', 'fbff_percent', 'same_winner'), [(2.31, 1.22, 1), (2.31, 2.44, 0)])
def test_agreement_counts_published_numbers_and_winners(
        scored_runs, ff_percent, fbff_percent, same_winner):
    fb, ff, fbff, sine = scored_runs
    result = agreement([
        fb, dataclasses.replace(ff, nrmse_percent=ff_percent),
        dataclasses.replace(fbff, nrmse_percent=fbff_percent), sine])
    assert result.numbers == 2
    assert result.pairs == 1
    assert result.same_winner == same_winner
    assert result.median_deviation_percent == pytest.approx(
        (10 + 100 * (fbff_percent / 1.22 - 1)) / 2)


def test_agreement_without_published_numbers_is_empty(scored_runs):
    assert agreement([scored_runs[0]]) == (0, None, 0, 0)
