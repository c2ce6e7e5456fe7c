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
"""Writes the report of raster scans: figures of merit, images, and the images as files."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from piezo_ros.imaging.image_files import write_gwyddion, write_tiff
from piezo_ros.report.columns import Column, Value, value_text
from piezo_ros.report.figures.raster_figure import comparison_figure, deviation_figure, scan_figure
from piezo_ros.report.files import put_in_place
from piezo_ros.report.page.content import (
    Cell,
    Content,
    Facts,
    Fold,
    Heading,
    Paragraph,
    Picture,
    Section,
    Table,
)
from piezo_ros.report.page.page_writer import write_page
from piezo_ros.report.scanned_image import ScannedImage

__all__ = ['image_table', 'write_raster_report']

_COLUMNS: Final = (
    Column('scan'),
    Column('rms on lines', '% of travel', '.3f'),
    Column('rms', 'px', '.3f'),
    Column('max', 'px', '.3f'),
    Column('after affine', 'px', '.3f'),
    Column('scale error', '%', '.3f'),
    Column('retrace less trace', 'px', '.3f'),
    Column('its scatter', 'px', '.3f'),
    Column('line jitter', 'px', '.3f'),
    Column('correlation', '', '.4f'),
    Column('rms with noise', 'px', '.3f'),
    Column('files'),
)
# The same in a terminal, but for the files.
_SHORT: Final = (
    'line %', 'rms px', 'max', 'affine', 'scale %', 'back px', 'scatter', 'jitter', 'corr',
    'noisy')
_OPEN_SCANS: Final = 3
_IMAGES: Final = 'images'


def write_raster_report(
    directory: Path, *, title: str, scans: Sequence[ScannedImage], software: Mapping[str, str],
    notes: Sequence[str] = (), plan: str = '', command: str = '',
) -> Path:
    """
    Write report.html, report.json, figures/, and images/ (Gwyddion and TIFF files).

    Parameters
    ----------
    directory : Path
        Where to write.
    title : str
        Heading of the report.
    scans : sequence of ScannedImage
        The scans, at least one; those of one case are compared.
    software : mapping of str to str
        Name to version, of everything that the numbers may depend on.
    notes : sequence of str, optional
        Paragraphs for the reader.
    plan, command : str, optional
        Text of the plan and the command line that made the scans.

    Returns
    -------
    Path
        The written report.html.

    Raises
    ------
    ValueError
        If there is no scan.
    OSError
        If a file cannot be written.

    """
    if not scans:
        raise ValueError('scans is empty, a report needs at least one scan')
    notes = [*_about_noise(scans), *notes, *write_image_files(directory / _IMAGES, scans)]
    cases: dict[str, list[ScannedImage]] = {}
    for scan in scans:
        cases.setdefault(scan.case, []).append(scan)
    return write_page(
        directory, title=title, lead=[_facts(scans)], software=software, command=command,
        plan=plan, data={'scans': [scan.record() for scan in scans]},
        sections=[
            Section('quality', 'Figures of merit', [*_explanation(), _table(cases)]),
            Section('compared', 'Images', [
                Fold(case, _compared(case, members), is_open=number < _OPEN_SCANS)
                for number, (case, members) in enumerate(cases.items())]),
            Section('scans', 'Trace, retrace and distortion', [
                Fold(f'{scan.case}: {scan.variant}', _pictures(scan), is_open=number < _OPEN_SCANS)
                for number, scan in enumerate(scans)]),
            Section('notes', 'Notes', [Paragraph(note) for note in notes])])


def image_table(scans: Sequence[ScannedImage]) -> str:
    """
    Return the figures of merit as text for the terminal.

    Parameters
    ----------
    scans : sequence of ScannedImage
        The scans, at least one.

    """
    rows = [['', *_SHORT]]
    for scan in scans:
        values = zip(_figures(scan), _COLUMNS[1:-1], strict=True)
        rows.append([
            f'{scan.case}: {scan.variant}', *(value_text(*value) for value in values)])
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return '\n'.join(
        '  '.join([row[0].ljust(widths[0]), *(
            cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]).rstrip()
        for row in rows)


def write_image_files(directory: Path, scans: Sequence[ScannedImage]) -> list[str]:
    """
    Write every scan as a Gwyddion file and as TIFF files.

    Parameters
    ----------
    directory : Path
        Where to write; made when missing.
    scans : sequence of ScannedImage
        The scans.

    Returns
    -------
    list of str
        What a reader should know of the files.

    """
    directory.mkdir(parents=True, exist_ok=True)
    notes = [(
        f'{directory.name}/ has trace and retrace as TIFF files of 32-bit floats, heights in '
        'micrometres.')]
    has_gwyddion = True
    for scan in scans:
        images = scan.images
        # The top of an image is where y is largest.
        up = slice(None, None, -1 if images.nominal_y_um[-1] > images.nominal_y_um[0] else 1)
        x_px, y_px = images.trace_deviation_px
        channels = {
            'trace': images.trace(scan.sample)[up], 'retrace': images.retrace(scan.sample)[up],
            'trace, deviation along x': images.pixel_um * x_px[up],
            'trace, deviation along y': images.line_um * y_px[up]}
        for way in ('trace', 'retrace'):
            with put_in_place(directory / f'{scan.name}_{way}.tiff') as path:
                write_tiff(path, channels[way])
        try:
            with put_in_place(directory / f'{scan.name}.gwy') as path:
                write_gwyddion(
                    path, channels, width_um=images.pixel_um * images.nominal_x_um.size,
                    length_um=images.line_um * images.nominal_y_um.size)
        except ModuleNotFoundError:
            has_gwyddion = False
    if not has_gwyddion:
        return [*notes, (
            'There are no Gwyddion files: the package gwyfile is not installed '
            "(pip install 'piezo_ros[images]').")]
    return [*notes, (
        f'{directory.name}/ has Gwyddion files (.gwy) with trace, retrace and the deviation along '
        'x and y as channels.')]


def _about_noise(scans: Sequence[ScannedImage]) -> list[str]:
    if all(scan.noise_removed for scan in scans):
        return [(
            'Every position is that of the simulated stage: the noise of its sensor, which is '
            'known sample by sample, is taken away. The last column of the table has it.')]
    return [(
        'Positions are those that the sensors have measured: their noise counts as deviation of '
        'the image where nothing is known of it.')]


def _explanation() -> list[Content]:
    return [Paragraph(
        'A pixel is recorded when the reference of the fast axis passes its place; its deviation '
        'is where the tip was less where both references were. Rms on lines: along the fast axis, '
        'trace and retrace, of the travel from turn to turn. After affine: what no shift, scale, '
        'rotation or shear of the image undoes. The sample is synthetic: a grating with '
        'particles.')]


def _facts(scans: Sequence[ScannedImage]) -> Facts:
    best = min(scans, key=lambda scan: scan.quality.rms_px)
    worst = max(scans, key=lambda scan: scan.quality.rms_px)
    return Facts([
        (str(len(scans)), 'scan' if len(scans) == 1 else 'scans'),
        (f'{scans[0].images.nominal_y_um.size} × {scans[0].images.nominal_x_um.size}',
         'lines × pixels'),
        (f'{best.quality.rms_px:.3f} px', f'least rms deviation ({best.variant})'),
        (f'{worst.quality.rms_px:.3g} px', f'largest rms deviation ({worst.variant})')])


def _figures(scan: ScannedImage) -> list[Value]:
    quality = scan.quality
    return [
        quality.line_rms_percent, quality.rms_px, quality.maximum_px, quality.affine_rms_px,
        quality.scale_error_percent, quality.trace_retrace_mean_px, quality.trace_retrace_rms_px,
        quality.line_jitter_px, quality.correlation, scan.measured_rms_px]


def _table(cases: Mapping[str, Sequence[ScannedImage]]) -> Table:
    rows: list[Heading | Sequence[Value | Cell]] = []
    for case, members in cases.items():
        rows.append(Heading(case))
        for scan in members:
            path = f'{_IMAGES}/{scan.name}_trace.tiff'
            rows.append([scan.variant, *_figures(scan), Cell(path, link=path)])
    return Table(_COLUMNS, rows, 'Deviation of the images.')


def _compared(case: str, members: Sequence[ScannedImage]) -> list[Content]:
    name = members[0].name
    return [
        Picture(f'compared-{name}', f'{case}: the image of stages without error, and the traces.',
                partial(comparison_figure, members)),
        Picture(f'deviation-{name}', f'{case}: deviation along a line, mean of all lines.',
                partial(deviation_figure, members))]


def _pictures(scan: ScannedImage) -> list[Content]:
    return [Picture(
        f'scan-{scan.name}', 'Above: what is seen on the way there and back, and the first less '
        'the image of stages without error. Below: the deviation at each pixel.',
        partial(scan_figure, scan))]
