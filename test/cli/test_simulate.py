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

import json

import pytest

from piezo_ros.cli.main import main


def simulate(*arguments):
    return main(['simulate', *map(str, arguments)])


def usage_error(*arguments):
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    return end.value.code


@pytest.fixture
def output(tmp_path):
    return tmp_path / 'out'


def test_a_plan_is_simulated_and_reported(plan, output, capsys):
    assert simulate(plan, '-o', output) == 0
    out, err = capsys.readouterr()
    # Programs read the result from stdout; the progress goes to the terminal.
    assert f'report: {output / "report.html"}' in out
    assert 'NRMSE' in out
    assert '[1/2] ff: triangle' in err
    assert '[1/2]' not in out
    assert '\r' not in out + err
    assert [run['scheme'] for run in json.loads((output / 'report.json').read_text())['runs']] == [
        'ff', 'fbff']
    assert (output / 'bags' / '000_ff_triangle_1um_300hz').is_dir()


def test_the_same_command_again_needs_force(plan, output, capsys):
    assert simulate(plan, '-o', output) == 0
    before = (output / 'report.json').read_bytes()
    assert simulate(plan, '-o', output) == 2
    assert f'piezo: {output} exists; --force replaces it' in capsys.readouterr().err
    assert (output / 'report.json').read_bytes() == before
    (output / 'left.over').touch()
    assert simulate(plan, '-o', output, '--force') == 0
    assert not (output / 'left.over').exists()


def test_force_never_takes_what_is_no_earlier_output(plan, tmp_path, capsys):
    (tmp_path / 'thesis.tex').write_text('years of work')
    assert simulate(plan, '-o', tmp_path, '--force') == 2
    assert 'piezo: ' in capsys.readouterr().err
    assert (tmp_path / 'thesis.tex').read_text() == 'years of work'
    assert plan.exists()


def test_a_plan_within_the_output_does_not_delete_itself(plan, output, capsys):
    assert simulate(plan, '-o', output) == 0
    assert simulate(output / 'plan.yaml', '-o', output, '--force') == 2
    assert 'lies in the output directory' in capsys.readouterr().err
    assert (output / 'plan.yaml').read_bytes() == plan.read_bytes()
    assert (output / 'report.html').exists()


@pytest.mark.parametrize('text', [
    'runs: [{}]', 'format_version: 1\nruns: [{amplitude_um: .nan}]',
    'format_version: 1\nruns: [{amplitude_um: 7.0}]', 'a: ['])
def test_a_plan_that_cannot_be_run_is_a_matter_of_usage(plan, output, text, capsys):
    plan.write_text(text)
    assert simulate(plan, '-o', output) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith(f'piezo: {plan}')
    assert 'Traceback' not in err
    assert not output.exists()


def test_a_missing_plan_is_a_matter_of_usage(tmp_path, output, capsys):
    assert simulate(tmp_path / 'none.yaml', '-o', output) == 2
    assert 'none.yaml: No such file or directory' in capsys.readouterr().err


def test_an_output_that_cannot_be_written_fails_in_words(plan, tmp_path, capsys):
    (tmp_path / 'file').touch()
    assert simulate(plan, '-o', tmp_path / 'file' / 'out') == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith('piezo: ')
    assert 'Not a directory' in err


def test_a_run_too_long_for_the_memory_fails_in_words(plan, output, capsys):
    # More bytes than any address space has.
    plan.write_text(
        'format_version: 1\nruns: [{scheme: ff, periods: 1e9, frequency_hz: 0.0125}]')
    assert simulate(plan, '-o', output) == 1
    assert 'piezo: Unable to allocate' in capsys.readouterr().err


@pytest.mark.parametrize('arguments', [
    [], ['simulate'], ['simulate', 'plan.yaml'], ['simulate', '-o', 'out'], ['simulat'],
    ['simulate', 'plan.yaml', '-o', 'out', '--forced'],
    ['run', 'plan.yaml', '-o', 'out', '--separate', '--composed']])
def test_wrong_usage_is_told_on_standard_error(arguments, capsys):
    assert usage_error(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert 'usage: piezo' in err


@pytest.mark.parametrize('command', [[], ['run'], ['simulate']])
def test_help_is_given_and_commands_show_examples(command, capsys):
    assert usage_error(*command, '--help') == 0
    out, err = capsys.readouterr()
    assert err == ''
    assert 'usage: piezo' in out
    if command:
        assert f'piezo {command[0]} config/experiments/demo.yaml -o ' in out
        assert '--force' in out
