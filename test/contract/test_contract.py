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

"""`piezo check` of plants that break the contract, each in one way: the way is named."""

import sys
from pathlib import Path

import pytest

from piezo_ros.contract.contract_runs import FAULTS, SILENCE, broken_run, ordinary_run
from piezo_ros.contract.session import StartedNode, check_command, compared
from piezo_ros.contract.topics import CONTRACTS, CheckSettings

FOLDER = Path(__file__).parent
EXAMPLE = Path(__file__).parents[2] / 'docs' / 'examples' / 'gain_plant.py'
SETTINGS = CheckSettings(
    amplitude=0.1, sample_period_s=None, discovery_s=60.0, patience_s=10.0, watchdog_s=10.0)
# Where something is waited for in vain; less on a busy machine could only find more wrong.
IMPATIENT = SETTINGS._replace(patience_s=2.0, watchdog_s=1.0)


def started(way, settings):
    return StartedNode(
        'plant', [sys.executable, str(FOLDER / 'wrong_plant.py'), way], settings)


def wrong(findings):
    return {finding.what: finding.detail for finding in findings if finding.right is False}


@pytest.mark.parametrize(('way', 'what', 'detail'), [
    ('OpensWithTwo', 'y[0] alone before any voltage', '2 samples arrived from index 0'),
    ('AnswersWithTheSameIndex', 'indices without gaps', 'index 0 where 1 is due'),
    ('ForgetsTheOffset', 'layout of every block', 'layout.dim has 0 entries'),
    ('TakesAnything', 'refusal of a sample that is no number', 'samples of'),
    ('DiesOnNonsense', 'refusal of another label', 'the command ended with exit code 1'),
])
def test_what_is_wrong_in_an_ordinary_run_is_named(way, what, detail):
    with started(way, SETTINGS) as session:
        ordinary_run(session.node, disturbed=True)
    assert detail in wrong(session.node.findings)[what]


def test_each_of_several_ways_to_be_wrong_is_named():
    ways = {
        'ChangesThePeriod': ('sample period', 'it changed: 1e-05, 2e-05 s'),
        'EndsAtTheWrongIndex': ('end of the stream passed on', 'it must be the count of samples'),
        'StaysWhereItIs': ('voltage at zero at the end', 'says voltage_v 0.25 after the end'),
        'BestEffort': ('quality of service', 'is best effort: samples may be lost'),
    }
    with started('+'.join(ways), IMPATIENT) as session:
        ordinary_run(session.node, disturbed=True)
    found = wrong(session.node.findings)
    assert found.keys() == {what for what, _ in ways.values()}
    for what, detail in ways.values():
        assert detail in found[what]


@pytest.mark.parametrize(('way', 'what', 'detail'), [
    pytest.param(
        'NeverOpens', 'y[0] alone before any voltage', 'nothing arrived on',
        marks=pytest.mark.slow),
    ('NeverEnds', 'end of the stream passed on', 'no N = 0 on'),
    pytest.param(
        'SaysNothingOfItself', 'status', 'nothing arrived on', marks=pytest.mark.slow),
])
def test_what_is_missing_in_an_ordinary_run_is_named(way, what, detail):
    discovery_s = 4.0 if way == 'NeverOpens' else SETTINGS.discovery_s
    with started(way, IMPATIENT._replace(discovery_s=discovery_s)) as session:
        ordinary_run(session.node, disturbed=False)
    assert detail in wrong(session.node.findings)[what]


@pytest.mark.parametrize(('way', 'fault'), [
    ('JumpsOverGaps', 'a gap ends the run'),
    pytest.param('WatchesNothing', 'a second writer ends the run', marks=pytest.mark.slow),
    pytest.param('WatchesNothing', 'a lost writer ends the run', marks=pytest.mark.slow),
    pytest.param('WatchesNothing', SILENCE, marks=pytest.mark.slow),
])
def test_a_run_that_should_have_ended_is_named(way, fault):
    with started(way, IMPATIENT) as session:
        broken_run(session.node, fault, FAULTS[fault])
    detail = wrong(session.node.findings)[fault]
    # On a busy machine the run may end by its watchdog, and has answered all the same.
    assert 'has not ended within' in detail or 'answered that came after the fault' in detail
    if way == 'WatchesNothing':
        # Nothing can tell of the voltage, as long as it goes on.
        assert f'{fault}: voltage at zero' in wrong(session.node.findings)


@pytest.mark.parametrize(('way', 'what', 'detail'), [
    ('NeverDemands', 'demand ahead of what is consumed', '/demand has no writer'),
    pytest.param(
        'DemandsOnceAndForAll', 'demand ahead of what is consumed', 'must be transient_local',
        marks=pytest.mark.slow),
    ('AnswersTwice', 'v[k] as soon as y_d[k], u_ff[k] and y[k] are there', '2 samples of'),
    pytest.param(
        'WaitsForTheNextMeasurement', 'v[k] as soon as y_d[k], u_ff[k] and y[k] are there',
        '0 samples of', marks=pytest.mark.slow),
])
def test_what_is_wrong_with_a_controller_is_named(way, what, detail):
    command = [sys.executable, str(FOLDER / 'wrong_controller.py'), way]
    settings = SETTINGS._replace(sample_period_s=1e-5)
    if way == 'WaitsForTheNextMeasurement':
        settings = settings._replace(patience_s=2.0)
    with StartedNode('controller', command, settings) as session:
        ordinary_run(session.node, disturbed=False)
    assert detail in wrong(session.node.findings)[what]


