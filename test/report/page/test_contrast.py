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
"""The colours of pages and figures can be read: contrast at least 4.5 (WCAG 2.2, 1.4.3)."""

import re
from importlib.resources import files

import pytest

from piezo_ros.report.figures import style
from piezo_ros.report.page.colours import PAGE_COLOURS

CSS = files('piezo_ros.report.page').joinpath('templates', 'report.css').read_text(encoding='utf-8')
LEAST = 4.5
CURVES = {'fb', 'ff', 'fbff', 'open-loop', 'faint', *(f'series-{n}' for n in range(1, 7))}


def variables(block):
    return dict(re.findall(r'--([\w-]+): (#[0-9a-f]{6});', block))


LIGHT = variables(re.search(r':root \{(.*?)\}', CSS, re.DOTALL)[1])
DARK = LIGHT | variables(
    re.search(r'prefers-color-scheme: dark\) \{\s*:root \{(.*?)\}', CSS, re.DOTALL)[1])


def luminance(colour):
    channels = [int(colour[i:i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_the_definition():
    assert contrast('#000000', '#ffffff') == pytest.approx(21.0)
    assert contrast('#767676', '#ffffff') == pytest.approx(4.54, abs=0.01)


@pytest.mark.parametrize('page', [LIGHT, DARK], ids=['light', 'dark'])
def test_words_and_curves_of_a_page_stand_out_from_it(page):
    assert page.keys() >= CURVES | {'ink', 'soft', 'link', 'page', 'panel'}
    for name in CURVES | {'ink', 'soft', 'link'}:
        assert contrast(page[name], page['page']) >= LEAST, name
    for name in ('ink', 'soft', 'link'):
        assert contrast(page[name], page['panel']) >= LEAST, name


def test_curves_of_figure_files_stand_out_from_white():
    for colour in (*style.SCHEME_COLOURS.values(), *style.SERIES, style.FAINT, style.INK):
        assert contrast(colour, style.BACKGROUND) >= LEAST, colour


def test_every_colour_of_a_figure_is_that_of_the_light_page():
    for colour, on_page in PAGE_COLOURS.items():
        variable = re.match(r'var\(--([\w-]+)', on_page)
        if variable and variable[1] != 'grid':
            assert LIGHT[variable[1]] == colour


def test_schemes_and_series_differ_without_their_colours():
    styles = [style.scheme_line_style(scheme) for scheme in style.SCHEME_COLOURS]
    assert len(set(styles)) == len(styles)
    assert len(set(style.SCHEME_MARKERS.values())) == len(style.SCHEME_COLOURS)
    assert len(set(style.MARKERS)) == len(style.SERIES)
    again = [style.scheme_line_style('ff', earlier) for earlier in range(4)]
    assert len(set(again)) == 4
