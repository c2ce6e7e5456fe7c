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

"""No command deletes or overwrites what it reads, or what its inputs name, or its other output."""

import argparse
import os
import shutil
from pathlib import Path

import pytest

from piezo_ros.cli.main import main
from piezo_ros.cli.shared.command_line import COMMANDS, argument_parser
from piezo_ros.cli.shared.outputs import OutputPath

CONFIG = Path(__file__).parents[2] / 'config'
PLAN = 'format_version: 1\nscore_periods: 1\nruns: [{scheme: fb, periods: 1.5}]\n'
PLANNED = 'plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml'
SCAN = f'{PLANNED} --amplitude-um 1 --frequency-hz 300'
SWEEP = f'{PLAN}sweep: {{draws: 2, parameters: {{plant.seed: {{integers: [1, 9]}}}}}}\n'
NAMES_RIG = f'parameter_files: [out/rig.yaml]\n{PLAN}'
NAMES_MOTION = '/**/trajectory: {ros__parameters: {waveform: file, file: out/motion.npz}}\n'
FILES = {
    'plan.yaml': PLAN, 'out/plan.yaml': PLAN, 'sweep.yaml': SWEEP, 'out/sweep.yaml': SWEEP,
    'names_rig.yaml': NAMES_RIG, 'names_bound.yaml': (
        f'uncertainty_bound_file: out/bound.yaml\n{PLAN}'),
    'known.yaml': f'known_rig_files: [out/rig.yaml]\n{PLAN}',
    'sweep_names.yaml': f'parameter_files: [out/rig.yaml]\n{SWEEP}',
    'names_motion.yaml': NAMES_MOTION,
    'names_other.yaml': f'parameter_files: [names_motion.yaml]\n{PLAN}',
    'run_motion.yaml': PLAN.replace('fb', 'fb, waveform: file, file: out/motion.npz'),
    'changes.yaml': NAMES_MOTION.replace(
        'file: out/motion.npz', """file_changes: '[{"at_sample": 9, "file": "out/motion.npz"}]'"""),
    'points.yaml': 'identified_dynamics: {ros__parameters: {points_file: out/table.csv}}\n',
    'table.csv': 'frequency_hz,gain,phase_deg\n1,1,0\n', 'out/table.csv': 'time_s\n',
    'table.yaml': '', 'bound.yaml': '', 'out/bound.yaml': '', 'scan.yaml': '', 'out/scan.yaml': '',
    'motion.npz': 'motion', 'out/motion.npz': 'motion', 'motion.yaml': '', 'out/.piezo_output': '',
    'mine/thesis.tex': 'years of work', 'mine/learning.json': '{"runs": []}',
    'bad.yaml': 'runs: 3\n', 'scans.yaml': 'format_version: 1\nscans: [{lines: 4}]\n',
}

