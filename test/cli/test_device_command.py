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

"""``piezo device``, ``piezo check device``, and what ``piezo run`` asks before it drives."""

import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from paced_device import PacedDevice
from python_path import python_path

from piezo_ros.cli.main import main
from piezo_ros.cli.shared.drive_question import ask_to_drive
from piezo_ros.parameters.errors import PlanError

ROOT = Path(__file__).resolve().parents[2]
STAGE = """
/**/plant:
  ros__parameters: {{device: {device}, noise_rms_um: 0.001{more}}}
"""


@pytest.fixture
def stage(tmp_path):
    def write(device='simulated', more=''):
        path = tmp_path / 'stage.yaml'
        path.write_text(STAGE.format(device=device, more=more))
        return str(path)

    return write


def test_the_devices_are_listed(capsys):
    assert main(['device', 'list']) == 0
    out = capsys.readouterr().out
    assert 'simulated, ni, gcs' in out
    assert 'ni at the local driver' in out


def test_a_server_that_is_not_there_is_named(capsys):
    assert main(['device', 'list', '--address', '127.0.0.1:9']) == 1
    assert '127.0.0.1:9' in capsys.readouterr().out


def test_a_loopback_through_a_stage_is_refused(stage, capsys):
    assert main(['device', 'loopback', stage()]) == 1
    out, err = capsys.readouterr()
    assert re.search(r'^delay +\d+ samples$', out, re.MULTILINE)
    assert 'it must be' in err or 'hardly follow' in err


def test_two_points_give_the_scale_and_offset_of_the_sensor(stage, capsys):
    assert main([
        'device', 'calibrate', stage(), '--at-v', '3', '7', '--um', '4.1', '7.7',
        '--sample-period-s', '1e-4']) == 0
    out, err = capsys.readouterr()
    values = dict(re.findall(r'^(sensor_\w+): (\S+)$', out, re.MULTILINE))
    readings_v = [float(text) for text in re.findall(r'sensor (\S+) V', err)]
    scale = float(values['sensor_scale_um_per_v'])
    assert scale * (readings_v[1] - readings_v[0]) == pytest.approx(3.6, rel=1e-4)
    # 6 um, the operating point, is at zero deviation.
    assert scale * (readings_v[0] - float(values['sensor_offset_v'])) == pytest.approx(
        4.1 - 6.0, abs=1e-4)


@pytest.mark.parametrize(('words', 'code', 'said'), [
    (['--at-v', '5', '5', '--um', '4', '8'], 2, '--at-v is 5.0 V twice, two different points are'),
    (['--at-v', '5', '5.00001', '--um', '4', '8'], 1, 'differ by less than 20 times the noise'),
    (['--at-v', '3', '12', '--um', '4', '8'], 2, '--at-v is 12.0 V, allowed is -2 … 10 V'),
    (['--at-v', '3', '7', '--um', '4', '4'], 2, 'two different points are needed'),
    (['--at-v', '3', '7'], 2, 'give --um LOW HIGH'),
])
def test_a_calibration_that_tells_nothing_is_refused(stage, capsys, words, code, said):
    assert main(['device', 'calibrate', stage(), '--sample-period-s', '1e-3', *words]) == code
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(('words', 'said'), [
    (['--at-v', '0.5', '12', '--um', '4', '8'], '--at-v is 12.0 V, allowed is -2 … 10 V'),
    (['--at-v', '0.5', '9.5', '--um', '4', '4'], '--um is 4 um twice'),
    (['--at-v', '0.5', '9.5'], 'give --um LOW HIGH'),
])
def test_a_calibration_is_refused_before_it_drives(paced, capsys, words, said):
    given, log = paced
    given = [*given[:3], *words, *given[6:]]
    assert main(given) == 2
    assert said in capsys.readouterr().err
    assert not log.exists()


