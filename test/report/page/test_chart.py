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

import base64
import json

import numpy as np
import pytest

from piezo_ros.report.figures.style import LINE_STYLES, SCHEME_COLOURS
from piezo_ros.report.page.chart import Line, Panel, Trace, chart_json, chart_library


def read_chart(panels):
    return json.loads(chart_json('a', 'A chart.', panels))['panels']


def values_of(text):
    return np.frombuffer(base64.b64decode(text), dtype='<f4')


def test_a_chart_holds_its_values_and_colours_that_follow_the_page():
    x = np.linspace(0.0, 2.0, 5)
    panel, = read_chart([Panel('time (ms)', 'error (nm)', [
        Trace('ff', x, x**2, SCHEME_COLOURS['ff'], 'dashed'),
        Trace('other', x, -x, '#123456', band=(-x - 1.0, -x + 1.0))],
        lines=[Line(3.0, 'limit')])])
    first, second = panel['traces']
    assert values_of(panel['abscissas'][first['x']]) == pytest.approx(x)
    assert values_of(first['y']) == pytest.approx(x**2)
    assert first['x'] == second['x']
    assert len(panel['abscissas']) == 1
    assert first['colour'] == f'var(--ff, {SCHEME_COLOURS["ff"]})'
    assert second['colour'] == '#123456'
    assert [values_of(limit)[0] for limit in second['band']] == [-1.0, 1.0]
    assert panel['lines'] == [{'axis': 'y', 'value': 3.0, 'label': 'limit'}]


def test_a_long_trace_keeps_its_least_and_greatest_values_and_its_gaps():
    y = np.zeros(200_000)
    y[[12_345, 199_998]], y[77_777], y[150_001] = 5.0, -7.0, np.nan
    panel, = read_chart([Panel('k', 'y', [Trace('y', np.arange(y.size), y)])])
    shown, x = values_of(panel['traces'][0]['y']), values_of(panel['abscissas'][0])
    assert shown.size < 7000
    assert (np.diff(x) > 0).all()
    assert x[0] == 0
    assert x[-1] == y.size - 1
    for index in (12_345, 77_777, 150_001, 199_998):
        assert shown[x == index] == pytest.approx(y[[index]], nan_ok=True)


def test_what_is_not_finite_or_not_positive_on_a_logarithmic_axis_is_a_gap():
    y = [1.0, np.inf, 0.0, np.nan, -1.0, 1e300]
    for log_y, gaps in ((False, [1, 3]), (True, [1, 2, 3, 4])):
        panel, = read_chart([Panel('k', 'y', [Trace('y', np.arange(6), y)], log_y=log_y)])
        shown = values_of(panel['traces'][0]['y'])
        assert np.flatnonzero(np.isnan(shown)).tolist() == gaps
        assert np.isfinite(shown[5])


def test_words_of_a_chart_cannot_end_its_script():
    text = chart_json('a', '</script><b>', [Panel('x', 'y', [Trace('<!--&', [1.0], [1.0])])])
    assert not set('<>&') & set(text)
    assert json.loads(text)['description'] == '</script><b>'


@pytest.mark.parametrize(('trace', 'panel', 'message'), [
    (Trace('a', [0, 1], [0, 1], style='wavy'), {}, "style of trace 'a' is 'wavy'.*dashdot, none"),
    (Trace('a', [0, 1], [0, 1], marker='x'), {}, "marker of trace 'a' is 'x'"),
    (Trace('a', [0, 1], [0, 1, 2]), {}, r"trace 'a' have the shapes \(2,\), \(3,\)"),
    (Trace('a', [0, 1], [0, 1], band=([0, 1], [2])), {}, r'shapes \(2,\), \(2,\), \(2,\), \(1,\)'),
    (Trace('a', [1, 0], [0, 1]), {}, "x of trace 'a' must be finite and ascending"),
    (Trace('a', [0, np.nan], [0, 1]), {}, "x of trace 'a' must be finite"),
    (Trace('a', [0, 1], [0, 1]), {'log_x': True}, 'begins with 0.0, on a logarithmic axis'),
])
def test_a_trace_that_cannot_be_drawn_is_refused_by_name(trace, panel, message):
    with pytest.raises(ValueError, match=message):
        chart_json('a', '', [Panel('x', 'y', [trace], **panel)])


def test_every_line_style_of_the_figures_is_one_of_the_charts():
    traces = [Trace(style, [0, 1], [0, 1], style=style) for style in LINE_STYLES]
    panel, = read_chart([Panel('x', 'y', traces)])
    assert [trace['style'] for trace in panel['traces']] == list(LINE_STYLES)


def test_the_library_brings_its_licence_and_ends_its_script_only_once():
    library = chart_library()
    assert 'Permission is hereby granted, free of charge' in library.script
    assert library.script.count('</script>') == 2
    assert library.style.count('</style>') == 1