# Words of the command line; what of it is named in the message, beside the option of the output.
INSIDE = [
    ('run out/plan.yaml -o out', 'PLAN out/plan.yaml lies in'),
    ('simulate out/plan.yaml -o out', 'PLAN out/plan.yaml lies in'),
    ('simulate {here}/out/plan.yaml -o out', 'PLAN {here}/out/plan.yaml lies in'),
    ('simulate mine/../out/plan.yaml -o out', 'PLAN mine/../out/plan.yaml lies in'),
    ('simulate to_out/plan.yaml -o out', 'PLAN to_out/plan.yaml lies in'),
    ('simulate out/plan.yaml -o to_out', 'PLAN out/plan.yaml lies in'),
    ('simulate out/to_plan.yaml -o out', 'PLAN out/to_plan.yaml lies in'),
    ('simulate by_out.yaml -o out', 'PLAN by_out.yaml lies in'),
    ('simulate names_rig.yaml -o out', 'out/rig.yaml, which PLAN names_rig.yaml names, lies in'),
    ('simulate known.yaml -o out', 'out/rig.yaml, which PLAN known.yaml names, lies in'),
    ('simulate names_bound.yaml -o out', 'which PLAN names_bound.yaml names, lies in'),
    ('simulate names_other.yaml -o out', 'which PLAN names_other.yaml names, lies in'),
    ('simulate run_motion.yaml -o out', 'which PLAN run_motion.yaml names, lies in'),
    ('run names_rig.yaml -o out', 'out/rig.yaml, which PLAN names_rig.yaml names, lies in'),
    ('sweep out/sweep.yaml -o out', 'PLAN out/sweep.yaml lies in'),
    ('sweep sweep_names.yaml -o out', 'out/rig.yaml, which PLAN sweep_names.yaml names, lies in'),
    ('learn out/scan.yaml --offline -o out', 'SCAN out/scan.yaml lies in'),
    ('learn scan.yaml --offline --parameters out/rig.yaml -o out', '--parameters out/rig.yaml'),
    ('learn scan.yaml --offline --parameters rig.yaml --parameters names_motion.yaml -o out',
     'out/motion.npz, which --parameters names_motion.yaml names, lies in'),
    ('learn scan.yaml --offline --parameters changes.yaml -o out',
     'out/motion.npz, which --parameters changes.yaml names, lies in'),
    ('report out -o out', 'DIR|BAG out is what -o out would replace'),
    ('report out/bags/run -o out', 'DIR|BAG out/bags/run lies in'),
    ('report bag out/bags/run -o out', 'DIR|BAG out/bags/run lies in'),
    ('report linked -o out', 'DIR|BAG linked lies in'),
    ('report linked_file -o out', 'DIR|BAG linked_file lies in'),
    ('replay out/bags/run -o out', 'BAG out/bags/run lies in'),
    ('replay bag --controller out/rig.yaml -o out', '--controller out/rig.yaml lies in'),
    ('replay bag --trajectory names_motion.yaml -o out', 'which --trajectory names_motion.yaml'),
    ('image out/bags/run bag -o out', 'BAG_X out/bags/run lies in'),
    ('image bag out/bags/run -o out', 'BAG_Y out/bags/run lies in'),
    ('identify hysteresis out/bags/run -o m.yaml --report out', 'BAG out/bags/run lies in'),
    ('identify dynamics bag --compensator out/compensator.yaml -o m.yaml --report out',
     '--compensator out/compensator.yaml lies in'),
    ('identify dynamics bag --trajectory out/trajectory.yaml -o m.yaml --report out',
     '--trajectory out/trajectory.yaml lies in'),
    ('identify dynamics bag --place-from out/bags/run -o m.yaml --report out',
     '--place-from out/bags/run lies in'),
    ('identify dynamics --from-response out/table.csv -o m.yaml --report out',
     '--from-response out/table.csv lies in'),
    ('tune out/trajectory.yaml -o c.yaml --report out', 'MODEL out/trajectory.yaml lies in'),
    ('tune trajectory.yaml --bound out/bound.yaml -o c.yaml --report out', '--bound out/bound.y'),
    ('tune points.yaml -o c.yaml --report out', 'out/table.csv, which MODEL points.yaml names'),
]
SAME = [
    ('bag export bag.mcap -o to_bag.csv', 'BAG bag.mcap is what -o to_bag.csv would replace'),
    ('bag export bag.csv -o bag.csv', 'BAG bag.csv is what -o bag.csv would replace'),
    ('bag export bag.csv -o ./mine/../bag.csv', 'BAG bag.csv is what -o mine/../bag.csv would'),
    ('bag motion motion.npz -o motion.npz', 'BAG motion.npz is what -o motion.npz would replace'),
    ('identify hysteresis bag -o bag/metadata.yaml', 'BAG bag is what -o bag/metadata.yaml would'),
    ('identify hysteresis bag -o bag/bag_0.mcap', 'BAG bag is what -o bag/bag_0.mcap would'),
    ('identify dynamics --from-response table.csv -o table.csv', '-o table.csv: another file'),
    ('identify dynamics --from-response table.csv -o table.yaml',
     '--from-response table.csv is what -o table.csv would replace'),
    ('identify dynamics bag --trajectory points.yaml -o out/table.yaml',
     'out/table.csv, which --trajectory points.yaml names, is what -o out/table.csv would replace'),
    ('identify creep bag --compensator compensator.yaml -o compensator.yaml',
     '--compensator compensator.yaml is what -o compensator.yaml would replace'),
    ('identify uncertainty bag --model trajectory.yaml -o trajectory.yaml',
     '--model trajectory.yaml is what -o trajectory.yaml would replace'),
    ('tune trajectory.yaml -o trajectory.yaml', 'MODEL trajectory.yaml is what -o trajectory.yaml'),
    ('tune by_out.yaml -o out/plan.yaml', 'MODEL by_out.yaml is what -o out/plan.yaml would'),
    ('tune trajectory.yaml --bound bound.yaml -o bound.yaml', '--bound bound.yaml is what -o'),
    ('tune trajectory.yaml --plant rig.yaml -o rig.yaml', '--plant rig.yaml is what -o rig.yaml'),
    (f'{SCAN} -o rig.yaml', '--plant rig.yaml is what -o rig.yaml would replace'),
    (f'{SCAN} --bound bound.yaml -o bound.yaml', '--bound bound.yaml is what -o bound.yaml would'),
    (f'{PLANNED} --motion motion.npz -o motion.yaml', '--motion motion.npz is what -o motion.npz'),
]
# They replace nothing, hence they have no --force.
NEVER_REPLACED = [
    ('bag import table.csv -o table.csv', 'FILE table.csv is what -o table.csv would replace'),
    ('bag salvage bag -o bag', 'BAG bag is what -o bag would replace'),
    ('bag salvage out/bags/run -o out', 'BAG out/bags/run lies in the output directory out (-o)'),
]
COLLIDING = [
    (f'{SCAN} -o s.npz', '-o s.npz: another file of this name is written too'),
    ('identify hysteresis bag -o m.svg', 'give it another suffix than .svg'),
    ('identify creep bag -o m.svg', 'give it another suffix than .svg'),
    ('identify uncertainty bag --model trajectory.yaml -o m.svg', 'another suffix than .svg'),
    ('identify dynamics bag -o m.svg', 'give it another suffix than .svg'),
    ('identify dynamics bag -o m.csv', 'give it another suffix than .csv'),
    ('identify dynamics bag -o m --report m', '-o and --report both are m; give one of them'),
    ('identify dynamics bag -o m.yaml --report m.csv', '-o and --report both are m.csv'),
    ('identify hysteresis bag -o m/c.yaml --report m', '-o m/c.yaml lies in --report m; give one'),
    ('tune trajectory.yaml -o out --report out', '-o and --report both are out; give one of them'),
    ('tune trajectory.yaml -o c --report mine/../c', '-o and --report both are c; give one'),
    ('tune trajectory.yaml -o out/c.yaml --report out', '-o out/c.yaml lies in --report out'),
    ('tune trajectory.yaml -o to_out/c.yaml --report out', '-o to_out/c.yaml lies in --report out'),
    ('tune trajectory.yaml -o c --report c/page', '--report c/page lies in -o c; give one of them'),
]
# A command that cannot do its work, and the exit code: the earlier output stays.
FAILING = [
    ('simulate bad.yaml -o out', 2), ('run bad.yaml -o out', 2), ('sweep plan.yaml -o out', 2),
    ('run scans.yaml --keep -o out', 1), ('learn scan.yaml --offline -o out', 2),
    ('report no_bag -o out', 1), ('replay no_bag -o out', 1), ('image no_bag bag -o out', 1),
    ('replay bag --controller rig.yaml -o out', 2),
    ('identify hysteresis no_bag -o m.yaml --report out', 1),
    ('identify dynamics bag -o m.yaml --from-s 9 --report out', 1),
    ('tune rig.yaml -o c.yaml --report out', 2),
    ('tune trajectory.yaml --bound rig.yaml -o c.yaml --report out', 2),
]


