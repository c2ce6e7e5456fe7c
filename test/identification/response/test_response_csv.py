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

"""A frequency response as a table: its own CSV and back, and the tables of other programs."""

import re

import numpy as np
import pytest

from piezo_ros.cli.main import main
from piezo_ros.identification.response.frequency_response import (
    ExcludedPoint,
    FrequencyResponse,
)
from piezo_ros.identification.response.response_csv import read_response, response_csv

FREQUENCY_HZ = np.geomspace(10.0, 1000.0, 30)
RESPONSE = 0.97 / (1.0 + 1j * FREQUENCY_HZ / 200.0)


def measured(input_unit='um'):
    zeros = np.zeros(FREQUENCY_HZ.size)
    return FrequencyResponse(
        FREQUENCY_HZ, RESPONSE, 1e-6 * np.abs(RESPONSE), zeros + np.nan, zeros, zeros + 0.3, zeros,
        1e-4, (ExcludedPoint(5.0, 1.0, 0.0, 'lost; "half" of it, or more'),),
        input_unit=input_unit)


def table(header, rows, separator=','):
    return '\n'.join([header, *(separator.join(f'{value:.12g}' for value in row) for row in rows)])


@pytest.mark.parametrize('unit', ['um', 'v'])
def test_d14_each_column_has_one_unit_in_its_name(unit):
    header = response_csv(measured(unit)).splitlines()[0].split(',')
    assert header == [
        'frequency_hz', f'gain_um_per_{unit}', 'phase_deg', f'real_um_per_{unit}',
        f'imaginary_um_per_{unit}', f'standard_error_um_per_{unit}', 'coherence', 'distortion',
        f'amplitude_{unit}', f'offset_{unit}', 'sample_period_s', 'left_out']


@pytest.mark.parametrize('unit', ['um', 'v'])
def test_d14_what_is_written_is_read_back_to_the_digits(tmp_path, unit):
    text = response_csv(measured(unit))
    (tmp_path / 'a.csv').write_text(text)
    found = read_response(tmp_path / 'a.csv')
    assert np.array_equal(found.response, RESPONSE)
    assert np.array_equal(found.frequency_hz, FREQUENCY_HZ)
    assert found.variance == pytest.approx(measured().variance, rel=1e-15)
    assert (found.sample_period_s, found.input_unit, found.notes) == (1e-4, unit, ())
    assert found.excluded == measured().excluded
    assert response_csv(found) == text


OMEGA = 2.0 * np.pi * FREQUENCY_HZ
DECIBEL, DEGREES = 20.0 * np.log10(np.abs(RESPONSE)), np.angle(RESPONSE, deg=True)
PARTS = list(zip(FREQUENCY_HZ, RESPONSE.real, RESPONSE.imag, strict=True))


@pytest.mark.parametrize('text', [
    table('Frequency [Hz]\tMagnitude [dB]\tPhase [deg]',
          zip(FREQUENCY_HZ, DECIBEL, DEGREES, strict=True), '\t'),
    table('% omega  re im', zip(OMEGA, RESPONSE.real, RESPONSE.imag, strict=True), ' '),
    table('# made by a lab\n# w (rad/s), Re(H), Im(H)',
          zip(OMEGA, RESPONSE.real, RESPONSE.imag, strict=True)),
    table('f (Hz);Re(H);Im(H)', PARTS, ';').replace('.', ','),
    table('! a comment\n# kHz S RI R 50',
          zip(FREQUENCY_HZ / 1e3, RESPONSE.real, RESPONSE.imag, strict=True), ' '),
    table('# Hz S DB R 50', [
        (hertz, 0, 0, level, phase, 0, 0, 0, 0)
        for hertz, level, phase in zip(FREQUENCY_HZ, DECIBEL, DEGREES, strict=True)], ' '),
    table('frequency_hz,magnitude,phase_rad', zip(
        FREQUENCY_HZ, np.abs(RESPONSE), np.angle(RESPONSE), strict=True)),
    table('frequency_khz,gain_nm_per_v,phase_deg,coherence', zip(
        FREQUENCY_HZ / 1e3, 1e3 * np.abs(RESPONSE), DEGREES, np.ones(30), strict=True)),
])
def test_tables_of_other_programs_are_read(tmp_path, text):
    (tmp_path / 'a.txt').write_text(text)
    found = read_response(tmp_path / 'a.txt', sample_period_s=1e-4)
    assert found.response == pytest.approx(RESPONSE, rel=1e-9)
    assert found.frequency_hz == pytest.approx(FREQUENCY_HZ, rel=1e-9)
    assert found.sample_period_s == 1e-4
    assert 'estimated by how smooth the response is' in found.notes[0]