@pytest.mark.parametrize(('words', 'said'), [
    (['--um', 'nan', '8'], "--um is 'nan', allowed is a number, -1e+06 … 1e+06 um"),
    (['--um', '4', '8', '--slew-v-per-s', '0'], '--slew-v-per-s is 0, allowed is a number above 0'),
])
def test_numbers_of_a_calibration_are_checked_before_the_device_is_opened(
        stage, capsys, words, said):
    with pytest.raises(SystemExit, match='^2$'):
        main(['device', 'calibrate', stage(), '--at-v', '3', '7', *words])
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(('device', 'said'), [
    ('os:path', 'path is a module, no class'),
    ('os:getcwd', 'which cannot be made of the parameters: TypeError'),
    ('builtins:dict', 'which is no device: it has no constraints, open, hold'),
    ('no_such_module:Stage', "No module named 'no_such_module'"),
    ('os:Stage', "has no attribute 'Stage'"),
])
@pytest.mark.parametrize('command', [
    ['check', 'device', '--yes', '--parameters'], ['device', 'loopback', '--yes']])
def test_a_name_that_is_no_device_is_refused(stage, capsys, command, device, said):
    assert main([*command, stage(f"'{device}'")]) == 1
    told = capsys.readouterr().err
    assert f'device is {device}' in told
    assert said in told


@pytest.mark.parametrize('words', [
    ['--amplitude', '0'], ['--amplitude', '-1'], ['--amplitude', 'nan'],
    ['--sample-period-s', '0'], ['--sample-period-s', 'inf'], ['--discovery-s', 'nan']])
def test_a_check_with_a_number_that_is_none_is_a_usage_error(stage, capsys, words):
    with pytest.raises(SystemExit, match='^2$'):
        main(['check', 'device', '--parameters', stage(), *words])
    assert f'{words[0]} is ' in capsys.readouterr().err


@pytest.mark.parametrize(('device', 'more', 'said'), [
    ('simulated', ', no_such: 1', "unknown parameter 'no_such'"),
    ('oscilloscope', '', "device is 'oscilloscope'"),
    ('ni', '', 'give --yes, there is no terminal to ask on'),
])
def test_a_file_that_is_wrong_or_a_real_output_is_not_driven(stage, capsys, device, more, said):
    assert main(['device', 'loopback', stage(device, more)]) == 2
    assert said in capsys.readouterr().err


@pytest.fixture
def paced(stage, tmp_path):
    """Return the words of a calibration of a device that logs its output, and the log."""
    log = tmp_path / 'output.f64'
    return [
        'device', 'calibrate', '--yes', '--at-v', '0.5', '9.5', '--sample-period-s', '1e-3', stage(
            'paced_device:PacedDevice', f", address: '{log}', output_channel: 'held 3.0'")], log


def assert_at_rest(log):
    output_v = np.fromfile(log)
    assert output_v[-1] == 0.0
    assert np.abs(np.diff(output_v)).max() <= 0.1 * (1.0 + 1e-9)  # 100 V/s
    return output_v


def test_a_manager_that_ends_it_at_its_question_leaves_the_output_at_rest(paced):
    words, log = paced
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_ros.cli.main', *words], stdin=theirs, stderr=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': python_path(ROOT, ROOT / 'test' / 'support')})
    os.close(theirs)
    os.write(ours, b'0.61\n')
    said = b''
    while b'at 9.5 V [um]: ' not in said and (more := os.read(process.stderr.fileno(), 4096)):
        said += more
    process.terminate()
    said += process.communicate()[1]
    os.close(ours)
    assert process.returncode == 1, said
    assert b'piezo: stopped by SIGTERM' in said
    assert assert_at_rest(log).max() == 4.5


@pytest.fixture
def interrupted(monkeypatch):
    """Return what does a command of a paced device that Ctrl-C comes to, in some calls of it."""
    def do(words, method, at):
        def call(device, *arguments):
            calls.append(arguments)
            if len(calls) in at:
                os.kill(os.getpid(), signal.SIGINT)
                for _ in range(1000):
                    pass  # the handler runs between two of these
            return called(device, *arguments)

        calls, called = [], getattr(PacedDevice, method)
        monkeypatch.setattr(PacedDevice, method, call)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return main(words)
        finally:
            signal.signal(signal.SIGINT, before)

    return do


@pytest.mark.parametrize('ramps', [(1,), (3, 4), (4,)])
def test_ctrl_c_cuts_no_ramp_to_rest_off(paced, ramps, interrupted, capsys):
    assert interrupted([*paced[0], '--um', '1', '2'], 'ramp_to', ramps) == 1
    assert 'stopped by SIGINT' in capsys.readouterr().err
    assert_at_rest(paced[1])
    assert PacedDevice.devices[-1].is_closed


