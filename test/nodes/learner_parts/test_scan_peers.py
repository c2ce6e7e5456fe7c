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

"""What a learner asks of the nodes of a scan: an answer belongs to what was asked."""

from types import SimpleNamespace

import pytest

from piezo_ros.control.tables.table_changes import TableChange
from piezo_ros.nodes.learner_parts.scan_peers import ScanPeers


class Client:
    """The parameters of the trajectory; the answers come when the test gives them."""

    def __init__(self):
        self.callbacks = []

    def services_are_ready(self):
        return True

    def set_parameters_atomically(self, parameters, callback):
        self.callbacks.append(callback)

    def answer(self, reason=''):
        result = SimpleNamespace(successful=not reason, reason=reason)
        self.callbacks.pop(0)(SimpleNamespace(result=lambda: SimpleNamespace(result=result)))


@pytest.fixture
def client():
    return Client()


@pytest.fixture
def peers(transport, client):
    transport.writer('reference', transport.owner('trajectory'))
    return ScanPeers(transport.owner('learner'), lambda name: client)


def test_a_second_answer_for_one_change_is_none_for_the_next(peers, client, clock):
    first, second = TableChange(100, 'first.csv'), TableChange(900, 'second.csv')
    peers.change_file(first)
    clock.advance(1.1)
    peers.change_file(first)  # once more: the answer may be lost
    client.answer()
    assert peers.refusal == ''
    peers.forget_change()
    client.answer()
    assert peers.refusal is None
    peers.change_file(second)
    assert peers.refusal is None
    client.answer('apply_at_sample is 900; the next sample is 950 already')
    assert peers.refusal == 'apply_at_sample is 900; the next sample is 950 already'


def test_it_asks_once_a_second_until_the_answer_comes(peers, client, clock):
    change = TableChange(100, 'first.csv')
    clock.run(2.05, lambda: peers.change_file(change))
    assert len(client.callbacks) == 2
    client.answer()
    client.answer()
    assert peers.refusal == ''
