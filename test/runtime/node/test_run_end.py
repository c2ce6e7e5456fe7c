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

"""How a run ends: well, stopped, by a fault; and what a latched fault forbids until it is reset."""

import json

import pytest
from fake_node import activate, configure, fake_node, look_after
from fake_transport import PERIOD_S, FakeTransport, take_all
from rclpy.lifecycle import TransitionCallbackReturn

from piezo_ros.nodes.compensator import Compensator
from piezo_ros.runtime.node.rclpy_node.stream_node import ServiceRefusedError
from piezo_ros.runtime.streams.fault import SendGivenUpError, StreamFault
from piezo_ros.runtime.streams.qos import EVERY_STATUS


class Run:
    """A compensator that has begun a run."""

    def __init__(self):
        transport = FakeTransport()
        self.command = transport.writer('command')
        self.voltage = transport.reader('voltage')
        self.published = transport.subscribe('status', EVERY_STATUS)
        self.begin_streams()
        self.node = fake_node(Compensator, transport, lost_writer_timeout_s=0.5)
        configure(self.node)
        activate(self.node)

    def begin_streams(self):
        for end in (self.command, self.voltage):
            end.start(0, PERIOD_S)

    @property
    def state(self):
        return self.node.run_state

    def statuses(self):
        """Return the states that were published, and the newest status."""
        statuses = [json.loads(message.data) for message in self.published.messages]
        self.published.messages.clear()
        return [status['state'] for status in statuses], statuses[-1] if statuses else None

    def look_after(self, clock, duration_s):
        clock.run(duration_s, lambda: look_after(self.node, clock.now_s))


@pytest.fixture
def run():
    return Run()


def test_a_run_that_ends_well(run):
    run.command.publish([1.0, 2.0])
    run.command.end()
    run.node.poll()
    assert len(take_all(run.voltage)) == 2
    assert run.voltage.ended
    assert (run.state.result, run.state.reason, run.state.is_over) == ('finished', '', True)
    states, newest = run.statuses()
    assert states == ['inactive', 'active', 'finished']
    assert (newest['index'], newest['run'], newest['reason']) == (2, 1, '')


def test_a_fault_is_latched_until_it_is_reset(run):
    run.command.next_index = 5
    run.command.publish_one(1.0)
    with pytest.raises(StreamFault) as caught:
        run.node.poll()
    run.node.run.break_off(caught.value)
    assert run.state.fault == '/rig/command lacks the samples 0 … 4'
    assert run.voltage.take_array().size == 0
    assert not run.node.running
    assert run.node.on_activate(None) == TransitionCallbackReturn.FAILURE
    assert 'a fault is latched until ~/reset is called' in run.node.logger.texts['error'][-1]
    assert run.node.requests.reset() == 'cleared: /rig/command lacks the samples 0 … 4'
    assert run.node.requests.reset() == 'there was no fault'
    run.begin_streams()
    activate(run.node)
    assert run.state.number == 2


def test_an_unexpected_error_ends_the_run_with_a_traceback(run):
    run.node.run.break_off(ZeroDivisionError('division by zero'))
    assert (run.state.result, run.state.fault) == (
        'faulted', 'ZeroDivisionError: division by zero')
    assert 'ZeroDivisionError' in run.node.logger.texts['error'][0]


def test_a_lost_writer_is_a_fault_after_its_timeout(run, clock):
    run.command.publish_one(1.0)
    run.node.poll()
    run.look_after(clock, 2.0)
    run.command.publisher.destroy()
    run.look_after(clock, 0.5)
    assert run.node.running
    run.look_after(clock, 0.6)
    assert run.state.fault == '/rig/command lost its writer after sample 0'


def test_a_second_writer_is_a_fault(run, clock):
    run.node.transport.writer('command')
    run.look_after(clock, 0.5)
    assert run.state.fault == (
        '/rig/command has 2 writers (/rig/writer, /rig/writer), exactly one is needed')


def test_the_status_is_repeated_once_a_second(run, clock):
    run.statuses()
    run.node.run._status.report()
    run.look_after(clock, 4.95)
    assert run.statuses()[0] == ['active'] * 5


def test_a_stop_is_no_fault_and_ends_the_stream_once(run):
    run.node.stop('deactivated')
    run.node.stop('again')
    assert (run.state.result, run.state.reason, run.state.has_failed) == (
        'stopped', 'deactivated', False)
    assert not run.node.stop_requested
    assert run.voltage.take_array().size == 0
    assert not run.voltage.take_raw()


def test_the_stop_service_ends_a_run_or_refuses(run):
    assert run.node.requests.stop() == 'stopped: asked to by ~/stop'
    with pytest.raises(ServiceRefusedError, match='no run is going on'):
        run.node.requests.stop()


def test_the_reset_service_is_refused_during_a_run(run):
    with pytest.raises(ServiceRefusedError, match='a run is going on'):
        run.node.requests.reset()


def test_an_error_while_coming_to_rest_is_noted_and_the_end_reported(run):
    run.statuses()

    def quiesce():
        raise OSError('no space left')

    run.node.quiesce = quiesce
    run.node.finish()
    assert run.state.fault == 'OSError: no space left'
    assert run.statuses()[0] == ['finished']


def test_an_end_that_cannot_be_told_keeps_no_node_from_coming_to_rest(run, monkeypatch):
    def end():
        raise OSError('made up')

    calls = []
    monkeypatch.setattr(run.node.writers['voltage'], 'end', end)
    run.node.quiesce = lambda: calls.append('at rest')
    run.node.finish()
    assert calls == ['at rest']
    assert run.state.fault == 'OSError: made up'


