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

"""
Mistakes that people type: what they are told, and the exit code.

Each message names the file and line, or the option; the value; what is allowed; and what was
probably meant, where a word is near.
"""

from pathlib import Path

import pytest

from piezo_ros.cli.main import main
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan

ROOT = Path(__file__).parents[2]
PARAMETERS = 'parameter_files: [rig.yaml]\n'
RIG = """\
/**/plant:
  ros__parameters:
    slew_limit_v_per_s: 18200.0
    noise_rms_um: 0.001
"""
RUN = 'runs:\n  - scheme: fb\n    {}\n'


def plan(run='', head=PARAMETERS):
    return f'format_version: 1\n{head}{RUN.format(run)}'


# What is in plan.yaml, what is said of it. It is always exit 2, and nothing is written.
PLANS = [
    pytest.param(text, fragments, id=fragments[-1])
    for text, fragments in [
        (plan('amplitud_um: 1.0'), [
            "plan.yaml:5: run 1: unknown key 'amplitud_um'; allowed are scheme, waveform,",
            "did you mean 'amplitude_um'?"]),
        (plan('Frequency_Hz: 1.0'), ['plan.yaml:5: ', "did you mean 'frequency_hz'?"]),
        (plan('trajectroy: {}'), ['plan.yaml:5: ', "did you mean 'trajectory'?"]),
        (plan('trajectory: {frequncy_hz: 1.0}'), [
            "plan.yaml:5: run 1: trajectory: unknown parameter 'frequncy_hz' of trajectory",
            "did you mean 'frequency_hz'?"]),
        (plan('controller:\n      integral_gain: 1.0'), [
            "plan.yaml:6: run 1: controller: unknown parameter 'integral_gain'",
            "did you mean 'integral_gain_per_s'?"]),
        (plan('waveform: triangel'), [
            "plan.yaml:5: run 1: trajectory: waveform is 'triangel', allowed are triangle, sine",
            "did you mean 'triangle'?"]),
        (plan().replace('scheme: fb', 'scheme: fbf'), [
            "plan.yaml:4: run 1: controller: scheme is 'fbf', allowed are fb, ff, fbff",
            "did you mean 'fb"]),
        (plan('amplitude_um: -1.0'), [
            'plan.yaml:5: ', 'amplitude_um is -1.0 um, allowed is 0 … 10000 um']),
        (plan('amplitude_um: 7.0'), [
            'plan.yaml:5: run 1: amplitude_um is 7.0 um', 'the stage travels 6 um']),
        (plan('amplitude_um: 5.5\n    offset_um: 1.0'), [
            'plan.yaml:5: ', 'travels 6 um', 'beside the offset of 1 um that leaves 5 um']),
        (plan('amplitude_um: one'), [
            'plan.yaml:5: ', "amplitude_um is 'one', it must be a number"]),
        (plan('amplitude_um: 1,5'), [
            'plan.yaml:5: ', "amplitude_um is '1,5', it must be a number"]),
        (plan('amplitude_um: .nan'), ['plan.yaml:5: ', 'amplitude_um is nan um, allowed is 0 …']),
        (plan('frequency_hz: 60000'), [
            'plan.yaml:5: ', 'frequency_hz is 60000.0 Hz', 'below the Nyquist frequency 50000 Hz']),
        (plan('frequency_hz: 0'), ['plan.yaml:5: ', 'frequency_hz is 0.0 Hz, allowed is 1e-06 …']),
        (plan('harmonics: 9.5'), ['plan.yaml:5: ', 'harmonics is 9.5, it must be an integer']),
        (plan('harmonics: yes'), ['plan.yaml:5: ', 'harmonics is True, it must be an integer']),
        (plan('frequency_hz: []'), ['frequency_hz is an empty list, it must have at least one']),
        (plan('periods: 2'), ['score_periods is 4, allowed is 0 … 2']),
        (plan('waveform: file'), ['plan.yaml:5: ', "file is '' and waveform 'file'"]),
        (plan('waveform: file\n    file: none.csv'), ['plan.yaml:', 'none.csv: No such file']),
        (plan('turn_fraction: 2.0'), ['plan.yaml:5: ', 'turn_fraction is 2.0, allowed is 0 … 1']),
        (plan('output: voltage\n    amplitude_v: 9.0'), [
            'plan.yaml:', 'amplitude_v is 9.0 V', 'the rails are 5 V from the operating point']),
        (plan('changes: [{at_sample: 99999, scheme: ff}]'), [
            'plan.yaml:5: ', 'at_sample is 99999, the run has 5000 samples']),
        (plan('plant: {sample_period_s: 1.0e-4}'), [
            'plan.yaml:', 'sample_period_s differs between the nodes']),
        (plan('controller: 3'), ['plan.yaml:5: ', 'controller is 3, it must be a mapping']),
        (plan('amplitude_um: 1.0\n    amplitude_um: 2.0'), [
            "plan.yaml is no YAML: the key 'amplitude_um' is in line 5 and in line 6"]),
        (plan('amplitude_um: [1.0'), ['plan.yaml is no YAML: line ']),
        (plan('\tamplitude_um: 1.0'), ['plan.yaml is no YAML: line 5, column ']),
        ('[1, 2]\n', ['plan.yaml is no plan: the top level must be a mapping']),
        ('', ['plan.yaml is no plan: the top level must be a mapping']),
        (plan().replace('format_version: 1', 'format_version: 2'), [
            'format_version is 2, only 1 is known']),
        (plan().replace('format_version: 1\n', ''), ['format_version is None, only 1 is known']),
        (plan(head=f'titel: x\n{PARAMETERS}'), [
            "plan.yaml:2: unknown key 'titel'; allowed are format_version, title",
            "did you mean 'title'?"]),
        (plan(head='parameter_files: [rigg.yaml]\n'), ['rigg.yaml: No such file or directory']),
        (plan(head='parameter_files: rig.yaml\n'), [
            "parameter_files is 'rig.yaml', it must be a list"]),
        (plan(head=f'sample_period_s: fast\n{PARAMETERS}'), [
            "sample_period_s is 'fast', it must be a number"]),
        (plan(head=f'score_periods: many\n{PARAMETERS}'), [
            "score_periods is 'many', it must be a number"]),
        (plan(head=f'study: papr\n{PARAMETERS}'), ["study is 'papr', allowed are paper, beyond"]),
        (f'format_version: 1\n{PARAMETERS}', ['runs is None, it must be a list']),
        (f'format_version: 1\n{PARAMETERS}runs: []\n', ['runs is empty']),
        (f'format_version: 1\n{PARAMETERS}runs: [fb]\n', ["run 1 is 'fb', it must be a mapping"]),
        ('format_version: 1\nscans:\n  - lins: 3\n', [
            "plan.yaml:3: scan 1: unknown key 'lins'", "did you mean 'lines'?"]),
        ('format_version: 1\nscans:\n  - fast:\n      motoin: learned\n', [
            "plan.yaml:4: scan 1: fast: unknown key 'motoin'", "did you mean 'motion'?"]),
        (plan(head=f'sweep: {{draw: 3}}\n{PARAMETERS}'), ['is a sweep; piezo sweep does it']),
    ]]

