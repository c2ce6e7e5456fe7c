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

"""Options that have no effect on what is asked for are refused, and named."""

import pytest

from piezo_ros.cli.main import main

PLAN = 'format_version: 1\nscore_periods: 1\nruns: [{scheme: ff, periods: 1.5}]\n'
PLANNED = 'plan trajectory.yaml --compensator compensator.yaml --plant rig.yaml -o s.yaml'
SCAN = f'{PLANNED} --amplitude-um 1 --frequency-hz 300'
TUNED = 'tune trajectory.yaml -o tuned.yaml'

COMMANDS = [
    ('check plan.yaml --amplitude 2', '--amplitude has no effect on a plan'),
    ('check plan.yaml --discovery-s 2 --yes', '--discovery-s, --yes have no effect on a plan'),
    ('check device --parameters rig.yaml --patience-s 1', '--patience-s has no effect on a device'),
    (f'{PLANNED} --motion m.csv --offset-um 1', '--offset-um has no effect on a --motion'),
    (f'{PLANNED} --motion m.csv --amplitude-um 1', '--amplitude-um has no effect on a --motion'),
    (f'{SCAN} --flyback-fraction 0.2', '--flyback-fraction has no effect on a triangle'),
    (f'{SCAN} --waveform sine --turn-fraction 0.2', '--turn-fraction has no effect on a sine'),
    (f'{TUNED} --lead-ratio 5', '--lead-ratio has no effect without --lead'),
    (f'{TUNED} --bound none --uncertainty-limit 2', '--uncertainty-limit has no effect beside'),
    (f'{TUNED} --no-operating-points --harmonics 5', '--harmonics has no effect beside'),
    ('learn scan.yaml -o out --offline --composed', '--composed has no effect beside --offline'),
    ('learn scan.yaml -o out --resume --force', '--force has no effect beside --resume'),
    ('init -o out', '-o has no effect without NAME'),
    ('replay bag --force', '--force has no effect without -o'),
    ('replay bag --ki 100', '--ki has no effect under the scheme ff'),
    ('replay bag --trajectory trajectory.yaml', '--trajectory has no effect where the bag'),
    ('report bag -o out --periods 1 --scheme fb', '--scheme has no effect where every bag tells'),
    ('identify dynamics bag -o m.yaml --sample-period-s 1e-4', (
        '--sample-period-s has no effect without --from-response')),
    ('identify dynamics --from-response r.csv -o m.yaml --excitation auto --run 1', (
        '--excitation, --run have no effect where no BAG is given')),
    ('identify dynamics bag -o m.yaml --excitation stepped --estimator h1', (
        '--estimator has no effect on the excitation stepped')),
    ('identify dynamics bag -o m.yaml --excitation auto --trajectory trajectory.yaml', (
        '--trajectory has no effect beside --excitation')),
    ('image bag bag -o out', 'one bag holds both axes only if --namespaces tells them apart'),
]


@pytest.fixture(scope='module')
def recorded(simulated):
    return simulated(PLAN)


@pytest.mark.parametrize(('words', 'said'), COMMANDS)
def test_an_option_without_effect_is_refused(recorded, models, capsys, words, said):
    (models / 'bag').symlink_to(recorded)
    (models / 'plan.yaml').write_text(PLAN)
    before = sorted(path.name for path in models.iterdir())
    assert main(words.split()) == 2
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1
    assert sorted(path.name for path in models.iterdir()) == before


@pytest.mark.parametrize('role', ['plant', 'controller'])
@pytest.mark.parametrize(('words', 'said'), [
    ('--parameters rig.yaml', '--parameters has no effect on a '),
    ('--watchdog-s 3', '--watchdog-s has no effect but on a plant behind --start'),
    ('--namespace /a --start sh', '--namespace has no effect beside --start'),
])
def test_an_option_without_effect_on_a_node_is_refused(capsys, role, words, said):
    pytest.importorskip('rclpy')
    assert main(['check', role, *words.split()]) == 2
    assert said in capsys.readouterr().err