def test_a_state_that_refused_blocks_have_changed_is_named():
    findings = []
    for disturbed in (True, False, False):
        with started('RemembersWhatItRefuses', SETTINGS) as session:
            findings.append(ordinary_run(session.node, disturbed=disturbed))
        assert not wrong(session.node.findings)
    finding = compared(findings[0], findings[1:])
    assert finding.right is False
    assert 'without refused blocks' in finding.detail


@pytest.mark.slow  # The tutorial of the same plant is run by every test.
def test_the_plant_of_the_documentation_is_right_in_everything():
    findings = check_command('plant', [sys.executable, str(EXAMPLE)], SETTINGS)
    assert all(finding.right for finding in findings), findings
    assert {*FAULTS, 'SIGINT ends the process', 'state left alone by what was refused'} <= {
        finding.what for finding in findings}


OWN = {role: [sys.executable, '-m', 'piezo_ros.nodes.executables', role] for role in CONTRACTS}


# The command, below, checks the plant.
@pytest.mark.parametrize('role', [
    pytest.param(role, marks=pytest.mark.slow) if role == 'plant' else role
    for role in CONTRACTS])
def test_our_own_nodes_are_right_in_an_ordinary_run(role):
    settings = SETTINGS._replace(sample_period_s=1e-5)
    with StartedNode(role, OWN[role], settings) as session:
        ordinary_run(session.node, disturbed=True)
    assert all(finding.right for finding in session.node.findings), session.node.findings
    assert any(finding.what == 'end of the stream passed on' for finding in session.node.findings)


@pytest.mark.slow
@pytest.mark.parametrize('role', CONTRACTS)
def test_our_own_nodes_are_right_in_everything(role):
    findings = check_command(role, OWN[role], SETTINGS._replace(sample_period_s=1e-5))
    assert all(finding.right for finding in findings), findings


@pytest.mark.slow
def test_a_node_that_has_writers_already_is_told_to_run_alone(rig, peer):
    peer.writer('voltage')
    rig.node('plant', required_readers=0)
    peer.wait_for_status('plant', state='active')
    command = rig.piezo('check', 'plant', '--namespace', rig.namespace)
    assert command.wait() == 1
    assert f'{rig.namespace}/voltage has a writer already, {rig.namespace}/foreign' in (
        command.output)


def test_the_command_checks_a_node_that_runs(rig):
    rig.node('plant', handshake_timeout_s=60.0)
    command = rig.piezo('check', 'plant', '--namespace', rig.namespace, '--discovery-s', '60')
    assert command.wait() == 0, command.output
    assert 'ok       voltage at zero at the end' in command.output
    assert '27 checks, 0 wrong' in command.output


def test_the_command_checks_a_plant_that_plays_whole_runs(rig):
    rig.node('hardware_plant', handshake_timeout_s=60.0, demagnetise='false')
    words = ('check', 'plant', '--namespace', rig.namespace, '--discovery-s', '60', '--ahead')
    command = rig.piezo(*words)
    assert command.wait() == 0, command.output
    assert 'ok       u[k] answered by y[k+1], once the whole run is there' in command.output
    assert 'ok       voltage at zero at the end' in command.output
    assert '26 checks, 0 wrong' in command.output


def test_what_must_be_refused_is_counted_in_a_whole_run_too():
    with started('TakesAnything', IMPATIENT._replace(ahead=True)) as session:
        ordinary_run(session.node, disturbed=True)
    detail = wrong(session.node.findings)['u[k] answered by y[k+1], once the whole run is there']
    assert 'blocks that must be refused were taken' in detail


@pytest.mark.slow
def test_a_plant_that_plays_whole_runs_is_told_what_to_give(rig):
    rig.node('hardware_plant', handshake_timeout_s=60.0, demagnetise='false')
    command = rig.piezo(
        'check', 'plant', '--namespace', rig.namespace, '--discovery-s', '60', '--patience-s', '2')
    assert command.wait() == 1
    assert 'by the clock of a device needs --ahead' in command.output


@pytest.mark.slow
def test_our_own_hardware_plant_is_right_in_everything():
    settings = SETTINGS._replace(sample_period_s=1e-5, ahead=True)
    findings = check_command('plant', [*OWN['plant'][:-1], 'hardware_plant'], settings)
    assert all(finding.right for finding in findings), findings
    assert {*FAULTS, 'SIGINT ends the process'} <= {finding.what for finding in findings}


def test_only_a_plant_is_sent_whole_runs(rig):
    command = rig.piezo('check', 'controller', '--ahead')
    assert command.wait() == 2
    assert '--ahead is for plant' in command.output


def test_that_no_node_is_there_is_told_and_fails(rig):
    command = rig.piezo('check', 'compensator', '--discovery-s', '0.5')
    assert command.wait() == 1
    assert '/voltage has no writer, exactly one is needed' in command.output


def test_a_command_that_ends_at_once_is_told_with_its_last_words(rig):
    command = rig.piezo('check', 'plant', '--start', 'sh', '-c', 'echo no such port; exit 3')
    assert command.wait() == 1
    assert 'the command ended with exit code 3; it wrote: no such port' in command.output
