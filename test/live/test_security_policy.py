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
"""The SROS2 policy of docs/ names the topics and services that the running nodes have."""

import xml.etree.ElementTree as ElementTree

import pytest
from processes import ROOT

from piezo_ros.bag import STREAMS

NODES = ('recorder', 'compensator', 'controller', 'plant', 'trajectory')
# Only with parameters that are not the default.
OPTIONAL = {'clock', *(f'recorded/{stream}' for stream in STREAMS)}
POLICY = ElementTree.parse(ROOT / 'docs' / 'examples' / 'security' / 'policy.xml')


def allowed(name, tag, kind):
    """Return what the policy allows a node, names as they are written there."""
    (profile,) = POLICY.findall(f'./enclaves/enclave[@path="/piezo/{name}"]/profiles/profile')
    assert profile.get('node') == name
    return {
        entry.text for group in profile.findall(tag) if group.get(kind) == 'ALLOW'
        for entry in group}


def resolved(name, written, namespace):
    if written.startswith('/'):
        return written
    if written.startswith('~'):
        return f'{namespace}/{name}{written[1:]}'
    return f'{namespace}/{written}'


def test_only_one_enclave_may_write_each_stream():
    for stream in STREAMS:
        assert len([name for name in NODES if stream in allowed(name, 'topics', 'publish')]) == 1
    assert {path.get('path') for path in POLICY.findall('./enclaves/enclave')} == {
        f'/piezo/{name}' for name in NODES}


@pytest.mark.slow
def test_the_policy_is_what_the_running_nodes_need(rig, peer):
    rig.node('recorder', bag_directory=rig.directory / 'bag', parameters_timeout_s=60.0)
    rig.node('loop', compiled='false', realtime_factor=0.001, required_readers=2, periods=150.0,
             handshake_timeout_s=60.0)
    peer.wait(lambda: peer.status('plant').get('index', 0) > 10, 'samples')
    graph = peer.node
    questions = {
        ('topics', 'publish'): graph.get_publisher_names_and_types_by_node,
        ('topics', 'subscribe'): graph.get_subscriber_names_and_types_by_node,
        ('services', 'reply'): graph.get_service_names_and_types_by_node,
        ('services', 'request'): graph.get_client_names_and_types_by_node,
    }
    for name in NODES:
        for (tag, kind), ask in questions.items():
            needed = {
                resolved(name, written, rig.namespace)
                for written in allowed(name, tag, kind) - OPTIONAL}

            def difference(ask=ask, name=name, needed=needed):
                return needed ^ {entry for entry, _ in ask(name, rig.namespace)}

            peer.wait(lambda: not difference(), f'{kind} of {name}: {difference()}')
