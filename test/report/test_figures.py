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
import xml.etree.ElementTree as ElementTree

import matplotlib as mpl
import numpy as np
import pytest

from piezo_ros.report.figures import (
    error_figure,
    error_limits_um,
    hysteresis_figure,
    loop_picture,
    nrmse_figure,
    tracking_figure,
)
from piezo_ros.report.rendering import inline_svg, png, scheme_colour, svg

FIGURES = [tracking_figure, error_figure, hysteresis_figure, nrmse_figure]


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


def test_a_scheme_has_one_colour_in_every_figure(scored_runs):
    runs = scored_runs[:3]
    for run, row, panel in zip(
            runs, error_figure(runs).axes, hysteresis_figure(runs).axes, strict=True):
        assert row.get_lines()[0].get_color() == scheme_colour(run.scheme)
        assert panel.get_lines()[0].get_color() == scheme_colour(run.scheme)
    top = tracking_figure(runs).axes[0]
    assert lines_by_label(top)['FF'].get_color() == scheme_colour('ff')
    assert len({scheme_colour(run.scheme) for run in runs}) == 3


def test_two_runs_of_one_scheme_differ_in_line_and_label(scored_runs):
    ff = scored_runs[1]
    lines = tracking_figure([ff, dataclasses.replace(ff, harmonics=15)]).axes[0].get_lines()
    assert [line.get_label() for line in lines[1:]] == ['FF, m = 9', 'FF, m = 15']
    assert lines[1].get_linestyle() != lines[2].get_linestyle()


def test_rows_of_errors_share_a_scale_unless_they_are_far_apart(scored_runs):
    sized = [dataclasses.replace(scored_runs[0], max_error_um=size) for size in (0.1, 0.3, 2.0)]
    assert error_limits_um(sized[:2]) == pytest.approx([0.324, 0.324])
    assert error_limits_um(sized) == pytest.approx([0.108, 0.324, 2.16])


def test_a_perfect_run_can_be_drawn(scored_runs):
    ff = scored_runs[1]
    perfect = dataclasses.replace(
        ff, displacement_um=ff.reference_um, max_error_um=0.0, nrmse_percent=0.0)
    for draw in FIGURES:
        assert png(draw([perfect])).startswith(b'\x89PNG')


def test_hysteresis_wraps_after_four_panels(scored_runs):
    panels = hysteresis_figure([scored_runs[0]] * 5).axes
    assert [panel.get_visible() for panel in panels] == [True] * 5 + [False] * 3


def test_nrmse_puts_the_published_number_at_the_frequency_of_ours(scored_runs):
    ff = scored_runs[1]
    at_500 = dataclasses.replace(
        ff, frequency_hz=500.0, nrmse_percent=3.0, paper_nrmse_percent=2.71)
    ours, paper = nrmse_figure([at_500, ff]).axes[0].get_lines()[:2]
    assert list(ours.get_xdata()) == list(paper.get_xdata()) == [300.0, 500.0]
    assert list(ours.get_ydata()) == [ff.nrmse_percent, 3.0]
    assert list(paper.get_ydata()) == [2.10, 2.71]


@pytest.mark.parametrize('draw', FIGURES)
def test_a_figure_of_nothing_is_refused(draw):
    with pytest.raises(ValueError, match='runs is empty'):
        draw([])


@pytest.mark.parametrize('draw', FIGURES)
def test_the_same_runs_give_the_same_bytes(draw, scored_runs):
    first, second = draw(scored_runs[:3]), draw(scored_runs[:3])
    assert svg(first, 'a') == svg(second, 'a')
    assert png(first) == png(second)


def test_the_users_settings_neither_matter_nor_change(scored_runs):
    plain = svg(tracking_figure(scored_runs[:3]), 'a')
    with mpl.rc_context({'lines.linewidth': 9.0, 'svg.fonttype': 'path', 'font.size': 30.0}):
        assert svg(tracking_figure(scored_runs[:3]), 'a') == plain
        assert mpl.rcParams['lines.linewidth'] == 9.0


def test_svg_is_well_formed_and_carries_no_date(scored_runs):
    document = svg(tracking_figure(scored_runs[:3]), 'a')
    ElementTree.fromstring(document)
    assert 'dc:date' not in document


def test_inline_svg_takes_its_colours_from_the_page(scored_runs):
    element = inline_svg(svg(tracking_figure(scored_runs[:3]), 'a'), 'what it shows')
    assert element.startswith('<svg viewBox=')
    assert 'aria-label="what it shows"' in element
    assert 'currentColor' in element
    assert 'var(--fbff, #009e73)' in element
    assert 'http' not in element


def test_inline_svg_of_something_else_is_refused():
    with pytest.raises(ValueError, match='<svg width="3">'):
        inline_svg('<svg width="3"></svg>', 'nothing')


def test_pictures_of_one_page_share_no_identifier(scored_runs):
    import re
    identifiers = [
        set(re.findall(r'\bid="([^"]+)"', inline_svg(svg(tracking_figure(scored_runs), name), '')))
        for name in ('a', 'b')]
    assert identifiers[0]
    assert not identifiers[0] & identifiers[1]


def test_loop_picture_names_every_topic_and_has_no_colour_of_its_own():
    picture = loop_picture()
    text = ' '.join(ElementTree.fromstring(picture).itertext())
    for topic in ('reference', 'feedforward', 'command', 'voltage', 'displacement', 'demand'):
        assert text.count(topic) >= 2  # in the title and on its arrow
    assert 'currentColor' in picture
    assert '="#' not in picture
