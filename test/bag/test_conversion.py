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

"""Bags through the converter of another library and back: nothing is lost on the way."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from piezo_ros.bag import STREAMS, read

CONVERT = Path(sys.executable).with_name('rosbags-convert')


def convert(source, destination, storage):
    subprocess.run(
        [CONVERT, '--src', source, '--dst', destination, '--dst-storage', storage],
        check=True, capture_output=True)
    return destination


@pytest.mark.parametrize('through', [['mcap'], ['sqlite3', 'mcap']])
@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_a_converted_bag_holds_the_same_run(tmp_path, write_run, through, compression):
    write_run(tmp_path / 'bag', compression=compression)
    bag = tmp_path / 'bag'
    for number, storage in enumerate(through):
        bag = convert(bag, tmp_path / f'bag_{number}', storage)
    ours, theirs = read(tmp_path / 'bag'), read(bag)
    assert theirs.sample_period_s == ours.sample_period_s
    for stream in STREAMS:
        start, samples = theirs.whole(stream)
        assert start == 0
        np.testing.assert_array_equal(samples, ours.whole(stream)[1])


def test_the_quality_of_service_survives(tmp_path, write_run):
    write_run(tmp_path / 'bag')
    convert(tmp_path / 'bag', tmp_path / 'converted', 'mcap')

    def offered(bag):
        body = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
        return {
            topic['topic_metadata']['name']: {
                name: topic['topic_metadata']['offered_qos_profiles'][0][name]
                for name in ('history', 'reliability', 'durability')}
            for topic in body['topics_with_message_count']}

    assert offered(tmp_path / 'converted') == offered(tmp_path / 'bag')
