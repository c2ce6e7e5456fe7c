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

import numpy as np
import pytest

from piezo_ros.report.figures.tracking_figure import error_limits_um, tracking_figure


def lines_by_label(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_tracking_shows_the_reference_and_every_scheme(scored_runs):
    runs = scored_runs[:3]
    top, bottom = tracking_figure(runs).axes
    lines = lines_by_label(top)
    assert list(lines) == ['desired', 'FB', 'FF', 'FBFF']
    assert np.array_equal(lines['desired'].get_ydata(), runs[0].reference_um)
    assert np.array_equal(lines['FBFF'].get_ydata(), runs[2].displacement_um)
    assert [np.array_equal(line.get_ydata(), run.error_um)
            for line, run in zip(bottom.get_lines(), runs, strict=True)] == [True] * 3
    assert top.get_shared_x_axes().joined(top, bottom)


def test_two_runs_of_one_scheme_differ_in_line_and_label(scored_runs):
    ff = scored_runs[1]
    lines = tracking_figure([ff, dataclasses.replace(ff, harmonics=15)]).axes[0].get_lines()
    assert [line.get_label() for line in lines[1:]] == ['FF, m = 9', 'FF, m = 15']
    assert lines[1].get_linestyle() != lines[2].get_linestyle()


def test_rows_of_errors_share_a_scale_unless_they_are_far_apart(scored_runs):
    sized = [dataclasses.replace(scored_runs[0], max_error_um=size) for size in (0.1, 0.3, 2.0)]
    assert error_limits_um(sized[:2]) == pytest.approx([0.324, 0.324])
    assert error_limits_um(sized) == pytest.approx([0.108, 0.324, 2.16])
