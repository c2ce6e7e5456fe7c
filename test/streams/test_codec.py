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

import numpy as np
import pytest

from piezo_ros.streams import STREAMS, BlockCodec, MalformedBlockError


@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize('count', [0, 1, 2, 1000])
def test_what_goes_in_comes_out(stream, count):
    codec = BlockCodec(stream)
    samples = np.random.default_rng(count).normal(size=count)
    block = codec.decode(codec.encode(12345, 1e-5, samples))
    assert block.index == 12345
    assert block.sample_period_s == 1e-5
    assert block.samples == tuple(samples)


@pytest.mark.parametrize('stream', STREAMS)
@pytest.mark.parametrize('count', [0, 1, 1000])
def test_the_header_precedes_the_numbers_and_its_mask_covers_what_matters(stream, count):
    codec = BlockCodec(stream)
    raw = codec.encode(5, 1e-5, np.ones(count))
    header, mask = codec.header(count)
    assert raw[:len(header)] == header
    assert len(raw) == len(header) + 8 * (count + 2)
    assert set(mask) == {0, 0xFF}
    for place, bits in enumerate(mask):
        changed = bytearray(raw)
        changed[place] ^= 0x55
        if bits == 0:
            assert codec.decode(bytes(changed)).index == 5
        else:
            with pytest.raises(MalformedBlockError):
                codec.decode(bytes(changed))


@pytest.mark.parametrize('count', [0, 1, 1000])
def test_index_and_period_are_those_of_the_whole_block(count):
    raw = BlockCodec('voltage').encode(5, 1e-5, np.ones(count))
    assert BlockCodec('voltage').index_and_period(raw) == (5, 1e-5)
    with pytest.raises(MalformedBlockError, match='voltage_v'):
        BlockCodec('command').index_and_period(raw)


def test_one_sample_is_encoded_the_same_on_both_paths():
    codec = BlockCodec('voltage')
    assert codec.encode_one(7, 1e-5, -1.25) == codec.encode(7, 1e-5, [-1.25])


@pytest.mark.parametrize('stream', STREAMS)
def test_bytes_are_those_of_an_independent_serializer(stream):
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_JAZZY)
    dimension = store.types['std_msgs/msg/MultiArrayDimension']
    layout = store.types['std_msgs/msg/MultiArrayLayout']
    message = store.types['std_msgs/msg/Float64MultiArray']
    codec = BlockCodec(stream)
    for count in (0, 1, 3):
        samples = np.arange(count, dtype=float) / 3
        typed = message(
            layout=layout(
                dim=[dimension(label=codec.label, size=count, stride=count)], data_offset=2),
            data=np.concatenate(([5.0, 1e-5], samples)))
        raw = bytes(store.serialize_cdr(typed, 'std_msgs/msg/Float64MultiArray'))
        assert codec.encode(5, 1e-5, samples) == raw
        assert codec.decode(raw).samples == tuple(samples)


def test_garbage_in_the_padding_does_not_matter():
    codec = BlockCodec('voltage')
    raw = bytearray(codec.encode_one(3, 1e-5, 0.5))
    raw[12 + len('voltage_v') + 1] = 0xAB
    assert codec.decode(bytes(raw)).samples == (0.5,)


@pytest.mark.parametrize('count', [1, 3])
@pytest.mark.parametrize(('index', 'period', 'bad', 'words'), [
    (0, 1e-5, np.nan, 'nan'),
    (0, 1e-5, np.inf, 'inf'),
    (0.5, 1e-5, 0.0, 'index'),
    (-1, 1e-5, 0.0, 'index'),
    (2.0**53, 1e-5, 0.0, 'index'),
    (np.nan, 1e-5, 0.0, 'index'),
    (0, 0.0, 0.0, 'sample period'),
    (0, np.nan, 0.0, 'sample period'),
    (0, np.inf, 0.0, 'sample period'),
])
def test_bad_numbers_are_refused_by_name(count, index, period, bad, words):
    codec = BlockCodec('reference')
    samples = np.zeros(count)
    samples[-1] = bad
    with pytest.raises(MalformedBlockError, match=words):
        codec.decode(codec.encode(index, period, samples))


def test_another_stream_is_refused_by_name():
    raw = BlockCodec('voltage').encode_one(0, 1e-5, 0.0)
    with pytest.raises(MalformedBlockError, match='voltage_v.*displacement_um'):
        BlockCodec('displacement').decode(raw)


def test_a_cut_message_is_refused():
    codec = BlockCodec('voltage')
    raw = codec.encode(0, 1e-5, np.zeros(5))
    for length in range(len(raw)):
        with pytest.raises(MalformedBlockError):
            codec.decode(raw[:length])
