import dataclasses
import json
from html.parser import HTMLParser

import pytest

from piezo_ros.report.html import write_report

SOFTWARE = {'piezo_ros': '0.1.0', 'numpy': '2.4.6'}
VOID = {'meta', 'br', 'img', 'link', 'hr', 'input'}


class Page(HTMLParser):
    """What of a page matters here: its tags with attributes, its text and whether it nests."""

    def __init__(self, path):
        super().__init__()
        self.tags, self.text, self.open, self.misnested = [], '', [], []
        self.source = path.read_text(encoding='utf-8')
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.misnested.append((tag, self.getpos()))

    def handle_data(self, data):
        self.text += data

    def attributes(self, *names):
        return [value for _, attrs in self.tags for name, value in attrs.items() if name in names]


@pytest.fixture
def report(tmp_path, scored_runs):
    return write_report(
        tmp_path / 'out', title='Triangles', runs=scored_runs, software=SOFTWARE,
        notes=['One run was lost.'], plan='runs:\n  - scheme: ff\n', command='piezo run x.yaml')


def test_the_page_loads_nothing_from_elsewhere(report):
    page = Page(report)
    assert not {'script', 'link', 'img', 'iframe', 'object', 'base'} & {tag for tag, _ in page.tags}
    links = page.attributes('src', 'href', 'xlink:href', 'srcset', 'data', 'action')
    assert links
    assert not [link for link in links if ':' in link or link.startswith('/')]
    assert '@import' not in page.source
    assert 'url(' not in page.source.replace('url(#', '')


def test_every_link_inside_the_page_and_beside_it_leads_somewhere(report, scored_runs):
    page = Page(report)
    anchors = set(page.attributes('id'))
    bags = {run.bag for run in scored_runs}
    for link in page.attributes('href', 'xlink:href'):
        if link.startswith('#'):
            assert link[1:] in anchors
        else:
            assert link in bags or (report.parent / link).is_file(), link


def test_the_page_nests_and_no_identifier_is_used_twice(report):
    page = Page(report)
    assert page.misnested == []
    assert page.open == []
    identifiers = page.attributes('id')
    assert len(identifiers) == len(set(identifiers))


def test_the_page_has_contents_table_pictures_and_origin(report, scored_runs):
    page = Page(report)
    sections = [attrs['id'] for tag, attrs in page.tags if tag == 'section']
    assert sections == ['results', 'loop', 'runs', 'notes', 'made']
    assert [link for link in page.attributes('href') if link[0] == '#'][:5] == [
        f'#{section}' for section in sections]
    assert sum(tag == 'svg' for tag, _ in page.tags) == 1 + 3 * 2
    for words in ('Triangles', '2.10', 'One run was lost.', 'piezo run x.yaml', '- scheme: ff',
                  '2.4.6', f'{scored_runs[1].nrmse_percent:.2f}'):
        assert words in page.text


def test_several_frequencies_add_a_picture_of_nrmse(tmp_path, scored_runs):
    other = dataclasses.replace(scored_runs[1], frequency_hz=400.0, paper_nrmse_percent=2.51)
    page = Page(write_report(
        tmp_path, title='t', runs=[scored_runs[1], other], software=SOFTWARE))
    assert 'nrmse' in page.attributes('id')
    assert (tmp_path / 'figures' / 'nrmse-triangle.svg').is_file()


def test_every_string_is_escaped(tmp_path, scored_runs):
    evil = '<script>alert("1")</script>&\'x'
    run = dataclasses.replace(scored_runs[1], bag=evil, scheme=evil, waveform=evil)
    page = Page(write_report(
        tmp_path, title=evil, runs=[run, scored_runs[1]], software={evil: evil}, notes=[evil],
        plan=evil, command=evil))
    assert 'script' not in {tag for tag, _ in page.tags}
    assert page.misnested == []
    assert page.text.count(evil) >= 7
    assert not [name for _, attrs in page.tags for name in attrs if name.startswith('on')]


def test_a_bag_cannot_smuggle_a_scheme_into_its_link(tmp_path, scored_runs):
    run = dataclasses.replace(scored_runs[1], bag='javascript:alert(1)')
    page = Page(write_report(tmp_path, title='t', runs=[run], software={}))
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