# What is in rig.yaml, what is said of it.
RIGS = [
    ('slew_limit_v_per_s: 18200.0', 'slew_limit_v_per_ms: 18.2', [
        "rig.yaml:3: plant: unknown parameter 'slew_limit_v_per_ms' of plant",
        "did you mean 'slew_limit_v_per_s'?"]),
    ('noise_rms_um: 0.001', 'noise_rms_um: -1.0', [
        'rig.yaml:4: plant: noise_rms_um is -1.0 um, allowed is 0 … 1000 um']),
    ('ros__parameters', 'ros_parameters', [
        "rig.yaml:1: '/**/plant' has no mapping ros__parameters"]),
    ('noise_rms_um: 0.001', 'noise_rms_um: 0.001\n    noise_rms_um: 0.002', [
        "rig.yaml is no YAML: the key 'noise_rms_um' is in line 4 and in line 5"]),
    ('noise_rms_um: 0.001', 'order: lumpd', [
        "rig.yaml:4: plant: order is 'lumpd', allowed are physical, lumped",
        "did you mean 'lumped'?"]),
]

# The words of a command line, the exit code, what is said.
COMMANDS = [
    ('simulat plan.yaml -o out', 2, ["invalid choice: 'simulat'", "did you mean 'simulate'?"]),
    ('simulate plan.yaml', 2, ['required: -o/--output']),
    ('simulate plan.yaml -o out --forse', 2, [
        'unrecognized arguments: --forse', "did you mean '--force'?"]),
    ('simulate no.yaml -o out', 2, ['no.yaml: No such file or directory']),
    ('simulate . -o out', 2, ['.: Is a directory']),
    ('simulate plan.yaml -o rig.yaml', 2, ['rig.yaml exists; --force replaces it']),
    ('simulate plan.yaml -o there --force', 2, ['there exists and is no earlier output']),
    ('simulate plan.yaml -o .', 2, ['lies in the output directory .']),
    ('sweep plan.yaml -o out --workers 0', 2, ['--workers is 0, allowed is a whole number, 1 …']),
    ('image bag bag -o out --pixels 1', 2, ['--pixels is 1, allowed is a whole number, 2 …']),
    ('image bag bag -o out --central 2', 2, ['--central is 2, allowed is a number above 0']),
    ('learn scan.yaml -o out --runs 0', 2, ['--runs is 0, allowed is a whole number, 1 …']),
    ('replay bag --ki -5', 2, ['--ki is -5, allowed is a number, 0 …']),
    ('sweep plan.yaml -o out', 2, ['plan.yaml has no key sweep']),
    ('bag inf bag', 2, ["invalid choice: 'inf'", "did you mean 'info'?"]),
    ('bag info no_bag', 1, ['there is no bag no_bag']),
    ('bag info bag --run first', 2, [
        "--run is 'first', allowed is a whole number, 1 … 1000000"]),
    ('bag info bag --namespace /other', 1, [
        'no stream in the namespace /other, choices are /']),
    ('bag export bag -o there', 2, ["-o there ends in 'no suffix', allowed are .csv, .mat,"]),
    ('bag export bag -o scan.xlsx', 2, ["-o scan.xlsx ends in '.xlsx', allowed are .csv, .mat,"]),
    ('bag motion bag -o there', 2, ['-o there is a directory, it must be a file']),
    ('bag import no.csv -o new', 1, ['no.csv: No such file or directory']),
    ('init slow_stag', 2, ["no example 'slow_stag'; there are ", "did you mean 'slow_stage'?"]),
    ('simulate demmo -o out', 2, ["'demmo' is no file and no plan", "did you mean 'demo'?"]),
    ('bag export bag -o old.csv', 2, ['old.csv exists; --force replaces it']),
    ('bag export bag -o rig.yaml/x.csv', 2, ['-o rig.yaml/x.csv: ', 'rig.yaml is no directory']),
    ('bag motion bag -o x.csv', 2, ["-o x.csv: a motion is written as .npz, not '.csv'"]),
    ('bag motion bag -o x.npz --reference displacment', 2, [
        "argument --reference: invalid choice: 'displacment'", "did you mean 'displacement'?"]),
    ('bag motion bag -o x.npz --from-s 9', 1, ['has no sample from --from-s 9']),
    ('report no_bag -o out', 1, ['there is no bag no_bag']),
    ('report bag -o out --periods 99', 1, ['99 periods of 300 Hz are', '1 to 500 can be taken']),
    ('report bag -o there --periods 1', 2, ['there exists; --force replaces it']),
    ('calibrate -o rig.yaml', 2, ['rig.yaml exists; --force replaces it']),
    ('calibrate -o new.yaml --generations 0', 2, [
        '--generations is 0, allowed is a whole number, 1 … 100000']),
    ('calibrate -o rig.yaml/x.yaml', 2, ['rig.yaml is no directory']),
]

