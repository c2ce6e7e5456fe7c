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
"""The five terminals of the README work as printed (B9)."""

import re

from processes import ROOT

from piezo_ros.bag import read


def test_b9_the_five_terminals_of_the_readme_record_a_whole_run(rig, assert_whole):
    text = (ROOT / 'README.md').read_text(encoding='utf-8').replace('\\\n', ' ')
    lines = re.findall(r'^    \.venv/bin/(\w+) +(--ros-args .*)$', text, re.MULTILINE)
    names = [name for name, _ in lines]
    assert names == ['recorder', 'compensator', 'controller', 'plant', 'trajectory']
    terminals = {}
    for name, words in lines:
        arguments = words.replace('config/', f'{ROOT}/config/').replace(
            'my_scan', str(rig.directory / 'my_scan')).split()
        # A busy machine starts five interpreters slowly.
        terminals[name] = rig.start_node(
            name, *arguments[1:], '-p', 'handshake_timeout_s:=60.0', terminal=True)
    for name, terminal in terminals.items():
        assert terminal.wait() == 0, (name, terminal.output)
    run = read(rig.directory / 'my_scan')
    assert_whole(run)
    assert not run.lost
    assert len(run.parameters) == 4
    assert run.metadata['frequency_hz'] == '500.0'
