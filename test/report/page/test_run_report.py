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

import dataclasses
import json
import xml.etree.ElementTree as ElementTree
from importlib import resources

import pytest

from piezo_ros.report.page.run_report import write_report

SOFTWARE = {'piezo_ros': '0.1.0', 'numpy': '2.4.6'}
TEMPLATES = resources.files('piezo_ros.report.page') / 'templates'


@pytest.fixture(scope='module')
def report(tmp_path_factory, scored_runs):
    return write_report(
        tmp_path_factory.mktemp('report'), title='Triangles', runs=scored_runs, software=SOFTWARE,
        notes=['One run was lost.'], plan='runs:\n  - scheme: ff\n', command='piezo run x.yaml')


def test_the_page_loads_nothing_from_elsewhere(read_page, report):
    page = read_page(report)
    assert not {'link', 'img', 'iframe', 'object', 'base'} & {tag for tag, _ in page.tags}
    assert not [attrs for tag, attrs in page.tags if tag == 'script' and 'src' in attrs]
    links = page.attributes('src', 'href', 'xlink:href', 'srcset', 'data', 'action')
    assert links
    assert not [link for link in links if ':' in link or link.startswith('/')]
    assert '@import' not in page.source
    assert 'url(' not in page.source.replace('url(#', '')


def test_every_link_inside_the_page_and_beside_it_leads_somewhere(read_page, report, scored_runs):
    page = read_page(report)
    anchors = set(page.attributes('id'))
    bags = {run.bag for run in scored_runs}
    for link in page.attributes('href', 'xlink:href'):
        if link.startswith('#'):
            assert link[1:] in anchors
        else:
            assert link in bags or (report.parent / link).is_file(), link


def test_the_page_nests_and_no_identifier_is_used_twice(read_page, report):
    page = read_page(report)
    assert page.misnested == []
    assert page.open == []
    identifiers = page.attributes('id')
    assert len(identifiers) == len(set(identifiers))


def test_the_page_has_contents_table_pictures_and_origin(read_page, report, scored_runs):
    page = read_page(report)
    sections = [attrs['id'] for tag, attrs in page.tags if tag == 'section']
    assert sections == ['results', 'loop', 'runs', 'notes', 'made']
    assert [link for link in page.attributes('href') if link[0] == '#'][:5] == [
        f'#{section}' for section in sections]
    assert sum(tag == 'svg' for tag, _ in page.tags) == 1 + 6 * 2
    for words in ('Triangles', '2.10', 'One run was lost.', 'piezo run x.yaml', '- scheme: ff',
                  '2.4.6', f'{scored_runs[1].nrmse_percent:.2f}'):
        assert words in page.text


def test_several_frequencies_add_a_picture_of_nrmse(read_page, tmp_path, scored_runs):
    other = dataclasses.replace(scored_runs[1], frequency_hz=400.0, paper_nrmse_percent=2.51)
    page = read_page(write_report(
        tmp_path, title='t', runs=[scored_runs[1], other], software=SOFTWARE))
    assert 'nrmse' in page.attributes('id')
    assert (tmp_path / 'figures' / 'nrmse-triangle.svg').is_file()


def test_every_string_is_escaped(read_page, tmp_path, scored_runs):
    evil = '<script>alert("1")</script>&\'x'
    run = dataclasses.replace(scored_runs[1], bag=evil, scheme=evil, waveform=evil)
    page = read_page(write_report(
        tmp_path, title=evil, runs=[run, scored_runs[1]], software={evil: evil}, notes=[evil],
        plan=evil, command=evil))
    scripts = [attrs.get('type', '') for tag, attrs in page.tags if tag == 'script']
    assert scripts == ['application/json'] * 2 * 6 + [''] * 3  # six charts of each reference
    assert '<script>alert' not in page.source
    assert page.misnested == []
    assert page.text.count(evil) >= 7
    assert not [name for _, attrs in page.tags for name in attrs if name.startswith('on')]


def test_a_bag_cannot_smuggle_a_scheme_into_its_link(read_page, tmp_path, scored_runs):
    run = dataclasses.replace(scored_runs[1], bag='javascript:alert(1)')
    page = read_page(write_report(tmp_path, title='t', runs=[run], software={}))
    assert not [link for link in page.attributes('href') if ':' in link]


def test_json_holds_the_numbers_exactly(report, scored_runs):
    data = json.loads((report.parent / 'report.json').read_text(encoding='utf-8'))
    assert list(data) == ['format_version', 'title', 'runs', 'software']
    assert data['format_version'] == 1
    assert data['title'] == 'Triangles'
    assert data['software'] == SOFTWARE
    always = {
        'scheme': str, 'waveform': str, 'amplitude_um': float, 'frequency_hz': float,
        'harmonics': int, 'nrmse_percent': float, 'max_error_um': float, 'bag': str,
        'samples': int, 'wall_seconds': float}
    for record, run in zip(data['runs'], scored_runs, strict=True):
        published = record.pop('paper_nrmse_percent', None)
        assert published == run.paper_nrmse_percent
        condition = {name: record.pop(name) for name in run.condition.record()}
        assert condition == run.condition.record()
        assert {name: type(value) for name, value in record.items()} == always
        assert record == {name: getattr(run, name) for name in always}
    assert sum('paper_nrmse_percent' in run.record() for run in scored_runs) == 2


def test_the_same_input_gives_the_same_bytes(tmp_path, scored_runs):
    trees = []
    for name in ('a', 'b'):
        write_report(tmp_path / name, title='t', runs=scored_runs, software=SOFTWARE)
        files = sorted(path for path in (tmp_path / name).rglob('*') if path.is_file())
        trees.append({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in files})
    assert trees[0] == trees[1]
    assert {'report.html', 'report.json', 'runs.csv', 'figures/tracking-triangle-2um-300Hz.svg',
            'figures/tracking-triangle-2um-300Hz.png'} <= trees[0].keys()


def test_a_number_that_is_not_finite_is_refused(tmp_path, scored_runs):
    run = dataclasses.replace(scored_runs[0], max_error_um=float('nan'))
    with pytest.raises(ValueError, match='nan'):
        write_report(tmp_path, title='t', runs=[run], software={})
    assert list(tmp_path.iterdir()) == []


def test_a_report_of_nothing_is_refused(tmp_path):
    with pytest.raises(ValueError, match='runs is empty'):
        write_report(tmp_path, title='t', runs=[], software={})


def test_loop_picture_names_every_topic_and_has_no_colour_of_its_own():
    picture = (TEMPLATES / 'loop.svg').read_text('utf-8')
    text = ' '.join(ElementTree.fromstring(picture).itertext())
    for topic in ('reference', 'feedforward', 'command', 'voltage', 'displacement', 'demand'):
        assert text.count(topic) >= 2  # in the title and on its arrow
    assert 'currentColor' in picture
    assert '="#' not in picture