@pytest.fixture(scope='module')
def recorded(simulated):
    return simulated(PLAN)


@pytest.fixture
def here(tmp_path, recorded, monkeypatch):
    """Lay plans, models, bags and an earlier output on the table, and work there."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    for name in ('compensator', 'trajectory', 'rig'):
        for folder in ('.', 'out'):
            shutil.copy(CONFIG / f'{name}.yaml', tmp_path / folder)
    for name in ('bag', 'out/bags/run'):
        shutil.copytree(recorded, tmp_path / name)
    for name in ('bag.csv', 'bag.mcap'):
        shutil.copy(recorded / 'bag_0.mcap', tmp_path / name)
    for name, target in (
            ('to_out', 'out'), ('out/to_plan.yaml', '../plan.yaml'), ('to_bag.csv', 'bag.mcap'),
            ('by_out.yaml', 'out/plan.yaml'), ('linked/bags/run', '../../out/bags/run'),
            ('linked_file/bag_0.mcap', '../out/bags/run/bag_0.mcap'),
            ('dangling.csv', 'gone/disk.csv'), ('dangling', 'gone/disk')):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).symlink_to(target)
    return tmp_path


@pytest.fixture
def told(here, capsys):
    """Return what runs a command line and returns its exit code and what it says of a problem."""
    def run(words):
        try:
            code = main(words.format(here=here).split())
        except SystemExit as ended:
            code = ended.code
        return code, capsys.readouterr().err
    return run


def content(directory):
    """Return all that is in a directory, with the bytes of files and the targets of links."""
    links = {path: os.readlink(path) for path in directory.rglob('*') if path.is_symlink()}
    files = {path: path.read_bytes() for path in directory.rglob('*') if path.is_file()}
    return {**dict.fromkeys(directory.rglob('*')), **files, **links}


def refused(told, here, words, fragment):
    before = content(here)
    code, err = told(words)
    assert fragment.format(here=here) in err
    assert code == 2
    assert content(here) == before


@pytest.mark.parametrize(('words', 'fragment'), [*INSIDE, *SAME])
def test_an_output_that_would_replace_an_input_is_refused(told, here, words, fragment):
    refused(told, here, f'{words} --force', fragment)


@pytest.mark.parametrize(('words', 'fragment'), NEVER_REPLACED)
def test_a_bag_is_not_written_over_what_it_is_made_of(told, here, words, fragment):
    refused(told, here, words, fragment)


@pytest.mark.parametrize('force', ['', ' --force'])
@pytest.mark.parametrize(('words', 'fragment'), COLLIDING)
def test_outputs_that_would_replace_each_other_are_refused(told, here, words, fragment, force):
    refused(told, here, f'{words}{force}', fragment)


@pytest.mark.parametrize(('words', 'code'), FAILING)
def test_an_earlier_output_outlasts_a_command_that_fails(told, here, words, code):
    before = content(here)
    found, err = told(f'{words} --force')
    assert (found, err[:7]) == (code, 'piezo: ')
    assert content(here) == before


@pytest.mark.parametrize('words', [
    'bag export bag -o dangling.csv', 'bag export bag -o dangling.csv --force',
    'tune trajectory.yaml -o dangling', 'simulate plan.yaml -o dangling --force',
    'bag import table.csv -o dangling', 'sweep sweep.yaml -o dangling',
    'tune trajectory.yaml -o c.yaml --report dangling'])
def test_a_link_to_what_is_not_there_is_no_output(told, here, words):
    refused(told, here, words, 'is a symbolic link to gone/disk')


def test_learning_goes_on_only_with_an_earlier_output(told, here):
    learn = f'learn scan.yaml --offline --parameters {CONFIG}/rig.yaml --resume'
    assert told(f'{SCAN} -o scan.yaml --force') == (0, '')
    refused(told, here, f'{learn} -o mine', 'mine exists and is no earlier output')
    refused(told, here, f'{learn} -o out', 'out exists; --force replaces it')
    refused(told, here, f'{learn} -o out --force', '--resume')
    (here / 'out/learning.json').write_text('{')
    before = content(here)
    code, err = told(f'{learn} -o out')
    assert code == 1
    assert 'out/learning.json is damaged' in err
    assert content(here) == before


def test_what_is_read_may_lie_beside_or_above_the_output(told, here):
    for words in (
            'report out -o out/again --periods 1', 'report out -o out/again --periods 1 --force',
            'bag export bag -o bag/table.csv', 'bag export bag -o bag/table.csv --force',
            'simulate plan.yaml -o again', 'simulate plan.yaml -o to_out --force'):
        assert told(words)[0] == 0
    assert (here / 'out/report.html').is_file()
    assert (here / 'to_out').is_symlink()
    assert not (here / 'out/rig.yaml').exists()


def test_missing_folders_of_a_file_are_made(told, here):
    assert told('bag export bag -o new/folder/table.csv') == (0, '')
    assert told(f'{SCAN} -o newer/scan.yaml') == (0, '')
    assert (here / 'new/folder/table.csv').is_file()
    assert (here / 'newer/scan.npz').is_file()


def commands(parser, words=()):
    """Yield each command with its parser, and all that is above it."""
    deeper = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
    for action in deeper:
        for name, inner in action.choices.items():
            yield from commands(inner, (*words, (name, parser)))
    if not deeper:
        yield ' '.join(name for name, _ in words), [*(above for _, above in words), parser]


ALL_COMMANDS = [pair for name in COMMANDS for pair in commands(
    argument_parser([name])._subparsers._group_actions[0].choices[name], ((name, None),))]


def test_every_option_that_writes_is_known_and_tried():
    tried = ' '.join(words for words, _ in [*INSIDE, *SAME, *NEVER_REPLACED])
    writing = set()
    for command, parsers in ALL_COMMANDS:
        for action in parsers[-1]._actions:
            if action.dest in ('output', 'report'):
                assert isinstance(action, OutputPath), f'{command} {action.dest}'
            if isinstance(action, OutputPath):
                writing.add(command)
    assert {command for command in writing if command not in tried} == {'init', 'calibrate'}


def test_every_path_is_told_to_the_check_as_a_path():
    for command, parsers in ALL_COMMANDS:
        for action in parsers[-1]._actions:
            is_path = any(
                isinstance(action.metavar, str) and word in action.metavar
                for word in ('FILE', 'DIR', 'BAG', 'MODEL', 'SCAN'))
            if is_path:
                assert isinstance((action.type or str)('a'), Path), f'{command} {action.dest}'
