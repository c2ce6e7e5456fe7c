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
from browser import browser, needs_browser, open_page
from matplotlib.figure import Figure

from piezo_ros.report.page.chart import Line, Panel, Trace
from piezo_ros.report.page.content import Fold, Picture, Section
from piezo_ros.report.page.curve_panel import Curve, CurvePanel
from piezo_ros.report.page.page_writer import write_page

pytestmark = needs_browser


def picture(name):
    time_ms = np.linspace(0.0, 10.0, 400)
    figure = Figure(figsize=(7.6, 3))
    figure.subplots().plot(time_ms, np.sin(time_ms))
    return Picture(name, 'A sine.', figure, panels=[
        Panel('time (ms)', 'displacement (µm)', [
            Trace('FF', time_ms, np.sin(time_ms), '#006ba6', 'dashed'),
            Trace('measured', time_ms[::7], np.cos(time_ms[::7]), '#b54a00', 'none', 'open')],
            lines=[Line(0.5, 'limit'), Line(3.0, 'mark', axis='x')]),
        Panel('time (ms)', 'error (nm)', [
            Trace('FF', time_ms, np.cos(time_ms), '#006ba6',
                  band=(np.cos(time_ms) - 0.2, np.cos(time_ms) + 0.2))], title='Error')])


@pytest.fixture(scope='module')
def chromium():
    with browser() as chromium:
        yield chromium


@pytest.fixture(scope='module')
def report(tmp_path_factory):
    return write_page(
        tmp_path_factory.mktemp('page'), title='Charts', lead=[], software={}, data={}, sections=[
            Section('a', 'A', [picture('one'), Fold('More', [picture('two')])])])


def test_charts_are_drawn_in_place_of_the_figures_also_in_folds_once_they_open(chromium, report):
    with open_page(chromium, report) as page:
        page.wait_for_selector('.uplot canvas')
        assert page.locator('.uplot canvas').count() == 2
        assert not page.locator('.drawing').first.is_visible()
        assert page.locator('.u-wrap').first.get_attribute('aria-label') == 'A sine.'
        page.locator('summary').click()
        page.wait_for_function('document.querySelectorAll(".uplot canvas").length == 4')
        assert page.errors == []


@pytest.mark.slow
def test_the_cursor_tells_the_values_in_both_panels_and_a_drag_zooms_both(chromium, report):
    with open_page(chromium, report) as page:
        page.wait_for_selector('.uplot canvas')
        over = page.locator('.u-over').first.bounding_box()
        middle = over['x'] + over['width'] / 2, over['y'] + over['height'] / 2
        page.mouse.move(*middle)
        values = page.locator('.uplot').nth(1).locator('.u-value').all_inner_texts()
        assert float(values[0].replace('\N{MINUS SIGN}', '-')) == pytest.approx(5.0, abs=0.1)
        shown = float(values[-1].replace('\N{MINUS SIGN}', '-'))
        assert shown == pytest.approx(np.cos(5.0), abs=0.1)
        page.mouse.down()
        page.mouse.move(middle[0] + 100, middle[1], steps=4)
        page.mouse.up()
        assert page.locator('.chart button').first.is_visible()
        page.locator('.chart button').first.click()
        assert not page.locator('.chart button').first.is_visible()
        assert page.errors == []


@pytest.mark.slow
def test_print_shows_the_figure_and_a_phone_needs_no_scrolling_sideways(chromium, report):
    with open_page(chromium, report, printed=True) as page:
        assert page.locator('.drawing').first.is_visible()
        assert not page.locator('.uplot').first.is_visible()
    with open_page(chromium, report, width=390, height=844) as page:
        page.wait_for_selector('.uplot canvas')
        assert page.evaluate('document.documentElement.scrollWidth') == 390


def loop_picture():
    around = np.linspace(0.0, 2.0 * np.pi, 200)
    figure = Figure(figsize=(5, 5))
    figure.subplots().plot(np.cos(around), np.sin(around))
    return Picture('loop', 'A circle.', figure, panels=[CurvePanel(
        'voltage (V)', 'displacement (µm)',
        [Curve('FF', np.cos(around), np.sin(around), along=around),
         Curve('points', [2.0], [0.0], '#b54a00', 'none', 'open')],
        along_label='time (ms)', x_range=(-1.0, 3.0), y_range=(-1.0, 1.0),
        has_equal_scales=True)])


@pytest.fixture(scope='module')
def loop_report(tmp_path_factory):
    return write_page(
        tmp_path_factory.mktemp('loop'), title='Loop', lead=[], software={}, data={}, sections=[
            Section('a', 'A', [loop_picture()])])


def place(page, x, y):
    """Return where on the screen a point of the panel is."""
    over = page.locator('.u-over').bounding_box()
    across, down = page.evaluate(
        '([x, y]) => { const u = piezoCharts.charts[0].plots[0];'
        " return [u.valToPos(x, 'x'), u.valToPos(y, 'y')]; }", [x, y])
    return over['x'] + across, over['y'] + down


def test_the_nearest_point_of_a_loop_is_told_and_a_drag_zooms_both_axes(chromium, loop_report):
    with open_page(chromium, loop_report) as page:
        page.wait_for_selector('.uplot canvas')
        readout = page.locator('.readout')
        assert readout.inner_text() == 'Point at a curve for its values.'
        page.mouse.move(*place(page, 0.0, 0.98))
        assert readout.inner_text().startswith('FF: time (ms) 1.5')
        page.mouse.move(*place(page, 2.02, 0.03))
        assert readout.inner_text() == 'points: voltage (V) 2, displacement (µm) 0'
        left, middle, right = (place(page, x, y) for x, y in ((0.0, 0.0), (1.0, 1.0), (2.0, 0.0)))
        # A unit is as long on one axis as on the other.
        assert right[0] - middle[0] == pytest.approx(left[1] - middle[1], abs=2.0)
        page.mouse.move(*left)
        page.mouse.down()
        page.mouse.move(*middle, steps=4)
        page.mouse.up()
        assert place(page, 1.0, 0.0)[0] - place(page, 0.0, 0.0)[0] > 1.5 * (middle[0] - left[0])
        page.locator('.chart button').click()
        assert place(page, 1.0, 1.0) == pytest.approx(middle, abs=2.0)
        page.set_viewport_size({'width': 390, 'height': 844})
        page.wait_for_timeout(200)
        assert page.evaluate('document.documentElement.scrollWidth') == 390
        origin, across, above = (place(page, x, y) for x, y in ((0, 0), (1, 0), (0, 1)))
        assert across[0] - origin[0] == pytest.approx(origin[1] - above[1], rel=0.02)
        assert page.errors == []