# These import the mathematics of the identification.
SLOW_COMMANDS = [
    ('tune no.yaml -o out.yaml', 2, ['no.yaml: No such file or directory']),
    ('tune rig.yaml -o out.yaml', 2, ['rig.yaml has no section for trajectory']),
    ('tune trajectory.yaml -o rig.yaml', 2, ['rig.yaml exists; --force replaces it']),
    ('tune trajectory.yaml -o rig.yaml/x.yaml', 2, ['rig.yaml is no directory']),
    ('tune trajectory.yaml -o out.yaml --max-sensitivity 0.5', 2, [
        '--max-sensitivity is 0.5, allowed is a number above 1']),
    ('tune trajectory.yaml -o out.yaml --sample-period-s 0', 2, [
        '--sample-period-s is 0, allowed is a number, 1e-09 … 1000 s']),
    ('tune trajectory.yaml -o out.yaml --measurement-delay-samples -1', 2, [
        '--measurement-delay-samples is -1, allowed is a whole number, 0 … 1000']),
    ('tune trajectory.yaml -o out.yaml --harmonics many', 2, [
        "--harmonics is 'many', allowed is a whole number, 1 … 1000, or 'auto'"]),
    ('tune trajectory.yaml -o out.yaml --amplitudes-um 7', 2, [
        '--amplitudes-um has 7, allowed is above 0 … 6 um']),
    ('tune trajectory.yaml -o out.yaml --frequencies-hz 60000', 2, [
        '--frequencies-hz has 60000, allowed is above 0 and below 50000 Hz']),
    ('tune trajectory.yaml -o out.yaml --frequencies-hz 1e-6', 2, [
        '--frequencies-hz has 1e-06, of which a period has 1e+11 samples, allowed are 500000']),
    ('tune trajectory.yaml -o out.yaml --waveform triangel', 2, ["did you mean 'triangle'?"]),
    ('tune trajectory.yaml -o out.yaml --amplitude-um 1', 2, ["did you mean '--amplitudes-um'?"]),
    ('tune trajectory.yaml -o out.yaml --bound rig.yaml', 2, ['rig.yaml is no uncertainty_bound']),
    ('replay bag --controller rig.yaml', 2, ['rig.yaml has no section for controller']),
    ('replay bag --controller no.yaml', 2, ['no.yaml: No such file or directory']),
    ('replay no_bag', 1, ['there is no bag no_bag']),
    ('replay bag --scheme pid', 2, ["argument --scheme: invalid choice: 'pid'"]),
    ('identify hysteresi bag -o m.yaml', 2, ["did you mean 'hysteresis'?"]),
    ('identify hysteresis bag -o m.yaml --elements 0', 2, [
        '--elements is 0, allowed is a whole number, 1 … 160']),
    ('identify hysteresis bag -o m.yaml --elements many', 2, [
        "--elements is 'many', allowed is a whole number, 1 … 160, or 'auto'"]),
    ('identify hysteresis bag -o rig.yaml/m.yaml', 2, ['rig.yaml is no directory']),
    ('identify hysteresis bag -o there', 2, ['-o there is a directory, it must be a file']),
    ('identify hysteresis no_bag -o m.yaml', 1, ['there is no bag no_bag']),
    ('identify hysteresis bag -o m.yaml --from-s 7', 1, ['no sample from --from-s 7']),
    ('identify dynamics -o m.yaml', 2, ['no BAG is given, and no --from-response FILE']),
    ('identify dynamics bag -o m.yaml --structure rational', 2, ['needs --orders NUM DEN']),
    ('identify dynamics bag -o m.yaml --fit-delay', 2, ['--fit-delay belongs to --orders']),
    ((
        'plan rig.yaml --compensator compensator.yaml --plant rig.yaml --amplitude-um 1 '
        '--frequency-hz 300 -o scan.yaml'), 2, ['rig.yaml has no section for trajectory']),
    ('plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml -o scan.yaml', 2, [
        'either --amplitude-um and --frequency-hz, or --motion']),
]


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Simulate a short run."""
    directory = tmp_path_factory.mktemp('recorded')
    (directory / 'plan.yaml').write_text(
        'format_version: 1\nscore_periods: 1\nruns: [{scheme: fb, periods: 1.5}]\n')
    simulate_run(read_plan(directory / 'plan.yaml').runs[0], directory / 'bag')
    return directory / 'bag'


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Lay what people have on their table, and work there."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'plan.yaml').write_text(plan())
    (tmp_path / 'rig.yaml').write_text(RIG)
    (tmp_path / 'old.csv').touch()
    (tmp_path / 'there').mkdir()
    (tmp_path / 'there' / 'thesis.tex').write_text('years of work')
    for name in ('compensator', 'trajectory'):
        (tmp_path / f'{name}.yaml').symlink_to(ROOT / 'config' / f'{name}.yaml')
    return tmp_path


@pytest.fixture
def told(capsys):
    def run(words):
        try:
            code = main(words)
        except SystemExit as ended:
            code = ended.code
        captured = capsys.readouterr()
        assert 'Traceback' not in captured.err
        return code, captured.err
    return run


def check(told, words, code, fragments):
    found, err = told(words)
    for fragment in fragments:
        assert fragment in err
    assert found == code
    assert err.splitlines()[-1].startswith('piezo')


def test_there_are_more_than_sixty():
    assert len(PLANS) + len(RIGS) + len(COMMANDS) > 60


@pytest.mark.parametrize(('text', 'fragments'), PLANS)
def test_mistakes_in_a_plan(table, told, text, fragments):
    (table / 'plan.yaml').write_text(text)
    check(told, ['simulate', 'plan.yaml', '-o', 'out'], 2, fragments)
    assert not (table / 'out').exists()


@pytest.mark.parametrize(('right', 'wrong', 'fragments'), RIGS)
def test_mistakes_in_a_parameter_file(table, told, right, wrong, fragments):
    assert right in RIG
    (table / 'rig.yaml').write_text(RIG.replace(right, wrong))
    check(told, ['simulate', 'plan.yaml', '-o', 'out'], 2, fragments)
    assert not (table / 'out').exists()


def check_command(recorded, table, told, words, code, fragments):
    (table / 'bag').symlink_to(recorded)
    before = sorted(path.name for path in table.iterdir())
    check(told, words.split(), code, fragments)
    assert sorted(path.name for path in table.iterdir()) == before
    assert (table / 'rig.yaml').read_text() == RIG


@pytest.mark.parametrize(('words', 'code', 'fragments'), COMMANDS)
def test_mistakes_on_the_command_line(recorded, table, told, words, code, fragments):
    check_command(recorded, table, told, words, code, fragments)


@pytest.mark.slow
@pytest.mark.parametrize(('words', 'code', 'fragments'), SLOW_COMMANDS)
def test_further_mistakes_on_the_command_line(recorded, table, told, words, code, fragments):
    check_command(recorded, table, told, words, code, fragments)
