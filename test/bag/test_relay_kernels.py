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

"""Compiled answers from message to message: the same as decode, step, encode; else nothing."""

import numpy as np
import pytest

from piezo_ros.bag.relay_kernels import relay_controller, relay_inverse, relay_rig
from piezo_ros.control.controller import (
    ControllerParameters,
    controller_constants,
    controller_step,
    initial_state,
)
from piezo_ros.control.stepping import PackedController
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.model.compiled import Operands
from piezo_ros.model.stepping import compensator_stepper, packed_memory, rig_stepper
from piezo_ros.streams import BlockCodec

PERIOD_S = 1e-5
COUNT = 300
VALUES = np.random.default_rng(1).normal(size=COUNT).cumsum() * 0.05


class Wire:
    """What goes in and out of a relay kernel."""

    def __init__(self, inward, outward):
        self.inward, self.outward = BlockCodec(inward), BlockCodec(outward)
        self.message = bytearray(self.outward.encode_one(0, PERIOD_S, 0.0))
        self.recent = np.zeros(7)
        self.asked, self.answered = np.zeros(1, np.int64), np.zeros(1, np.int64)
        self.templates = (
            np.frombuffer(self.inward.encode_one(0, PERIOD_S, 0.0), np.uint8),
            np.frombuffer(self.message, np.uint8), self.recent, self.asked, self.answered)

    def relay(self, kernel, operands, raw, index, answer_index):
        """Return whether the kernel has answered; it counts on for what it answers, else not."""
        held = Operands(*operands, *self.templates)
        self.asked[0], self.answered[0] = index, answer_index
        answers = kernel(held.places, raw)
        assert (self.asked[0], self.answered[0]) == (index + answers, answer_index + answers)
        return answers

    def ask(self, value, index):
        return self.inward.encode_one(index, PERIOD_S, value)

    def answer(self):
        block = self.outward.decode(bytes(self.message))
        assert block.sample_period_s == PERIOD_S
        return block.index, block.samples[0]


def test_voltages_are_those_of_the_python_step():
    python = compensator_stepper(HysteresisParameters())
    memory = packed_memory(compensator_stepper(HysteresisParameters(), compiled=True))
    wire = Wire('command', 'voltage')
    for index, value in enumerate(VALUES.tolist()):
        assert wire.relay(
            relay_inverse, [memory], wire.ask(value, index), index, index + 5)
        assert wire.answer() == (index + 5, python(value))
        assert wire.recent[(index + 5) % 7] == wire.answer()[1]


@pytest.mark.parametrize('creeps', [False, True])
def test_readings_are_those_of_the_python_step(creeps):
    rig = RigParameters(creep_per_decade=0.02 if creeps else 0.0)
    python = rig_stepper(rig, PERIOD_S)
    memory = packed_memory(rig_stepper(rig, PERIOD_S, compiled=True))
    noise = np.random.default_rng(2).normal(size=COUNT)
    wire, held_v = Wire('voltage', 'displacement'), np.zeros(1)
    operands = [memory, held_v, int(creeps), 1, noise]
    for index, value in enumerate(VALUES.tolist()):
        assert wire.relay(relay_rig, operands, wire.ask(value, index), index, index + 1)
        assert wire.answer() == (index + 1, python(value, noise[index]))
        assert held_v[0] == value
    # No noise is left.
    assert not wire.relay(relay_rig, operands, wire.ask(0.0, COUNT), COUNT, COUNT + 1)


@pytest.mark.parametrize('scheme', ['fb', 'fbff'])
def test_commands_are_those_of_the_python_step(scheme):
    law = ControllerParameters(scheme=scheme, measurement_delay_samples=2)
    constants, state = controller_constants(law, PERIOD_S), initial_state(law)
    packed = PackedController(law)
    packed.use(constants)
    reference_um, feedforward_um = VALUES[::-1].copy(), VALUES ** 2
    wire = Wire('displacement', 'command')
    first = 40
    for k, value in enumerate(VALUES.tolist()):
        at = first + k
        assert wire.relay(
            relay_controller, [packed.packed, first, first, reference_um, feedforward_um],
            wire.ask(value, at), at, at)
        assert wire.answer() == (at, controller_step(
            state, constants, k, reference_um[k], feedforward_um[k], value))
    assert packed.state.memory.tolist() == state.memory
    assert packed.state.measured_um.tolist() == state.measured_um


def _changed(raw, place):
    changed = bytearray(raw)
    changed[place] ^= 0x41
    return bytes(changed)


def test_whatever_is_not_simply_the_next_sample_changes_nothing():
    memory = packed_memory(compensator_stepper(HysteresisParameters(), compiled=True))
    wire = Wire('command', 'voltage')
    good = wire.ask(0.5, 3)
    others = [
        b'', good[:-1], good + b'\0', wire.ask(0.5, 2), wire.ask(0.5, 4), wire.ask(np.nan, 3),
        wire.ask(np.inf, 3), wire.ask(-np.inf, 3), wire.inward.encode(3, PERIOD_S, []),
        wire.inward.encode(3, PERIOD_S, [0.5, 0.5]), wire.inward.encode_one(3, 2e-5, 0.5),
        BlockCodec('voltage').encode_one(3, PERIOD_S, 0.5),
        *(_changed(good, place) for place in range(len(good) - 8))]
    before = memory.copy(), bytes(wire.message), wire.recent.copy()
    for raw in others:
        assert not wire.relay(relay_inverse, [memory], raw, 3, 3)
    assert np.array_equal(memory, before[0])
    assert bytes(wire.message) == before[1]
    assert np.array_equal(wire.recent, before[2])
    assert wire.relay(relay_inverse, [memory], good, 3, 3)


@pytest.mark.parametrize('wrong', [
    np.zeros((2, 2)), np.zeros(8)[::2], np.zeros(3, np.float32), np.zeros(3, np.int32)])
def test_arrays_that_a_kernel_would_misread_are_refused(wrong):
    with pytest.raises(ValueError, match='allowed are contiguous one-dimensional'):
        Operands(1, wrong)
