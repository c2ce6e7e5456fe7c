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

"""Trials of the nodes in memory: each input of each gets messages that are no block of it."""

import random
import re
from collections import Counter
from types import MappingProxyType
from unittest.mock import patch

import numpy as np
from fake_node import activate, configure, fake_node
from fake_transport import PERIOD_S, FakeTransport
from message_mutations import MALFORMED, OUT_OF_ORDER, damaged_message
from std_msgs.msg import UInt64

from piezo_ros.bag import STREAMS, BagError, read
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.nodes import recorder as recorder_module
from piezo_ros.nodes.compensator import Compensator
from piezo_ros.nodes.controller import Controller
from piezo_ros.nodes.plant import Plant
from piezo_ros.nodes.recorder import Recorder
from piezo_ros.nodes.trajectory import Trajectory

__all__ = ['INPUTS', 'RingTrials']

PERIODS = 0.15
# Node and input.
INPUTS = (
    ('plant', 'voltage'), ('compensator', 'command'), ('controller', 'reference'),
    ('controller', 'feedforward'), ('controller', 'displacement'), ('trajectory', 'demand'),
    *(('recorder', stream) for stream in STREAMS))
MOST = 8  # damaged messages of a run
DEMANDS = (0, 1, 2**31, 2**53, 2**63, 2**64 - 1)
_EXCEPTION = re.compile(r'^\w*(Error|Exception|Interrupt): ')


class _NoPeerParameters:
    """No node tells its parameters."""

    parameters = MappingProxyType({})
    silent = owing = ()
    twins = MappingProxyType({})

    def __init__(self, *_arguments):
        pass

    def complete(self):
        return True


class RingTrials:
    """
    Trials by number, and what came out of them.

    Attributes
    ----------
    counts : Counter
        (input, outcome) to number of damaged messages: 'refused' or 'fault named'; of demands
        'run whole' or 'run ended'.
    failures : list of str
        What did not hold, by trial.

    """

    def __init__(self, directory, *, compiled=False):
        self._directory = directory
        self._compiled = compiled
        self.counts = Counter()
        self.failures = []
        run = simulate(
            RigParameters(), HysteresisParameters(), ControllerParameters(scheme='fbff'),
            TrajectoryParameters(periods=PERIODS))
        self._expected = {
            'reference': run.reference_um, 'feedforward': run.feedforward_um,
            'command': run.command_um, 'voltage': run.voltage_v,
            'displacement': run.displacement_um}

    def run(self, number):
        """Make one trial: a run of the loop, some damaged messages in one input."""
        role, stream = INPUTS[number % len(INPUTS)]
        with patch.object(recorder_module, 'PeerParameters', _NoPeerParameters):
            try:
                self._run(random.Random(number), role, stream, self._directory / f'bag_{number}')
            except Exception as error:
                self.failures.append(
                    f'trial {number}, {stream} of {role}: {type(error).__name__}: {error}')

    def _run(self, generator, role, stream, bag):
        compiled = self._compiled and generator.random() < 0.5
        self._transport = FakeTransport()
        self._nodes = {
            'recorder': fake_node(
                Recorder, self._transport, bag_directory=str(bag), parameters_timeout_s=0.0),
            'compensator': fake_node(Compensator, self._transport, compiled=compiled),
            'controller': fake_node(
                Controller, self._transport, compiled=compiled,
                lookahead_samples=generator.choice([5, 20, 1000])),
            'plant': fake_node(Plant, self._transport, compiled=compiled),
            'trajectory': fake_node(
                Trajectory, self._transport, periods=PERIODS, compiled=compiled,
                block_samples=generator.choice([1, 7]))}
        configure(*self._nodes.values())
        activate(*self._nodes.values())
        node = self._nodes[role]
        names, is_demand = [], stream == 'demand'
        subscription = (
            node._demand._own._subscription if is_demand else node.readers[stream].subscription)
        wanted = generator.randint(1, MOST)
        while node.running and len(names) < wanted:
            self._turn(generator.randint(1, 5))
            # What was consumed once is refused; before that, it may be the first block.
            if not node.running or (not is_demand and not node.readers[stream].received):
                continue
            if is_demand:
                names.append(generator.choice([*DEMANDS, generator.getrandbits(64)]))
                subscription.messages.append(UInt64(data=names[-1]))
                continue
            is_last = len(names) == wanted - 1
            names.append(generator.choice(
                [*OUT_OF_ORDER] if is_last and generator.random() < 0.3 else [*MALFORMED]))
            subscription.messages.append(damaged_message(generator, stream, PERIOD_S, names[-1]))
        idle = 0
        while idle < 2 * MOST:  # a message that is refused is no progress
            idle = 0 if self._turn(1) else idle + 1
        self._check(role, stream, names, bag)

    def _turn(self, times):
        """Let each node do what it can, as the stream loop does; return whether one did."""
        progress = False
        for _ in range(times):
            for node in self._nodes.values():
                if node.running:
                    try:
                        progress = node.quick(1) or progress
                    except Exception as error:
                        node.run.break_off(error)
        return progress

    def _check(self, role, stream, names, bag):
        node = self._nodes[role]
        running = [name for name, each in self._nodes.items() if each.running]
        results = {name: each.run_state.result for name, each in self._nodes.items()}
        # The recorder in memory has no writers to lose: it ends with the streams.
        assert not running, f'{names}: {running} go on, results {results}'
        for name, each in self._nodes.items():
            state = each.run_state
            assert not _EXCEPTION.match(state.reason), f'{names}: {name} ended by {state.reason}'
            assert state.result != 'faulted' or state.reason, f'{names}: {name} has no reason'
        assert self._nodes['plant'].status_fields()['voltage_v'] == 0.0, f'{names}: voltage'
        has_failed = node.run_state.has_failed
        cell = f'{stream} of {role}'
        if stream == 'demand':
            self.counts[cell, 'run ended' if 0 in names else 'run whole'] += len(names)
        else:
            subscription = node.readers[stream].subscription
            is_out_of_order = bool(names) and names[-1] in OUT_OF_ORDER
            refused = len(names) - is_out_of_order
            self.counts[cell, 'refused'] += refused
            self.counts[cell, 'fault named'] += is_out_of_order
            # Behind the end of the stream the last one is refused.
            assert is_out_of_order or not has_failed, (
                f'{names}: {results}, {node.run_state.reason}')
            if not is_out_of_order:
                # Behind its end a stream is not read any more.
                left = len(subscription.messages)
                counted = node.readers[stream].refused
                assert counted + left == refused, (
                    f'{names}: {counted} of {refused} counted as refused')
                assert not left or node.readers[stream].ended, f'{names}: {left} are not taken'
        is_whole = set(results.values()) == {'finished'}
        if not has_failed and stream != 'demand' and not (names and names[-1] in OUT_OF_ORDER):
            assert is_whole, f'{names}: {results}'
        self._check_bag(names, bag, is_whole=is_whole)

    def _check_bag(self, names, bag, *, is_whole):
        try:
            run = read(bag)
        except BagError as error:
            if is_whole or 'no sample' not in str(error):
                raise
            return
        for stream in run.streams:
            start, values = run.whole(stream)
            expected = self._expected[stream]
            assert start == 0, f'{names}: {stream} begins at {start}'
            assert np.array_equal(values, expected[:values.size]), f'{names}: wrong {stream}'
            assert not is_whole or values.size == expected.size, f'{names}: {stream} is short'
