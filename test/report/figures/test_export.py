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

from piezo_ros.report.figures.export import svg
from piezo_ros.report.figures.tracking import tracking_figure


def test_the_users_settings_neither_matter_nor_change(scored_runs):
    plain = svg(tracking_figure(scored_runs[:3]), 'a')
    with mpl.rc_context({'lines.linewidth': 9.0, 'svg.fonttype': 'path', 'font.size': 30.0}):
        assert svg(tracking_figure(scored_runs[:3]), 'a') == plain
        assert mpl.rcParams['lines.linewidth'] == 9.0


def test_svg_is_well_formed_and_carries_no_date(scored_runs):
    document = svg(tracking_figure(scored_runs[:3]), 'a')
    ElementTree.fromstring(document)
    assert 'dc:date' not in document
