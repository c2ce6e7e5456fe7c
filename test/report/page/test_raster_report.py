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
"""The report of raster scans: its figures, its table, and the images as files."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from scanned_images import scanned_image

from piezo_ros.report.figures.raster_figure import comparison_figure, deviation_figure, scan_figure
from piezo_ros.report.page import raster_report
from piezo_ros.report.page.raster_report import (
    image_table,
    write_image_files,
    write_raster_report,
)


@pytest.fixture(scope='module')
def scans():
    return [
        scanned_image(), scanned_image('001_b', 'learned', scale=1.0),
        scanned_image('002_c', descends=True, case='down')]


@pytest.fixture(scope='module')
def files(scans, tmp_path_factory):
    pytest.importorskip('gwyfile')
    directory = tmp_path_factory.mktemp('images')
    write_image_files(directory, scans)
    return directory


def labels(figure):
    return [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]


def test_every_map_has_a_colour_bar_with_its_unit(scans):
    figure = scan_figure(scans[0])
    bars = [axes.get_ylabel() for place in figure.axes for axes in place.child_axes]
    assert bars == ['height (nm)'] * 3 + ['pixels', 'lines', 'pixels']
    compared = comparison_figure(scans[:2])
    assert labels(compared) == ['y (µm)', 'height (nm)', 'difference (nm)']


def test_traces_of_one_case_have_one_scale(scans):
    figure = comparison_figure(scans[:2])
    limits = [axes.images[0].get_clim() for axes in figure.axes if axes.images]
    assert limits[0] == limits[1] == limits[2]
    assert limits[-1] == limits[-2]
    assert limits[-1][0] == -limits[-1][1]


def test_deviations_are_drawn_for_both_ways(scans):
    figure = deviation_figure(scans[:2])
    assert isinstance(figure, Figure)
    assert len(figure.axes[0].lines) == 4


@pytest.mark.parametrize('draw', [comparison_figure, deviation_figure])
def test_nothing_makes_no_figure(draw):
    with pytest.raises(ValueError, match='scans is empty'):
        draw([])


def test_the_page_has_what_there_is(scans, tmp_path):
    write_raster_report(tmp_path, title='Scans', scans=scans[:1], software={}, notes=['a note'])
    page = (tmp_path / 'report.html').read_text()
    for text in ('Figures of merit', 'a note', '20 lines', 'planned', 'images/000_a_trace.tiff'):
        assert text in page
    (record,) = json.loads((tmp_path / 'report.json').read_text())['scans']
    assert record['rms_px'] == scans[0].quality.rms_px
    assert record['scale_error_percent'] == pytest.approx(-3.0, abs=1e-6)
    assert (tmp_path / 'images' / '000_a_trace.tiff').is_file()
    assert len(list((tmp_path / 'figures').glob('*.png'))) == 3


def test_every_scan_has_its_files(files, scans):
    assert {path.name for path in files.iterdir()} == {
        f'{scan.name}{end}' for scan in scans
        for end in ('.gwy', '_trace.tiff', '_retrace.tiff')}


@pytest.mark.parametrize('number', [0, 2])
def test_the_top_of_an_image_file_is_where_y_is_largest(files, scans, number):
    scan = scans[number]
    image_files = pytest.importorskip('PIL.Image')
    top = int(np.argmax(scan.images.nominal_y_um))
    with image_files.open(files / f'{scan.name}_trace.tiff') as image:
        np.testing.assert_allclose(
            np.array(image)[0], scan.images.trace(scan.sample)[top], rtol=1e-6)


def test_a_gwyddion_file_has_all_channels(files):
    gwyfile = pytest.importorskip('gwyfile')
    container = gwyfile.load(str(files / '000_a.gwy'))
    channels = gwyfile.util.get_datafields(container)
    assert set(channels) == {
        'trace', 'retrace', 'trace, deviation along x', 'trace, deviation along y'}
    # 3 % too small over 80 % of 4 um.
    deviation_m = channels['trace, deviation along x'].data
    assert np.abs(deviation_m).max() == pytest.approx(0.03 * 1.6e-6, rel=0.05)


def test_without_the_package_for_gwyddion_the_rest_is_there(scans, tmp_path, monkeypatch):
    def absent(*_arguments, **_keywords):
        raise ModuleNotFoundError("No module named 'gwyfile'", name='gwyfile')

    monkeypatch.setattr(raster_report, 'write_gwyddion', absent)
    notes = write_image_files(tmp_path, scans)
    assert "pip install 'piezo_ros[images]'" in notes[-1]
    assert len(list(tmp_path.iterdir())) == 2 * len(scans)


def test_the_table_of_the_terminal_has_a_row_for_each_scan(scans):
    lines = image_table(scans).splitlines()
    assert len(lines) == 1 + len(scans)
    assert lines[1].startswith('20 lines: planned')
    assert '-3.000' in lines[1]


def test_a_report_of_nothing_is_refused(tmp_path):
    with pytest.raises(ValueError, match='scans is empty'):
        write_raster_report(tmp_path, title='', scans=[], software={})
