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

import csv
import dataclasses
import json

import pytest
from markupsafe import Markup
from matplotlib.figure import Figure

from piezo_ros.report.page.content import (
    Cell,
    Column,
    Facts,
    Fold,
    Heading,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.page_writer import write_page

SOFTWARE = {'piezo_ros': '0.1.0', 'numpy': '2.4.6'}


def drawing(points=3, rasterized=False):
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot(range(points), range(points), 'o', rasterized=rasterized)
    return figure


MODEL = Table(
    [Column('parameter'), Column('ours', 'rad/s', '.4g'), Column('paper', 'rad/s', '.4g')],
    [Heading('actuator'), ['omega_1', Cell(15287.123456, strong=True), 15290.0],
     Heading('sensor'), [Cell('zero', link='#figures'), -34701.5, None]],
    'Table 2.')


def page(directory, *sections, data=None, **others):
    return write_page(directory, title='Paper', lead=[Paragraph('All of it.')], sections=sections,
                      software=SOFTWARE, data=data or {}, **others)


def whole_page(directory):
    return page(
        directory,
        Section('models', 'Models & more', [Paragraph('a < b'), Facts([('7 %', 'off')]), MODEL]),
        Section('figures', 'Figures', [
            Picture('points', 'Many points.', lambda: drawing(9, rasterized=True)),
            Fold('Less', [Picture('fig/2', 'Few points.', drawing())]),
            Markup('<p>as <em>it</em> is</p>')]),
        data={'table3': [{'crossing_hz': 612.5}]}, command='piezo run x', plan='title: x')


def test_a_page_lists_its_sections_and_shows_all_they_hold(read_page, tmp_path):
    read = read_page(whole_page(tmp_path))
    sections = [attrs['id'] for tag, attrs in read.tags if tag == 'section']
    assert sections == ['models', 'figures', 'made']
    assert read.attributes('href')[:3] == [f'#{section}' for section in sections]
    for text in ('Models & more', 'a < b', '7 %', 'Table 2.', 'Many points.', 'as it is', '2.4.6',
                 'piezo run x', 'title: x', 'All of it.'):
        assert text in read.text
    assert read.misnested == []
    assert read.open == []
    identifiers = read.attributes('id')
    assert len(identifiers) == len(set(identifiers))


def test_a_page_loads_nothing_from_elsewhere_not_even_its_rasterised_points(read_page, tmp_path):
    read = read_page(whole_page(tmp_path))
    links = read.attributes('src', 'href', 'xlink:href')
    images = [link for link in links if link.startswith('data:image/png;base64,')]
    assert len(images) == 1
    for link in set(links) - set(images):
        assert ':' not in link
        assert link[1:] in read.attributes('id') if link[0] == '#' else (tmp_path / link).is_file()


def test_pictures_and_tables_of_a_page_are_files_too(tmp_path):
    whole_page(tmp_path)
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob('*') if path.is_file()} == {
        'report.html', 'report.json', 'tables/models.csv', 'figures/points.svg',
        'figures/points.png', 'figures/fig-2.svg', 'figures/fig-2.png'}


def test_a_page_is_the_same_bytes_again(tmp_path):
    trees = []
    for name in ('a', 'b'):
        whole_page(tmp_path / name)
        trees.append({path.name: path.read_bytes()
                      for path in (tmp_path / name).rglob('*') if path.is_file()})
    assert trees[0] == trees[1]


def test_data_of_a_page_stand_between_title_and_software(tmp_path):
    whole_page(tmp_path)
    data = json.loads((tmp_path / 'report.json').read_text(encoding='utf-8'))
    assert list(data) == ['format_version', 'title', 'table3', 'software']
    assert data['table3'] == [{'crossing_hz': 612.5}]


def test_a_table_is_rounded_on_the_page_and_exact_in_its_file(read_page, tmp_path):
    read = read_page(whole_page(tmp_path))
    assert '1.529 · 10<sup>4</sup>' in read.source
    assert '\N{MINUS SIGN}3.47 · 10<sup>4</sup>' in read.source
    assert '–' in read.text
    with (tmp_path / 'tables' / 'models.csv').open(newline='', encoding='utf-8') as file:
        assert list(csv.reader(file)) == [
            ['group', 'parameter', 'ours (rad/s)', 'paper (rad/s)'],
            ['actuator', 'omega_1', '15287.123456', '15290.0'],
            ['sensor', 'zero', '-34701.5', '']]


def test_two_tables_of_one_section_are_two_files(tmp_path):
    named = dataclasses.replace(MODEL, name='table 2')
    page(tmp_path, Section('a', 'A', [MODEL, MODEL, Fold('more', [named])]))
    assert sorted(path.name for path in (tmp_path / 'tables').iterdir()) == [
        'a-2.csv', 'a.csv', 'table-2.csv']


def test_every_string_of_a_page_is_escaped(read_page, tmp_path):
    evil = '<script>alert("1")</script>&\'x'
    table = Table(
        [Column(evil, evil), Column(evil, '', '.2f')],
        [Heading(evil), [Cell(evil, scheme=evil, link='javascript:alert(1)'), evil]], evil)
    read = read_page(page(
        tmp_path, Section('a', evil, [
            Paragraph(evil), Facts([(evil, evil)]), table, Picture(evil, evil, drawing()),
            Fold(evil, [])]), plan=evil, command=evil))
    assert 'script' not in {tag for tag, _ in read.tags}
    assert read.misnested == []
    assert read.text.count(evil) == 16
    assert not [link for link in read.attributes('href') if ':' in link]
    assert not [name for _, attrs in read.tags for name in attrs if name.startswith('on')]


@pytest.mark.parametrize(('sections', 'data', 'message'), [
    ([Section('a', 'A', []), Section('a', 'B', [])], {}, "anchor 'a' is that of 2"),
    ([Section('made', 'A', [])], {}, "anchor 'made'"),
    ([Section('a b', 'A', [])], {}, "anchor of section 'A' is 'a b'"),
    ([Section('a', 'A', [Picture('p', '', drawing()), Picture('p', '', drawing())])], {},
     'two pictures or tables would be figures/p.svg'),
    ([Section('a', 'A', [Table([Column('x')], [[1, 2]], 'T')])], {}, "table 'T' has 1 columns"),
    ([Section('a', 'A', [Table([Column('x', '', '.1f')], [[float('inf')]], 'T')])], {},
     "'T', column 'x' holds inf"),
    ([], {'margins': {'gain': [1.0, float('nan')]}}, r'report.json: margins.gain\[1\] is nan'),
])
def test_what_makes_no_page_is_refused_by_name_and_nothing_is_written(
        tmp_path, sections, data, message):
    with pytest.raises(ValueError, match=message):
        page(tmp_path / 'out', *sections, data=data)
    assert not (tmp_path / 'out').exists()
