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

"""Every figure of scored runs."""

import dataclasses

import pytest

from piezo_ros.report.figures.export import png, svg
from piezo_ros.report.figures.hysteresis_figure import hysteresis_figure
from piezo_ros.report.figures.nrmse_figure import nrmse_figure
from piezo_ros.report.figures.style import scheme_colour
from piezo_ros.report.figures.tracking_figure import error_figure, tracking_figure


@pytest.fixture(params=[tracking_figure, error_figure, hysteresis_figure, nrmse_figure])
def draw(request):
    return request.param


def test_a_scheme_has_one_colour_in_every_figure(scored_runs):
    runs = scored_runs[:3]
    for run, row, panel in zip(
            runs, error_figure(runs).axes, hysteresis_figure(runs).axes, strict=True):
        assert row.get_lines()[0].get_color() == scheme_colour(run.scheme)
        assert panel.get_lines()[0].get_color() == scheme_colour(run.scheme)
    lines = {line.get_label(): line for line in tracking_figure(runs).axes[0].get_lines()}
    assert lines['FF'].get_color() == scheme_colour('ff')
    assert len({scheme_colour(run.scheme) for run in runs}) == 3


def test_a_perfect_run_can_be_drawn(draw, scored_runs):
    ff = scored_runs[1]
    perfect = dataclasses.replace(
        ff, displacement_um=ff.reference_um, max_error_um=0.0, nrmse_percent=0.0)
    assert png(draw([perfect])).startswith(b'\x89PNG')


def test_a_figure_of_nothing_is_refused(draw):
    with pytest.raises(ValueError, match='runs is empty'):
        draw([])


def test_the_same_runs_give_the_same_bytes(draw, scored_runs):
    first, second = draw(scored_runs[:3]), draw(scored_runs[:3])
    assert svg(first, 'a') == svg(second, 'a')
    assert png(first) == png(second)
