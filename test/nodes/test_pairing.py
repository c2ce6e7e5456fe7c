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

"""The controller pairs its three inputs by index, however these are cut, late or early."""

import numpy as np
import pytest
from fake_node import activate, configure, fake_node, poll_all
from fake_transport import PERIOD_S, FakeTransport, take_all
from hypothesis import example, given, settings
from hypothesis import strategies as st

from piezo_ros.control.changes import Change, changes_text
from piezo_ros.control.controller_step import ControllerParameters
from piezo_ros.control.pi_controller import PiController
from piezo_ros.nodes.controller import Controller

INPUTS = ('reference', 'feedforward', 'displacement')
COUNT = 60
SAMPLES = np.random.default_rng(2).normal(size=(3, COUNT))
CUTS = st.lists(st.integers(1, 25) | st.just(1), min_size=1)
CHANGE_AT = 23


class Paired:
    """A controller that has begun a run, its inputs and its output."""

    def __init__(self, first=0, starts=(0, 0, 0), **parameters):
        self.transport = FakeTransport()
        self.inputs = {stream: self.transport.writer(stream) for stream in INPUTS}
        self.output = self.transport.reader('command')
        for writer, start in zip(self.inputs.values(), starts, strict=True):
            writer.start(start, PERIOD_S)
        self.output.start(first, PERIOD_S)
        self.node = fake_node(Controller, self.transport, start_index=first, **parameters)
        configure(self.node)
        activate(self.node)

    def send(self, stream, count):
        """Send the next samples of a stream; return the commands that follow."""
        writer, samples = self.inputs[stream], SAMPLES[INPUTS.index(stream)]
        samples = samples[writer.sent:writer.sent + count]
        if samples.size:
            writer.publish(samples)
        return self.commands()

    def commands(self):
        poll_all(self.node)
        return take_all(self.output)


def expected_commands(scheme, samples=SAMPLES, changes=()):
    law = ControllerParameters(scheme=scheme)
    controller, commands, first = PiController(law, PERIOD_S, compiled=False), [], 0
    for change in [*changes, Change(samples.shape[1], {})]:
        commands.extend(controller.answer(first, *samples[:, first:change.at_sample]).tolist())
        first, law = change.at_sample, law.replaced(**change.values)
        controller.change(law, bumpless=True)
    return commands


def send_in_pieces(paired, cuts, order):
    """Send all samples of each input in pieces of its own lengths; return all commands."""
    pieces = {stream: iter(sizes) for stream, sizes in zip(INPUTS, cuts, strict=True)}
    commands = []
    for stream in order:
        commands.extend(paired.send(stream, next(pieces[stream], COUNT)))
    for stream in INPUTS:
        commands.extend(paired.send(stream, COUNT))
    return commands


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize('scheme', ['fb', 'ff', 'fbff', 'open_loop'])
@settings(max_examples=15)
@given(st.tuples(CUTS, CUTS, CUTS), st.lists(st.sampled_from(INPUTS), max_size=30))
def test_commands_are_the_same_however_the_inputs_are_cut_and_come(
        scheme, compiled, cuts, order):
    paired = Paired(scheme=scheme, compiled=compiled)
    assert send_in_pieces(paired, cuts, order) == expected_commands(scheme)


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize(('before', 'after'), [
    ('fbff', 'ff'), ('ff', 'fbff'), ('fb', 'fbff'), ('open_loop', 'fb')])
@settings(max_examples=15)
@given(st.tuples(CUTS, CUTS, CUTS), st.lists(st.sampled_from(INPUTS), max_size=30))
def test_a_change_of_the_scheme_is_made_at_its_sample_in_any_block(
        before, after, compiled, cuts, order):
    change = Change(CHANGE_AT, {'scheme': after})
    paired = Paired(
        scheme=before, compiled=compiled,
        changes=changes_text([{'at_sample': CHANGE_AT, 'scheme': after}]))
    assert send_in_pieces(paired, cuts, order) == expected_commands(before, changes=[change])


def test_a_command_needs_the_sample_of_every_input():
    paired = Paired()
    assert paired.send('reference', 40) == []
    assert paired.send('feedforward', 10) == []
    assert len(paired.send('displacement', 1)) == 1
    assert len(paired.send('displacement', 20)) == 9
    assert len(paired.send('feedforward', 40)) == 11
    assert paired.node.counts()['samples'] == 21


def test_feedback_that_is_not_needed_is_not_waited_for():
    paired = Paired(scheme='ff')
    assert len(paired.send('reference', 40) + paired.send('feedforward', 40)) == 40


