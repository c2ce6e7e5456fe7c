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

import pytest

from piezo_ros.streams import STREAMS
from piezo_ros.streams.names import label_of, stream_with_label


def test_each_stream_has_a_label_of_its_own_with_its_unit():
    assert [stream_with_label(label_of(stream)) for stream in STREAMS] == list(STREAMS)
    assert label_of('voltage') == 'voltage_v'
    assert label_of('displacement') == 'displacement_um'


def test_other_names_and_labels_are_of_no_stream():
    assert stream_with_label('voltage_um') is None
    with pytest.raises(ValueError, match="'speed' is none of reference, "):
        label_of('speed')
