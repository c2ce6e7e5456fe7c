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
"""``piezo image`` of two recorded axes, also in one foreign bag, and ``piezo report`` of scans."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.writer import Writer

from piezo_ros.bag import BagWriter
from piezo_ros.cli.main import main
from piezo_ros.report.page import raster_report
from piezo_ros.streams import BlockCodec
from piezo_ros.streams.message_type import DEFINITION, TYPE_NAME

LINES, SAMPLES = 10, 200
NAMES = ('x', 'y')
SCALES = {'x': 0.97, 'y': 1.0}


@pytest.fixture(autouse=True)
def no_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        raster_report, 'write_page', lambda directory, **content: directory / 'report.html')


def motions(lines=LINES):
    turns = np.arange((lines + 1) * SAMPLES) / SAMPLES
    return (
        2.0 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns)), 3.2 * (turns / lines - 0.5))


def write(path, reference_um, scale=1.0, period_s=1e-4, start=0):
    """Write a bag as a recorder of others would: reference and displacement alone."""
    topics = {stream: f'/{path}/{stream}' for stream in ('reference', 'displacement')}
    with BagWriter(path, topics=topics, metadata={}) as writer:
        for stream, values in (
                ('reference', reference_um), ('displacement', scale * reference_um)):
            writer.write_block(stream, start, period_s, values)
            writer.write_block(stream, start + values.size, period_s, [])


def write_both(path):
    """Write both rigs into one file, as `ros2 bag record` does: wall-clock times, no record."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'libmcap')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        for name, reference_um in zip(NAMES, motions(), strict=True):
            for stream, scale in (('reference', 1.0), ('displacement', SCALES[name])):
                channel = writer.register_channel(f'/{name}/{stream}', 'cdr', schema)
                raw = BlockCodec(stream).encode(0, 1e-4, scale * reference_um)
                writer.add_message(channel, 10**18, raw, 10**18)
        writer.finish()


@pytest.fixture
def bags():
    for name, reference_um in zip(NAMES, motions(), strict=True):
        write(name, reference_um, scale=SCALES[name])
    return NAMES


def test_two_bags_make_an_image(bags, capsys, tmp_path):
    assert main(['image', *bags, '-o', 'out', '--pixels', '32']) == 0
    told = capsys.readouterr().out
    assert '10 lines, samples' in told
    assert '-3.000' in told  # the scale error
    assert (tmp_path / 'out' / 'images' / 'image_trace.tiff').is_file()
    assert main(['image', *bags, '-o', 'out']) == 2
    assert 'out exists' in capsys.readouterr().err
    assert main(['image', *bags, '-o', 'out', '--force']) == 0


@pytest.mark.parametrize(('arguments', 'code', 'problem'), [
    (['y', 'x'], 1, 'goes to and fro on each line'),
    (['x'], 2, 'one bag holds both axes only if --namespaces tells them apart'),
    (['x', 'none'], 1, 'none'),
    (['x', 'y', '--namespaces', '/a', '/b'], 1, '/a'),
])
def test_what_makes_no_image_is_said_in_a_line(bags, arguments, code, problem, capsys):
    assert main(['image', *arguments, '-o', 'out']) == code
    error = capsys.readouterr().err
    assert problem in error
    assert len(error.splitlines()) == 1


def test_one_bag_may_hold_both_rigs(bags, capsys):
    write_both(Path('both.mcap'))
    assert main([
        'image', 'both.mcap', '--namespaces', '/x', '/y', '-o', 'out', '--pixels', '32']) == 0
    assert '-3.000' in capsys.readouterr().out


def test_axes_of_unlike_sample_period_are_refused(bags, capsys):
    write('z', motions()[1], period_s=2e-4)
    assert main(['image', 'x', 'z', '-o', 'out']) == 1
    assert 'the axes were not in lockstep' in capsys.readouterr().err


@pytest.mark.parametrize('shift', [0, 37])
def test_axes_are_paired_by_index(bags, capsys, shift):
    """The slow axis was recorded later."""
    write('late', motions()[1][shift:], start=shift)
    assert main(['image', 'x', 'late', '-o', 'out', '--pixels', '32']) == 0
    assert '-3.000' in capsys.readouterr().out


def test_scans_of_a_plan_are_reported_again(capsys):
    plan = {
        'format_version': 1, 'scan_defaults': {'lines': 4, 'pixels': 16},
        'scans': [{'fast': {'amplitude_um': 1.0, 'frequency_hz': 1000.0, 'scheme': 'ff'}}]}
    with open('plan.yaml', 'w') as file:
        yaml.safe_dump(plan, file)
    assert main(['simulate', 'plan.yaml', '-o', 'out']) == 0
    first = capsys.readouterr().out
    assert main(['report', 'out', '-o', 'again']) == 0
    assert capsys.readouterr().out == first.replace('out/report', 'again/report')
    assert main(['report', 'out', 'out/bags/000_waveform_2um_1000hz/fast', '-o', 'no']) == 2
    assert 'has no raster scans' in capsys.readouterr().err
    assert main(['check', 'plan.yaml']) == 0
    assert '2 runs, 0 beyond' in capsys.readouterr().out
