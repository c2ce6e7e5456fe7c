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

"""The live page in a browser: what it shows of a campaign, its words for others, its button."""

import pytest
from browser import browser, needs_browser, open_page
from live_feed import planned_runs, show_run, status_of
from screenshots import MODES

from piezo_ros.live.view import live_view
from piezo_ros.live.view.live_view import LiveView

pytestmark = needs_browser
FIGURES = (
    'Displacement over one period', 'Voltage over one period',
    'Error, reference less displacement', 'Error by harmonic')


@pytest.fixture(scope='module')
def chromium():
    with browser() as started:
        yield started


@pytest.fixture(scope='module')
def planned(tmp_path_factory):
    (run,) = planned_runs(
        tmp_path_factory.mktemp('plan'), {'scheme': 'fbff', 'periods': 250})
    return run


@pytest.fixture
def view(planned):
    view = LiveView('A <b>plan</b>', 3)
    view.add_rigs('')
    view.announce('[1/3] the first run')
    view.begin_run({'': planned})
    show_run(view, planned)
    yield view
    view.close(0)


def _shown(page, text):
    page.get_by_text(text).first.wait_for()


def test_the_page_shows_the_run_and_its_end(chromium, view, monkeypatch):
    monkeypatch.setattr(live_view, '_LAST_LOOK_S', 60.0)  # a browser on a busy machine
    monkeypatch.setattr(live_view, '_OPEN_S', 60.0)
    with open_page(chromium, view.address) as page:
        _shown(page, 'NRMSE, estimate')
        assert page.title().endswith('A <b>plan</b>')
        assert page.locator('h1 b').count() == 0  # text stays text
        assert page.locator('#state').text_content() == 'running'
        _shown(page, '[1/3] the first run')
        titles = page.locator('figure:visible h3').all_text_contents()
        assert titles == list(FIGURES)
        for picture in page.locator('figure:visible [role=img]').all():
            assert len(picture.get_attribute('aria-label')) > 20
        # The loop of fbff leaves 1.2 %.
        value = page.locator('dd', has_text='%').text_content()
        assert 1.0 < float(value.split()[0]) < 1.4
        view.take_status('', status_of('plant', 7, 'faulted', reason='<i>why</i>'))
        _shown(page, '<i>why</i>')
        view.end_run(problem='plant: why')
        view.close(1)
        _shown(page, 'ended with exit code 1')
        assert page.locator('#stop').is_disabled()
        assert page.errors == []


def test_the_button_stops_once(chromium, view, monkeypatch):
    signals = []
    monkeypatch.setattr(live_view.os, 'kill', lambda *sent: signals.append(sent))
    with open_page(chromium, view.address) as page:
        page.locator('#stop:enabled').click()
        _shown(page, 'stopping: the voltage goes to zero')
        page.evaluate('fetch("stop", {method: "POST"})')
        assert page.errors == []
    assert signals == [(live_view.os.getpid(), live_view.signal.SIGINT)]


@pytest.mark.slow
def test_the_page_is_as_wide_as_a_telephone(chromium, view):
    with open_page(chromium, view.address, width=390, height=844, dark=True) as page:
        _shown(page, 'NRMSE, estimate')
        assert page.evaluate('document.documentElement.scrollWidth') == 390


@pytest.mark.slow
def test_a_page_of_another_origin_neither_reads_nor_stops(chromium, view, monkeypatch):
    monkeypatch.setattr(live_view.os, 'kill', lambda *_: pytest.fail('it was stopped'))
    other = LiveView('another', 1)  # another port is another origin
    try:
        with open_page(chromium, other.address) as page:
            for target, method in (('data', 'GET'), ('stop', 'POST')):
                outcome = page.evaluate(
                    'async ([address, method]) => { try {'
                    '  const answer = await fetch(address, {method, mode: "no-cors"});'
                    '  return answer.type + (await answer.text()); } catch (e) { return "no"; } }',
                    [view.address + target, method])
                assert outcome in ('no', 'opaque')
    finally:
        other.close(0)


@pytest.mark.slow
def test_the_page_says_that_nothing_answers(chromium, view):
    with open_page(chromium, view.address) as page:
        _shown(page, 'NRMSE, estimate')
        view._server.close()
        _shown(page, 'no answer: piezo run has ended, or hangs')
        assert page.locator('#stop').is_disabled()


@pytest.mark.slow
@pytest.mark.parametrize('mode', ['light', 'dark', 'phone'])
def test_axe_finds_nothing(chromium, view, mode):
    axe = pytest.importorskip('axe_playwright_python.sync_playwright', reason='no axe-core')
    view.end_run(problem='plant: why')
    # Only the own script may run: axe is let in by the browser.
    with open_page(chromium, view.address, bypass_csp=True, **MODES[mode]) as page:
        _shown(page, 'NRMSE, estimate')
        found = axe.Axe().run(page).response['violations']
        assert [(each['id'], [node['html'] for node in each['nodes']]) for each in found] == []
