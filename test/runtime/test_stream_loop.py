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

"""The stream loop: the order of its nodes, when it sleeps, and when it ends."""

import os
import threading
from types import SimpleNamespace

import pytest

from piezo_ros.runtime import host
from piezo_ros.runtime.process.stop_request import StopRequest
from piezo_ros.runtime.stream_loop import serve_streams


class Node:
    """A node with work to do: numbers of the turns in which it has something."""

    def __init__(self, role, log, work=(), *, urgent=True, linger_s=0.0):
        self.role, self.urgent, self.in_bursts, self.in_blocks = role, urgent, False, False
        self.running, self.is_shut_down, self.starts_itself = True, False, True
        self.settings = SimpleNamespace(linger_s=linger_s)
        self.run_state = SimpleNamespace(is_over=False, has_failed=False)
        self.run = SimpleNamespace(housekeeping=self._look_after, break_off=self._break_off)
        self.log, self.work, self.turn, self.looked_after, self.served = log, set(work), 0, 0, 0
        self.errors = []

    def quick(self, looks):
        self.log.append(self.role)
        self.turn += 1
        if self.work and self.turn > max(self.work):
            self.end()
        for _ in range(0 if self.turn in self.work else looks - 1):
            os.sched_yield()  # between two looks
        return self.turn in self.work

    def end(self):
        self.running, self.run_state.is_over = False, True

    def serve_request(self):
        self.served += 1

    def _look_after(self, now_s):
        self.looked_after += 1

    def _break_off(self, error):
        self.errors.append(error)
        self.run_state.has_failed = True
        self.end()


@pytest.fixture
def log():
    return []


@pytest.fixture
def serve(clock, monkeypatch):
    """Serve nodes; every call of sched_yield takes a microsecond of the fake clock."""
    monkeypatch.setattr('os.sched_yield', lambda: clock.advance(1e-6))
    wake = threading.Event()
    monkeypatch.setattr(wake, 'wait', clock.advance)

    def run(*nodes, stop=None):
        serve_streams(nodes, stop or StopRequest(), wake)

    return run


def test_nodes_are_served_in_the_direction_of_flow(serve, log):
    roles = ('plant', 'trajectory', 'compensator', 'controller')
    serve(*[Node(role, log, [1, 2], urgent=role != 'trajectory') for role in roles])
    assert log[:3] == ['controller', 'compensator', 'plant']
    assert log.index('trajectory') > 3


def test_it_ends_when_every_run_is_over(serve, log, clock):
    node = Node('plant', log, [1, 5])
    serve(node)
    assert node.turn == 6
    assert clock.now_s < 101.0


def test_a_process_stays_as_long_as_its_nodes_linger(serve, log, clock):
    serve(Node('plant', log, [1], linger_s=3.0), Node('controller', log, [1], linger_s=1.0))
    assert 103.0 <= clock.now_s < 103.2


def test_after_a_failure_no_process_lingers(serve, log, clock):
    node = Node('plant', log, [1], linger_s=3.0)
    node.run_state.has_failed = True
    serve(node)
    assert clock.now_s < 101.0


def test_nodes_under_a_lifecycle_manager_stay_until_they_are_shut_down(serve, log, clock):
    node = Node('plant', log, [1])
    node.starts_itself = False
    clock.plan(50.0, lambda: setattr(node, 'is_shut_down', True))
    serve(node)
    assert 150.0 <= clock.now_s < 150.2


def test_a_signal_ends_it_within_a_turn(serve, log, clock):
    stop = StopRequest()
    nodes = [Node('controller', log), Node('plant', log)]
    nodes[0].quick = lambda looks: stop(15, None)
    serve(*nodes, stop=stop)
    assert log == []


def test_an_error_of_one_node_breaks_off_its_run_alone(serve, log):
    error = ValueError('wrong')

    def fail(looks):
        raise error

    failing, other = Node('controller', log), Node('plant', log, [1, 2, 3])
    failing.quick = fail
    serve(failing, other)
    assert failing.errors == [error]
    assert other.turn == 4


def test_so_does_an_error_of_what_looks_after_it(serve, log, clock):
    error = AssertionError('made up')

    def look_after(now_s):
        raise error

    failing, other = Node('controller', log, [10**9]), Node('plant', log, [10**9])
    failing.run.housekeeping = look_after
    clock.plan(10.0, other.end)
    serve(failing, other)
    assert failing.errors[0] is error
    assert other.errors == []
    assert clock.now_s >= 110.0


def test_whatever_ends_the_loop_ends_the_run_of_every_node(log, monkeypatch):
    def serve_streams(nodes, stop, wake):
        raise error

    def break_off(error):
        nodes[0]._break_off(error)
        raise RuntimeError('made up, at the end of a run')

    error = SystemError('made up')
    nodes = [Node('controller', log), Node('plant', log), Node('recorder', log)]
    nodes[0].run.break_off = break_off
    nodes[2].end()
    for node in nodes:
        node.starts_itself = False
    monkeypatch.setattr(host, 'serve_streams', serve_streams)
    with pytest.raises((SystemError, RuntimeError)):
        host._run(nodes, StopRequest(), threading.Event())
    assert [node.errors for node in nodes] == [[error], [error], []]


def test_requests_and_housekeeping_go_on_while_nothing_comes(serve, log, clock):
    node = Node('plant', log, [10**9])
    clock.plan(10.0, node.end)
    serve(node)
    assert 190 <= node.looked_after <= 202  # every 0.05 s
    assert node.served > 1000


def test_a_loop_without_input_sleeps(serve, log, clock):
    node = Node('plant', log, [10**9])
    clock.plan(10.0, node.end)
    serve(node)
    # In each look it yields often, but the looks are a millisecond apart.
    assert node.served < 11_000


def test_a_node_that_no_peer_waits_for_sleeps_ever_longer(serve, log, clock):
    node = Node('recorder', log, [10**9], urgent=False)
    clock.plan(10.0, node.end)
    serve(node)
    assert node.turn < 1100  # ten milliseconds apart in the end
