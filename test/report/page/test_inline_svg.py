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

import re

import numpy as np
import pytest

from piezo_ros.report.figures.export import svg
from piezo_ros.report.figures.tracking_figure import tracking_figure
from piezo_ros.report.figures.uncertainty_figure import uncertainty_figure
from piezo_ros.report.page.inline_svg import inline_svg


def test_inline_svg_takes_its_colours_from_the_page(scored_runs):
    element = inline_svg(svg(tracking_figure(scored_runs[:3]), 'a'), 'what it shows')
    assert element.startswith('<svg viewBox=')
    assert 'aria-label="what it shows"' in element
    assert 'currentColor' in element
    assert 'var(--fbff, #007a58)' in element
    assert 'http' not in element


def test_inline_svg_of_something_else_is_refused():
    with pytest.raises(ValueError, match='<svg width="3">'):
        inline_svg('<svg width="3"></svg>', 'nothing')


def test_pictures_of_one_page_share_no_identifier(scored_runs):
    identifiers = [
        set(re.findall(r'\bid="([^"]+)"', inline_svg(svg(tracking_figure(scored_runs), name), '')))
        for name in ('a', 'b')]
    assert identifiers[0]
    assert not identifiers[0] & identifiers[1]


def test_identifiers_of_two_drawings_differ_also_where_a_picture_is_inside():
    figure = uncertainty_figure(np.tile([1.0, 2.0], 2000), np.full(4000, 0.1), [])
    assert '<image ' in svg(figure, 'a')
    first, second = (
        set(re.findall(r'\bid="([^"]+)"', inline_svg(svg(figure, name), '')))
        for name in ('a', 'b'))
    assert first
    assert not first & second
