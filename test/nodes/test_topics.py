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

"""What is seen of a running rig: the topics and services that documents and layouts name."""

import re
import signal
from pathlib import Path

from piezo_ros.bag import STREAMS

TOPICS_PAGE = (Path(__file__).parents[2] / 'docs' / 'topics.md').read_text(encoding='utf-8')
FLOAT = 'std_msgs/msg/Float64'


def test_a_rig_has_the_topics_and_services_of_its_page(rig, peer):
    rig.node('loop', realtime_factor=0.001, compiled='false', publish_clock='true')
    expected = {
        f'{rig.namespace}/{stream}': 'std_msgs/msg/Float64MultiArray' for stream in STREAMS}
    expected |= {f'{rig.namespace}/monitor/{stream}': FLOAT for stream in STREAMS}
    others = r'^\| `(demand|status|clock|/diagnostics)` \| `([\w/]+)` \|'
    for name, message_type in re.findall(others, TOPICS_PAGE, re.MULTILINE):
        expected[name if name.startswith('/') else f'{rig.namespace}/{name}'] = message_type
    assert len(expected) == 2 * len(STREAMS) + 4

    def there():
        topics = dict(peer.node.get_topic_names_and_types())
        return all(topics.get(name) == [kind] for name, kind in expected.items())

    peer.wait(there, f'the topics {sorted(expected)}')
    services = re.findall(
        r'^\| `~/(\w+)` \| `([\w/]+)` \| ([\w ]+) \|', TOPICS_PAGE, re.MULTILINE)
    assert {name for name, _, _ in services} == {'reset', 'stop', 'initialise'}

    def served():
        found = dict(peer.node.get_service_names_and_types())
        return all(
            found.get(f'{rig.namespace}/{node}/{name}') == [kind]
            for name, kind, of in services
            for node in (['plant'] if of == 'plant' else [
                'plant', 'controller', 'compensator', 'trajectory']))

    peer.wait(served, f'the services {services}')


def test_ctrl_c_on_a_launched_rig_ends_every_node_at_zero_volts(rig, peer, launched):
    """A terminal sends SIGINT to all of them at once, and launch sends it again."""
    nodes = launched(namespace=rig.namespace, periods='3000.0')
    assert [*nodes] == ['compensator', 'controller', 'plant', 'trajectory']
    peer.wait(
        lambda: peer.status('plant').get('index', 0) > 100
        and peer.status('plant')['voltage_v'] != 0.0, 'a voltage')
    for _ in range(2):
        for process in nodes.values():
            process.send(signal.SIGINT)
    # On a busy machine the voltage may end before the plant hears of the signal itself.
    peer.wait(
        lambda: peer.status('plant')['state'] in ('stopped', 'finished')
        and peer.status('plant')['voltage_v'] == 0.0, 'the end at zero volts')
    for process in nodes.values():
        assert process.wait() in (0, 1), process.output
        assert 'Traceback' not in process.output
