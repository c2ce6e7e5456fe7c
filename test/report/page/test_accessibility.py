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
"""Pages in headless Chromium: accessible after axe-core, readable on a phone and printed."""

import os
from pathlib import Path

import numpy as np
import pytest
from analysis_pages import dynamics_page, replay_page, sweep_page, swept_records, tuning_page
from browser import browser, needs_browser, open_page
from scanned_images import scanned_image
from screenshots import MODES, settle

from piezo_ros.identification.hysteresis.hysteresis_fit import fit_hysteresis_records
from piezo_ros.identification.hysteresis.records import make_records
from piezo_ros.report.analysis.identification_page import write_hysteresis_page
from piezo_ros.report.analysis.loop_deviation import ModelResidual
from piezo_ros.report.page.raster_report import write_raster_report
from piezo_ros.report.page.run_report import write_report

axe = pytest.importorskip('axe_playwright_python.sync_playwright', reason='no axe-core')

pytestmark = needs_browser
# Other pages than those that are made here, by the environment: directories with report.html.
PAGES = [Path(page) for page in os.environ.get('PIEZO_PAGES', '').split(os.pathsep) if page]


@pytest.fixture(scope='module')
def chromium():
    with browser() as chromium:
        yield chromium


@pytest.fixture(scope='module')
def run_report(tmp_path_factory, scored_runs):
    return write_report(
        tmp_path_factory.mktemp('report'), title='Runs', runs=scored_runs,
        software={'numpy': '2'}, notes=['A note.'], plan='title: Runs', command='piezo report')


@pytest.fixture(scope='module')
def raster_report(tmp_path_factory):
    directory = tmp_path_factory.mktemp('raster')
    scans = [scanned_image(), scanned_image('001_b', 'learned', scale=1.0)]
    write_raster_report(directory, title='Scans', scans=scans, software={}, notes=['A note.'])
    return directory / 'report.html'


@pytest.fixture(scope='module')
def hysteresis_report(tmp_path_factory):
    corners_v = np.array([0.0, *(level * sign for level in (3, 2, 1) for sign in (1, -1)), 0.0])
    voltage_v = np.interp(np.arange(1401) / 200, np.arange(corners_v.size), corners_v)
    generator = np.random.default_rng(1)
    fit = fit_hysteresis_records(make_records(
        voltage_v, voltage_v + 0.02 * voltage_v**2 + generator.normal(0.0, 1e-3, voltage_v.size)),
        elements=4)
    return write_hysteresis_page(
        tmp_path_factory.mktemp('hysteresis'), title='Hysteresis', fit=fit, sample_period_s=1e-3,
        compared=[ModelResidual('MRC, 4 elements', 5, 2.0, 3.0)], software={'numpy': '2'},
        command='piezo identify hysteresis')


@pytest.fixture(scope='module')
def made(run_report, raster_report, hysteresis_report):
    return run_report, raster_report, hysteresis_report


@pytest.fixture(scope='module')
def pages(made, tmp_path_factory):
    """Return a page of every kind, and those of the environment."""
    return [
        *made, dynamics_page(tmp_path_factory.mktemp('dynamics')),
        tuning_page(tmp_path_factory.mktemp('gains'), 0.3),
        replay_page(tmp_path_factory.mktemp('replay')),
        sweep_page(tmp_path_factory.mktemp('sweep'), swept_records(200)),
        *(directory / 'report.html' for directory in PAGES)]


def found_by_axe(page):
    results = axe.Axe().run(page)
    return [
        (violation['id'], node['html'][:200], node['failureSummary'])
        for violation in results.response['violations'] for node in violation['nodes']]


def test_axe_finds_nothing(chromium, made):
    check_with_axe(chromium, made, 'light')


@pytest.mark.slow
@pytest.mark.parametrize('mode', ['light', 'dark', 'phone', 'print'])
def test_axe_finds_nothing_on_a_page_of_any_kind(chromium, pages, mode):
    check_with_axe(chromium, pages, mode)


def check_with_axe(chromium, paths, mode):
    for path in paths:
        with open_page(chromium, path, **MODES[mode]) as page:
            settle(page)
            assert found_by_axe(page) == []
            assert page.errors == []


@pytest.mark.slow
def test_axe_finds_what_is_wrong(chromium, tmp_path):
    (tmp_path / 'bad.html').write_text(
        '<!doctype html><html lang="en"><title>Bad</title><main><h1>Bad</h1>'
        '<p style="color: #aaa; background: #fff">faint</p><svg role="img"></svg></main></html>')
    with open_page(chromium, tmp_path / 'bad.html') as page:
        assert {rule for rule, *_ in found_by_axe(page)} >= {'color-contrast', 'svg-img-alt'}


@pytest.mark.slow
def test_every_picture_has_an_alternative_text(chromium, pages):
    for path in pages:
        with open_page(chromium, path) as page:
            settle(page)
            labels = page.evaluate("""
                Array.from(document.querySelectorAll('figure svg, .u-wrap')).map(
                  (picture) => picture.getAttribute('aria-label')
                    || picture.querySelector('title')?.textContent || '')""")
            assert labels
            assert all(len(label) > 10 for label in labels)


@pytest.mark.slow
def test_a_phone_scrolls_pictures_and_tables_not_the_page(chromium, pages):
    for path in pages:
        with open_page(chromium, path, **MODES['phone']) as page:
            settle(page)
            assert page.evaluate('document.documentElement.scrollWidth') == 390
            # Words of a figure are as large as small print, however narrow the screen is.
            heights = page.evaluate("""
                Array.from(document.querySelectorAll('.drawing text')).filter(
                  (text) => text.checkVisibility() && text.textContent.trim()).map((text) => {
                    const size = parseFloat(getComputedStyle(text).fontSize);
                    const svg = text.ownerSVGElement;
                    return size * svg.clientWidth / svg.viewBox.baseVal.width;
                  })""")
            assert all(height >= 8.0 for height in heights)


@pytest.mark.slow
def test_nothing_is_clipped_in_print_and_folds_are_open(chromium, pages):
    for path in pages:
        with open_page(chromium, path, **MODES['print']) as page:
            too_wide = page.evaluate("""
                Array.from(document.querySelectorAll('table, pre, figure svg, p, figcaption'))
                  .filter((element) => element.checkVisibility())
                  .map((element) => [element.tagName, element.getBoundingClientRect().right,
                                     element.textContent.slice(0, 60)])
                  .filter(([, right]) => right > innerWidth + 1)""")
            assert too_wide == []
            hidden = page.evaluate("""
                Array.from(document.querySelectorAll('details > :not(summary)')).filter(
                  (content) => content.getBoundingClientRect().height === 0).length""")
            assert hidden == 0
