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

"""
Messages that are no block, or not the next one, as data: each a function that returns bytes.

They are made of a block of the stream that was consumed already, so that damage that leaves a block
of it is refused too. All of them are in `MALFORMED` and `OUT_OF_ORDER`, by name.
"""

import math
import struct

from piezo_ros.streams import STREAMS, BlockCodec

__all__ = ['MALFORMED', 'OUT_OF_ORDER', 'arrives_as_block', 'damaged_message']

ENCAPSULATIONS = (2, 3, 6, 7, 8, 9, 10, 11, 12, 128, 255)
_LENGTHS = (0, 2, 3, 255, 2**16, 2**31, 2**32 - 1)
_NOT_FINITE = (math.nan, math.inf, -math.inf)
_WRONG_INDICES = (-1.0, 0.5, -0.5, 2.0**53, 1e300, -1e300, *_NOT_FINITE)
_WRONG_PERIODS = (0.0, -1e-5, *_NOT_FINITE)


class _Old:
    """A block that was consumed already, and where its fields are."""

    def __init__(self, stream, period_s, samples):
        self.stream, self.period_s, self.samples = stream, period_s, samples
        self.codec = BlockCodec(stream)
        self.raw = self.block(0)
        self.data = len(self.raw) - 8 * (2 + len(samples))
        self.layout = self.raw.index(struct.pack('<4I', *2 * [len(samples)], 2, 2 + len(samples)))

    def block(self, index, *, period_s=None, samples=None):
        return self.codec.encode(
            index, self.period_s if period_s is None else period_s,
            self.samples if samples is None else samples)

    def with_bytes(self, place, new):
        return self.raw[:place] + new + self.raw[place + len(new):]

    def with_length(self, place, generator):
        wrong = generator.choice([*_LENGTHS, generator.getrandbits(32)])
        new = struct.pack('<I', wrong)
        # Of one sample, 1 and 3 may be right.
        return self.with_bytes(place, new) if self.raw[place:place + 4] != new else b'\0'


def _not_finite_sample(generator, old):
    samples = [*old.samples]
    samples[generator.randrange(len(samples))] = generator.choice(_NOT_FINITE)
    return old.block(0, samples=samples)


def _label(generator, old):
    length = old.layout - 12
    return old.with_bytes(12, b'\xff' + generator.randbytes(generator.randint(0, length - 5)))


def _other_stream(generator, old):
    other = generator.choice([stream for stream in STREAMS if stream != old.stream])
    return BlockCodec(other).encode(generator.choice([0, 5000]), old.period_s, old.samples)


def _flipped_head(generator, old):
    raw = old.raw
    for _ in range(generator.randint(1, 4)):
        place = generator.randrange(old.data)
        raw = raw[:place] + generator.randbytes(1) + raw[place + 1:]
    return raw


MALFORMED = {
    'no bytes': lambda generator, old: b'',
    'zero bytes': lambda generator, old: bytes(generator.randint(1, 200)),
    'bytes of ones': lambda generator, old: b'\xff' * generator.randint(1, 200),
    'random bytes': lambda generator, old: generator.randbytes(generator.randint(1, 200)),
    'random bytes behind a right head':
        lambda generator, old: old.raw[:4] + generator.randbytes(generator.randint(0, 200)),
    'large random message': lambda generator, old: generator.randbytes(1_000_000),
    'cut': lambda generator, old: old.raw[:generator.randrange(1, len(old.raw))],
    'flipped bytes ahead of the numbers': _flipped_head,
    'other encapsulation': lambda generator, old: old.with_bytes(
        0, bytes([0, generator.choice(ENCAPSULATIONS)])),
    'big-endian head': lambda generator, old: old.with_bytes(0, b'\0\0'),
    'wrong number of dimensions': lambda generator, old: old.with_length(4, generator),
    'wrong length of the label': lambda generator, old: old.with_length(8, generator),
    'wrong label': _label,
    'label of another stream': _other_stream,
    'wrong size': lambda generator, old: old.with_length(old.layout, generator),
    'wrong stride': lambda generator, old: old.with_length(old.layout + 4, generator),
    'wrong offset': lambda generator, old: old.with_length(old.layout + 8, generator),
    'wrong length of data': lambda generator, old: old.with_length(old.layout + 12, generator),
    'sample that is not finite': _not_finite_sample,
    'wrong index': lambda generator, old: old.block(generator.choice(_WRONG_INDICES)),
    'wrong period': lambda generator, old: old.block(
        0, period_s=generator.choice(_WRONG_PERIODS)),
    'consumed already': lambda generator, old: old.raw,
    'end of another run': lambda generator, old: old.block(0, samples=[]),
}
# These end the run of a reader, which names what is wrong.
OUT_OF_ORDER = {
    'index ahead': lambda generator, old: old.block(generator.randrange(10_000, 2**53 - 1)),
    'end ahead': lambda generator, old: old.block(
        generator.randrange(10_000, 2**53 - 1), samples=[]),
    'other period': lambda generator, old: old.block(
        10_000, period_s=old.period_s * generator.choice([1 + 1e-15, 2.0, 1e-300, 1e300])),
}


def damaged_message(generator, stream, period_s, name):
    """Return the bytes of a message with some damage."""
    samples = [generator.gauss(0.0, 1.0) for _ in range(generator.choice([1, 1, 2, 7]))]
    return {**MALFORMED, **OUT_OF_ORDER}[name](generator, _Old(stream, period_s, samples))


def arrives_as_block(stream, message):
    """Return whether the message is a block once the middleware has padded it to whole words."""
    try:
        BlockCodec(stream).decode(message.ljust(-(-len(message) // 4) * 4, b'\0'))
    except ValueError:
        return False
    return True
