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

"""What a node executable answers to words that it does not know, before anything starts."""

import subprocess
import sys

import pytest

pytest.importorskip('rclpy')
from piezo_ros.nodes.usage import answer_usage


@pytest.mark.parametrize(('words', 'told'), [
    ('frequency_hz:=500', [
        "unknown argument 'frequency_hz:=500'", '--ros-args -p frequency_hz:=500']),
    ('fast', ["unknown argument 'fast'", '--ros-args -p linger_s:=5.0']),
    ('--ros-args frequency_hz:=500', [
        "unknown argument 'frequency_hz:=500' behind --ros-args, did you mean -p frequency_hz:=5"]),
    ('--ros-args -p frequency_hz=500', [
        '-p frequency_hz=500 assigns nothing, it must be -p NAME:=VALUE']),
    ('--ros-args -r plant', ['-r plant assigns nothing, it must be -r NAME:=VALUE']),
    ('--ros-args -p periods:=3.0 fast', ["unknown argument 'fast' behind --ros-args"]),
])
def test_words_that_would_be_ignored_are_refused(capsys, words, told):
    assert answer_usage(['trajectory'], ['trajectory', *words.split()]) == 2
    error = capsys.readouterr().err
    for fragment in ['trajectory: ', *told, '`trajectory --help` lists']:
        assert fragment in error


@pytest.mark.parametrize('words', [
    '', '--ros-args -p periods:=3.0 --params-file x.yaml -r __ns:=/a -r __node:=b',
    '--ros-args --log-level debug --disable-rosout-logs -p frequency_hz:=5.0 --',
    '--ros-args --log-level trajectory:=debug -e /lab', '--ros-args -p offset_um:=-1.0'])
def test_words_that_ros_takes_are_left_to_it(capsys, words):
    assert answer_usage(['trajectory'], ['trajectory', *words.split()]) is None
    assert capsys.readouterr().err == ''


@pytest.mark.slow
def test_help_may_be_cut_off():
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_ros.nodes.executables', 'plant', '--help'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == b''
    assert process.wait() == 0


@pytest.mark.parametrize(('words', 'said'), [
    (['plnat'], "'plnat' is no executable of this module; there are plant, hardware_plant,"),
    (['plnat'], "did you mean 'plant'?"),
    (['learner'], "'learner' is no executable of this module"),
    (['usage', '--help'], "'usage' is no executable of this module"),
    ([], "'' is no executable of this module"),
])
def test_an_executable_that_is_none_is_refused(words, said):
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_ros.nodes.executables', *words], capture_output=True,
        text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
