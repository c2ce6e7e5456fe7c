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

import xml.etree.ElementTree as ElementTree

import matplotlib as mpl
import numpy as np
import pytest

from piezo_ros.report import score
from piezo_ros.report.figures.export import png, svg
from piezo_ros.report.figures.harmonics_figure import HarmonicsCurve, harmonics_figure
from piezo_ros.report.figures.hysteresis_figure import hysteresis_figure
from piezo_ros.report.figures.nrmse_figure import TableCell, nrmse_figure, table_4_figure
from piezo_ros.report.figures.tracking_figure import tracking_figure
from piezo_ros.report.figures.uncertainty_figure import uncertainty_figure


def test_the_users_settings_neither_matter_nor_change(scored_runs):
    plain = svg(tracking_figure(scored_runs[:3]), 'a')
    with mpl.rc_context({'lines.linewidth': 9.0, 'svg.fonttype': 'path', 'font.size': 30.0}):
        assert svg(tracking_figure(scored_runs[:3]), 'a') == plain
        assert mpl.rcParams['lines.linewidth'] == 9.0


def test_svg_is_well_formed_and_carries_no_date(scored_runs):
    document = svg(tracking_figure(scored_runs[:3]), 'a')
    ElementTree.fromstring(document)
    assert 'dc:date' not in document


FOREIGN = [r'$\frac{$', '$x$ and $y$', r'\$5', '<b>&amp;', 'a\x01b', '$' * 31, 'µ\n$\\']


@pytest.mark.parametrize('text', FOREIGN)
@pytest.mark.parametrize('draw', [
    pytest.param(lambda run, text: tracking_figure([run]), id='scheme'),
    pytest.param(lambda run, text: hysteresis_figure([run, run]), id='run'),
    pytest.param(lambda run, text: nrmse_figure([run]), id='legend'),
    pytest.param(
        lambda run, text: table_4_figure([TableCell(1, 300, 2, 1, 2, 1)], title=text), id='title'),
    pytest.param(
        lambda run, text: harmonics_figure([HarmonicsCurve(text, [1, 3], [2, 1], [2, 1], 3)]),
        id='heading'),
])
def test_a13_texts_of_bags_and_plans_are_drawn_as_they_are(make_run, draw, text):
    run = score(make_run(text), bag=f'bags/{text}', wall_seconds=1.0)
    figure = draw(run, text)
    document = svg(figure, 'a')
    words = ''.join(ElementTree.fromstring(document).itertext())
    for line in text.replace('\x01', '\ufffd').splitlines():
        assert line in words
    assert document == svg(figure, 'a')
    assert png(figure)


def test_a13_formulas_of_ticks_stay_formulas():
    figure = uncertainty_figure(np.geomspace(10.0, 1e3, 50), np.geomspace(1e-4, 1.0, 50), [])
    words = ''.join(ElementTree.fromstring(svg(figure, 'a')).itertext())
    assert 'mathdefault' not in words
    assert '$' not in words