def test_without_a_sample_period_the_response_is_turned_into_that_behind_a_hold(tmp_path):
    (tmp_path / 'a.csv').write_text(table('f_hz,re,im', PARTS))
    found = read_response(tmp_path / 'a.csv')
    pole = np.exp(-2.0 * np.pi * 200.0 * found.sample_period_s)
    z = np.exp(1j * OMEGA * found.sample_period_s)
    assert found.response == pytest.approx(0.97 * (1.0 - pole) / (z - pole), rel=1e-5)
    assert 'taken as that of the continuous stage' in found.notes[-1]


@pytest.mark.parametrize('relative', [1e-3, 1e-2])
def test_without_a_standard_error_it_is_estimated_by_how_smooth_the_response_is(
    tmp_path, relative,
):
    generator = np.random.default_rng(3)
    frequency_hz = np.geomspace(1.0, 1000.0, 200)
    smooth = 1.0 / (1.0 + 1j * frequency_hz / 200.0)
    noise = generator.normal(size=(2, 200))
    noisy = smooth * (1.0 + relative * (noise[0] + 1j * noise[1]))
    (tmp_path / 'a.csv').write_text(
        table('f_hz,re,im', zip(frequency_hz, noisy.real, noisy.imag, strict=True)))
    found = read_response(tmp_path / 'a.csv')
    assert np.median(found.standard_error / np.abs(found.response)) == pytest.approx(
        relative, rel=0.2)


def test_of_a_short_table_an_error_of_one_percent_is_assumed_and_told(tmp_path):
    (tmp_path / 'a.csv').write_text(table('f_hz,re,im', PARTS[:5]))
    found = read_response(tmp_path / 'a.csv', sample_period_s=1e-4)
    assert found.standard_error == pytest.approx(0.01 * np.abs(RESPONSE[:5]))
    assert '5 points are too few to estimate it: 1 % of the response is assumed' in found.notes[0]


def test_a_point_that_cannot_be_used_is_left_out_with_the_reason(tmp_path):
    (tmp_path / 'a.csv').write_text('f_hz,re,im\n0,1,0\n10,1,0\n20,nan,0\n30,,0\n900,1,0')
    found = read_response(tmp_path / 'a.csv', sample_period_s=1e-3)
    assert found.frequency_hz.tolist() == [10.0]
    assert [point.frequency_hz for point in found.excluded] == [0.0, 20.0, 30.0, 900.0]
    assert 'line 4 is not finite' in found.excluded[1].reason
    assert 'Nyquist frequency 500 Hz' in found.excluded[3].reason


@pytest.mark.parametrize(('text', 'words'), [
    ('f_hz,mag,phase_deg\n1,2,x', "line 2, column 'phase_deg': the value 'x' is no number"),
    ('f_hz,mag,phase\n1,2,3', 'may be degrees or radians; allowed names are phase_deg'),
    ('1,2,3', 'line 1: no header names the columns; allowed are frequency_hz'),
    ('f_hz,mag_db\n1,2', 'line 1: no column for the response among f_hz, mag_db; allowed are'),
    ('f_v,re,im\n1,2,3', "the column 'f_v' has the unit 'v', allowed for the frequency are"),
    ('f_hz,re,im\n1,2', 'line 2 has 2 values, the header has 3 columns'),
    ('', 'line 1: no header names the columns'),
    ('f_hz,re,im\n-1,2,3', 'line 2: the frequency is -1 Hz, it must be at least 0'),
    ('f_hz,mag,phase_deg\n1,-2,3', 'line 2: the magnitude is -2, it must be at least 0'),
    ('f_hz,re,im,stderr\n1,2,3,', 'the standard error at 1 Hz is missing'),
    ('f_hz,freq_hz,re,im\n1,1,2,3', 'the columns f_hz, freq_hz are all the frequency'),
])
def test_a_table_that_cannot_be_read_is_refused_by_line_column_and_value(tmp_path, text, words):
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(ValueError, match=re.escape(words)) as refused:
        read_response(tmp_path / 'a.csv')
    assert str(tmp_path / 'a.csv') in str(refused.value)


def test_a_model_is_identified_from_a_table_without_any_bag(tmp_path, capsys):
    (tmp_path / 'a.csv').write_text(table('f_hz,re,im', PARTS))
    command = ['identify', 'dynamics', '-o', str(tmp_path / 'm.yaml'), '--orders', '0', '1']
    assert main([*command, '--from-response', str(tmp_path / 'a.csv')]) == 0
    rate = float(capsys.readouterr().out.split('rate_1_rad_per_s')[1].split()[0])
    assert rate == pytest.approx(2.0 * np.pi * 200.0, rel=1e-4)
    assert main([*command, '--force']) == 2
    assert 'no BAG is given, and no --from-response FILE' in capsys.readouterr().err