def test_stragglers_of_a_stopped_run_are_thrown_away_between_the_runs(run, clock):
    run.command.publish_one(1.0)
    run.node.poll()
    run.node.stop('deactivated')
    run.command.publish_one(2.0)
    run.command.end()
    look_after(run.node, clock.now_s)
    assert not run.node.readers['command'].subscription.messages
    run.begin_streams()
    activate(run.node)
    run.command.publish_one(3.0)
    run.node.poll()
    assert run.node.readers['command'].received == 1


def test_what_comes_for_a_run_that_cannot_begin_is_of_the_next_one(run):
    run.node.stop('deactivated')
    run.command.end()
    run.begin_streams()
    start = run.node.start

    def refuse():
        # A source without feedback has sent everything by now.
        run.command.publish([1.0, 2.0])
        run.command.end()
        raise ValueError('the device is busy')

    run.node.start = refuse
    assert run.node.on_activate(None) == TransitionCallbackReturn.FAILURE
    run.node.start = start
    assert run.node.on_activate(None) == TransitionCallbackReturn.SUCCESS
    run.node.poll()
    assert run.node.readers['command'].received == 2


def test_an_activation_that_was_given_up_meanwhile_begins_no_run(run):
    run.node.stop('deactivated')
    run.begin_streams()
    begin = run.node._begin

    def begin_late():
        assert run.node.requests.stop() == 'the activation is given up'
        begin()

    run.node._begin = begin_late
    assert run.node.on_activate(None) == TransitionCallbackReturn.FAILURE
    assert not run.node.running
    assert run.node.was_given_up


def test_what_is_no_business_of_a_run_is_refused_once_one_has_begun(run):
    done = []
    with pytest.raises(ServiceRefusedError, match='a run is going on'):
        run.node.requests.between_runs(lambda: done.append(True))
    run.node.stop('deactivated')
    run.node.is_activating = True
    with pytest.raises(ServiceRefusedError, match='a run is about to begin'):
        run.node.requests.between_runs(lambda: done.append(True))
    run.node.is_activating = False

    def begins_before(action, refusal=str):
        run.node.running = True
        action()

    run.node.between_samples = begins_before
    with pytest.raises(ServiceRefusedError, match='a run is going on'):
        run.node.requests.between_runs(lambda: done.append(True))
    assert not done


@pytest.mark.parametrize('transition', ['on_deactivate', 'on_cleanup', 'on_shutdown'])
def test_a_transition_lets_a_writer_give_up_that_waits_for_its_reader(run, transition):
    asked = []
    served = run.node.between_samples

    def look(action, refusal=str):
        asked.append(run.node.stop_requested)
        served(action)

    run.node.between_samples = look
    getattr(run.node, transition)(None)
    assert asked[0]
    assert not run.node.stop_requested
    assert not run.node.running


def test_a_parameter_that_is_set_while_the_node_configures_is_read_for_the_run(run):
    run.node.on_deactivate(None)
    run.node.on_cleanup(None)
    run.node.configure = lambda: run.node._changes._after([])
    assert run.node.on_configure(None) == TransitionCallbackReturn.SUCCESS
    assert run.node._changes.has_unread


def test_a_change_of_a_run_is_refused_while_a_reader_does_not_take(run):
    refusals = []
    run.node.between_samples = lambda action, refusal=str: refusals.append(refusal())
    run.node.requests.during_run(lambda: None)
    run.node.writers['voltage'].outlet.is_waiting = True
    run.node.requests.during_run(lambda: None)
    first, second = refusals
    assert first == ''
    assert second == (
        '/rig/voltage waits for a reader that does not take its messages; end that reader or call '
        '~/stop')


def poll_as_the_stream_loop(node):
    try:
        return node.quick(1)
    except Exception as error:
        node.run.break_off(error)
        return True


@pytest.mark.parametrize('refusals', [1, 10**9])
def test_a_run_that_is_stopped_while_its_reader_does_not_take_has_no_gap(run, refusals):
    run.command.publish([1.0, 2.0])
    run.node.poll()
    run.node.writers['voltage'].publisher.refusals = refusals
    for sample in (3.0, 4.0, 5.0):
        run.command.publish_one(sample)
        run.node.stop_requested = True  # while it waits, by ~/stop in another thread
        poll_as_the_stream_loop(run.node)
    run.node.run.stop('asked to by ~/stop')
    assert len(take_all(run.voltage)) == 2
    assert run.voltage.ended == (refusals == 1)
    assert (run.state.result, run.state.reason, run.state.has_failed) == (
        'stopped', 'asked to by ~/stop', False)
    assert run.statuses()[1]['index'] == 2
    assert '/rig/voltage was not sent from sample 2 on' in run.node.logger.warnings[0]
    run.begin_streams()
    activate(run.node)
    assert run.node.quick == run.node.look


def test_a_copy_that_is_given_up_between_two_samples_is_no_fault(run, clock):
    def give_up():
        raise SendGivenUpError('made up')

    run.node.writers['voltage'].flush = give_up
    run.look_after(clock, 0.1)
    assert run.node.running
    assert not run.state.has_failed
    run.node.stop('SIGINT')
    assert run.state.result == 'stopped'


def test_the_output_comes_to_rest_before_the_end_waits_for_a_reader(run):
    publisher = run.node.writers['voltage'].publisher
    publisher.refusals = 3
    left = []
    run.node.quiesce = lambda: left.append(publisher.refusals)
    run.node.run.fail('made up')
    assert left == [3]
    assert take_all(run.voltage) == []
    assert run.voltage.ended