@settings(max_examples=25)
@example((700, 700, 703), ([1, 1, 1], [1], [1]), ['reference'] * 3)
@given(st.tuples(*[st.integers(700, 715)] * 3), st.tuples(CUTS, CUTS, CUTS),
       st.lists(st.sampled_from(INPUTS), max_size=30))
def test_a_run_that_is_joined_begins_at_the_first_sample_that_all_inputs_have(
        starts, cuts, order):
    paired = Paired(first=-1, starts=starts, scheme='fbff')
    commands = send_in_pieces(paired, cuts, order)
    first = max(starts)
    count = COUNT - (first - min(starts))
    samples = np.array([
        row[first - start:first - start + count]
        for row, start in zip(SAMPLES, starts, strict=True)])
    assert commands == expected_commands('fbff', samples)
    assert paired.output.next_index == first + count


def test_a_change_of_a_run_that_is_joined_counts_as_its_streams_do():
    paired = Paired(first=-1, starts=(700, 700, 700), scheme='fbff')
    gain = {'proportional_gain': 0.7}
    assert 'apply_at_sample is 710; at which sample the run begins is not known yet' in (
        paired.node.change_parameters({**gain, 'apply_at_sample': 710}))
    assert paired.node.change_parameters({'scheme': 'ff'}) == ''  # from its first sample on
    for stream in INPUTS:
        paired.send(stream, 5)
    assert paired.node.change_parameters({**gain, 'apply_at_sample': 710}) == ''
    for stream in INPUTS:
        paired.send(stream, 15)
    fields = paired.node.status_fields()
    assert (fields['scheme'], fields['changed_at']) == ('ff', 710)
    assert 'from sample 700 on: ff' in paired.node.logger.texts['info'][-2]


def test_without_feedback_a_run_is_joined_before_the_displacement_has_come():
    paired = Paired(first=-1, starts=(700, 690, 800), scheme='ff')
    paired.send('feedforward', 40)
    assert len(paired.send('reference', 40)) == 30
    assert paired.output.next_index == 730


def test_the_end_of_the_reference_is_passed_on_and_that_of_the_plant_ends_the_run():
    paired = Paired()
    for stream in INPUTS:
        paired.send(stream, COUNT)
    paired.inputs['reference'].end()
    paired.inputs['feedforward'].end()
    paired.commands()
    assert paired.output.ended
    assert paired.node.running
    paired.inputs['displacement'].publish([0.0])
    paired.inputs['displacement'].end()
    paired.commands()
    assert paired.node.run_state.result == 'finished'


def test_a_plant_that_ends_before_the_trajectory_stops_the_run():
    paired = Paired()
    paired.send('reference', 40)
    paired.send('feedforward', 40)
    paired.send('displacement', 10)
    paired.inputs['displacement'].end()
    assert paired.commands() == []
    state = paired.node.run_state
    assert (state.result, state.by_peer, state.has_failed) == ('stopped', True, False)
    assert state.reason == '/rig/displacement ended at sample 10, before the trajectory'


@pytest.mark.parametrize('scheme', ['fbff', 'ff'])
def test_a_trajectory_that_is_stopped_between_its_two_streams_stops_the_run(scheme):
    paired = Paired(scheme=scheme)
    paired.send('displacement', 1)
    paired.send('feedforward', 10)
    paired.inputs['feedforward'].end()
    paired.commands()
    assert paired.node.running
    paired.send('reference', 20)
    paired.send('displacement', 20)
    state = paired.node.run_state
    assert (state.result, state.by_peer, state.has_failed) == ('stopped', True, False)
    assert state.reason == '/rig/feedforward ended at sample 10, before /rig/reference'
    assert paired.output.next_index == 10


def test_streams_of_one_length_end_the_run_well_whichever_end_comes_first():
    paired = Paired(scheme='fbff')
    for stream in ('feedforward', 'displacement', 'reference'):
        paired.send(stream, 20)
    paired.inputs['feedforward'].end()
    paired.commands()
    paired.inputs['reference'].end()
    paired.commands()
    assert paired.output.ended
    assert paired.node.running


def test_a_gap_of_one_input_ends_the_run_after_what_came_before():
    paired = Paired()
    for stream in INPUTS:
        paired.send(stream, 10)
    paired.inputs['feedforward'].next_index = 12
    paired.inputs['feedforward'].publish([0.0])
    with pytest.raises(Exception, match='/rig/feedforward lacks the samples 10 … 11') as caught:
        paired.send('reference', 10)
    paired.node.run.break_off(caught.value)
    state = paired.node.run_state
    assert (state.result, state.has_failed) == ('faulted', True)
    assert paired.output.take_array().size == 0  # the end of the command
