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
from piezo_ros.report.page.writer import write_page

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
