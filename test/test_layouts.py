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

"""The layouts of PlotJuggler, Foxglove and rqt: of their form, and of topics that there are."""

import ast
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from piezo_ros.bag import STREAMS, BagWriter

LAYOUTS = Path(__file__).parents[1] / 'config' / 'layouts'
PLOTJUGGLER = sorted(LAYOUTS.glob('plotjuggler_*.xml'))
OTHER_TOPICS = {'/status', '/diagnostics'}
# That nodes have these is tested by test/nodes/test_topics.py.
TOPICS = {f'/{stream}' for stream in STREAMS} | {
    f'/monitor/{stream}' for stream in STREAMS} | OTHER_TOPICS


def foxglove():
    return json.loads((LAYOUTS / 'foxglove.json').read_text(encoding='utf-8'))


def panels_of(layout):
    """Return the panels that a mosaic shows."""
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column')
    assert 0 < layout['splitPercentage'] < 100
    return [*panels_of(layout['first']), *panels_of(layout['second'])]


def message_paths():
    paths = []
    for panel, config in foxglove()['configById'].items():
        if panel.startswith('Plot!'):
            paths += [path['value'] for path in config['paths']]
            if config['xAxisVal'] == 'custom':
                paths.append(config['xAxisPath']['value'])
    return paths


def curves():
    return [
        curve.get('name') for path in PLOTJUGGLER
        for curve in ElementTree.parse(path).getroot().iter('curve')]


def test_each_foxglove_panel_is_shown_once_and_configured():
    document = foxglove()
    configured = document['configById']
    top = configured[document['layout']]
    shown = [panel for tab in top['tabs'] for panel in panels_of(tab['layout'])]
    assert sorted([*shown, document['layout']]) == sorted(configured)
    assert {'globalVariables', 'userNodes', 'playbackConfig'} <= document.keys()


def test_foxglove_names_only_topics_that_there_are():
    config = foxglove()['configById']
    assert {re.split(r'\.data', path)[0] for path in message_paths()} == TOPICS - OTHER_TOPICS
    assert {config['RawMessages!status']['topicPath'],
            config['DiagnosticSummary!all']['topicToRender']} == OTHER_TOPICS
    assert config['CallService!stop']['serviceName'] == '/plant/stop'


def test_plotjuggler_names_only_topics_that_there_are():
    assert [path.name for path in PLOTJUGGLER] == ['plotjuggler_bag.xml', 'plotjuggler_live.xml']
    assert {re.split(r'/data', name)[0] for name in curves()} == TOPICS - OTHER_TOPICS
    for path in PLOTJUGGLER:
        root = ElementTree.parse(path).getroot()
        (widget,) = root.iter('tabbed_widget')
        assert widget.get('parent') == 'main_window'
        for splitter in root.iter('DockSplitter'):
            count = int(splitter.get('count'))
            assert len(splitter.findall('DockArea')) == count
            assert len(splitter.get('sizes').split(';')) == count


@pytest.mark.parametrize('kind', ['live', 'bag'])
def test_a_plotjuggler_layout_selects_the_topics_that_it_plots(kind):
    root = ElementTree.parse(LAYOUTS / f'plotjuggler_{kind}.xml').getroot()
    (selected,) = [
        value for element in root.find('Plugins').iter()
        for value in [element.get('selected_topics') or (
            element.get('value') if element.tag == 'selected_topics' else None)] if value]
    plotted = {re.split(r'/data', curve.get('name'))[0] for curve in root.iter('curve')}
    assert set(selected.split(';')) == plotted


def test_the_rqt_perspective_plots_what_the_monitors_publish():
    """Read as rqt reads it: values are literals of Python, plug-ins have a group each."""
    document = json.loads((LAYOUTS / 'rqt.perspective').read_text(encoding='utf-8'))
    manager = document['groups']['pluginmanager']

    def value(entry):
        assert entry['type'] == 'repr'
        return ast.literal_eval(entry['repr'])

    running = value(manager['keys']['running-plugins'])
    assert running == {'rqt_plot/Plot': [1, 2, 3], 'rqt_service_caller/ServiceCaller': [1]}
    assert manager['groups'].keys() == {
        f'plugin__{name.replace("/", "__")}__{number}'
        for name, numbers in running.items() for number in numbers}
    plotted = [
        topic for number in running['rqt_plot/Plot']
        for topic in value(
            manager['groups'][f'plugin__rqt_plot__Plot__{number}']['groups']['plugin']['keys'][
                'topics'])]
    assert sorted(plotted) == sorted(f'/monitor/{stream}/data' for stream in STREAMS)


def test_the_paths_find_samples_in_a_bag_of_ours(tmp_path):
    """Read as the tools read: `data[2]` of the generic message is the first sample of a block."""
    with BagWriter(tmp_path / 'bag', topics={stream: f'/{stream}' for stream in STREAMS}) as bag:
        for stream in STREAMS:
            bag.write_block(stream, 0, 1e-5, [0.25])
    recorded = [
        name for name in [*curves(), *message_paths()] if not name.startswith('/monitor/')]
    assert recorded
    from rosbags.typesys import Stores, get_typestore
    types = get_typestore(Stores.ROS2_JAZZY)
    with Reader(tmp_path / 'bag') as reader:
        messages = {
            connection.topic: types.deserialize_cdr(raw, connection.msgtype)
            for connection, _, raw in reader.messages()}
    for name in recorded:
        topic, index = re.fullmatch(r'(/\w+)[./]data\[(\d+)\]', name).groups()
        assert messages[topic].data[int(index)] == 0.25