CHECK = ['check', 'device', '--yes', '--amplitude', '1.0', '--parameters']


@pytest.mark.parametrize(('method', 'at'), [
    ('open', (2,)), ('hold', (3,)), ('play', (9,)), ('read', (2,)), ('ramp_to', (2, 3)),
    ('ramp_to', (3, 4)), ('close', (1,))])
def test_ctrl_c_ends_a_check_with_the_output_at_rest(paced, method, at, interrupted, capsys):
    words, log = paced
    assert interrupted([*CHECK, words[-1]], method, at) == 1
    out, err = capsys.readouterr()
    assert 'stopped by SIGINT' in err
    assert 'checks' not in out
    assert np.fromfile(log)[-1] == 0.0
    assert PacedDevice.devices[-1].is_closed


def test_a_device_is_checked(stage, capsys):
    assert main(['check', 'device', '--parameters', stage(), '--amplitude', '1.0']) == 0
    assert ' 0 wrong' in capsys.readouterr().out


def test_a_check_beyond_the_rails_is_refused(stage, capsys):
    assert main(['check', 'device', '--parameters', stage(), '--amplitude', '5.1']) == 2
    out, err = capsys.readouterr()
    assert '--amplitude is 5.1 V, it must be above 0, and the rails allow 5 V' in err
    assert not out


def test_a_check_without_a_file_says_what_is_missing(capsys):
    assert main(['check', 'device']) == 2
    assert '--parameters' in capsys.readouterr().err


@pytest.mark.parametrize(('answer', 'is_driven'), [('y\n', True), ('YES\n', True), ('n\n', False),
                                                   ('\n', False), ('sure\n', False)])
def test_the_question_wants_a_yes(monkeypatch, answer, is_driven):
    ours, theirs = pty.openpty()
    os.write(ours, answer.encode())
    with open(theirs, encoding='utf-8') as terminal:
        monkeypatch.setattr('sys.stdin', terminal)
        if is_driven:
            ask_to_drive('2 runs on ni')
        else:
            with pytest.raises(PlanError, match='not driven'):
                ask_to_drive('2 runs on ni')
    os.close(ours)


def plan(tmp_path, device, **more):
    path = tmp_path / 'plan.yaml'
    words = ''.join(f', {name}: {value}' for name, value in more.items())
    path.write_text(f"""
format_version: 1
score_periods: 1
runs:
  - {{scheme: ff, periods: 2, ramp_periods: 1, plant: {{device: {device}{words}}}}}
""")
    return str(path)


@pytest.mark.parametrize(('device', 'more', 'options', 'said'), [
    pytest.param('ni', {}, [], 'give --yes', marks=pytest.mark.slow),
    ('simulated', {'slew_limit_v_per_s': 2000}, ['--yes'], '2 V/ms allowed'),
    pytest.param('simulated', {}, ['--composed'], 'leave --composed and --keep out',
                 marks=pytest.mark.slow),
])
def test_a_run_that_must_not_start_leaves_no_directory(
        tmp_path, capsys, device, more, options, said):
    pytest.importorskip('rclpy')
    path, out = plan(tmp_path, device, **more), tmp_path / 'out'
    assert main(['run', path, '-o', str(out), *options]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_simulate_stands_in_for_a_simulated_device_and_refuses_a_real_one(tmp_path, capsys):
    assert main(['simulate', plan(tmp_path, 'simulated'), '-o', str(tmp_path / 'a')]) == 0
    assert main(['simulate', plan(tmp_path, 'ni'), '-o', str(tmp_path / 'b')]) == 2
    assert 'no section for compensator, trajectory' in capsys.readouterr().err


def test_check_of_a_plan_prints_what_a_device_is_asked_for(tmp_path, capsys):
    assert main(['check', plan(tmp_path, 'simulated', load_capacitance_f=0.44e-6)]) == 0
    out = capsys.readouterr().out
    for words in ('rate 100000 Hz', 'first step', 'peak current', 'memory', '0 beyond'):
        assert words in out
