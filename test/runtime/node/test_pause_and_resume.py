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

"""Pause and resume by the lifecycle services, in any order, separate and composed."""

import itertools
import random

import pytest

NODES = ('compensator', 'controller', 'plant', 'trajectory')
OVER = ('finished', 'faulted', 'stopped')
SAMPLES = 1667  # of five periods of 300 Hz


@pytest.fixture
def managed(rig, peer):
    """Start a loop that another process leads, configured."""
    def start(composed, scheme):
        words = ['-p', 'autostart:=false', '-p', 'linger_s:=-1.0', '-p', 'periods:=5.0',
                 '-p', f'scheme:={scheme}', '-p', 'handshake_timeout_s:=60.0']
        processes = [
            rig.start_node(name, *words) for name in (('loop',) if composed else NODES)]
        for node in NODES:
            assert peer.change_state(node, 'configure')
        return processes

    return start


def _cycle(peer, orders):
    """Activate, pause at some moment of the run, resume, run to the end."""
    for transition in ('activate', 'deactivate'):
        for node in next(orders):
            assert peer.change_state(node, transition), peer.status(node)
    for node in NODES:
        peer.forget(node)
    for node in next(orders):
        assert peer.change_state(node, 'activate'), peer.status(node)
    for node in NODES:
        peer.wait(lambda node=node: peer.status(node).get('state') in OVER, f'the end: {node}')
    assert {node: (peer.status(node)['state'], peer.status(node)['reason'])
            for node in NODES} == dict.fromkeys(NODES, ('finished', ''))
    assert peer.status('plant')['index'] == SAMPLES + 1  # with the opening reading
    for node in next(orders):
        assert peer.change_state(node, 'deactivate')


def _cycles(peer, processes, number, seed):
    draw = random.Random(seed)
    orders = (draw.sample(NODES, len(NODES)) for _ in itertools.count())
    for _ in range(number):
        _cycle(peer, orders)
    for process in processes:
        assert process.exit_code is None
        assert 'Traceback' not in process.output


@pytest.mark.parametrize(('composed', 'scheme'), [
    (True, 'fbff'), (False, 'ff'), pytest.param(False, 'fb', marks=pytest.mark.slow)])
def test_a_paused_loop_resumes_with_a_whole_run(managed, peer, composed, scheme):
    _cycles(peer, managed(composed, scheme), 2, seed=composed)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('composed', [True, False])
@pytest.mark.parametrize('scheme', ['fbff', 'ff'])
def test_fifty_pauses_in_all_orders(managed, peer, composed, scheme):
    _cycles(peer, managed(composed, scheme), 50, seed=7)
