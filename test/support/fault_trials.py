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

"""One trial of the failure matrix: a run of `piezo run`, a fault, and what must hold behind it."""

import contextlib
import os
import random
import resource
import signal
import time

import numpy as np
from fault_matrix import FILE_SIZE, FOREIGN, FOREIGN_STATUS, SIGNALS, SUPERVISOR
from message_mutations import MALFORMED, arrives_as_block, damaged_message
from processes import wait_until, was_cut_off_while_starting
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String, UInt64

from piezo_ros.bag import STREAMS, BagError, open_recording, read
from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.experiment.plan.plan_file import read_plan

__all__ = ['FaultTrial']

PERIOD_S = 1e-5
SHORT_PERIODS = 3
LONG_PERIODS = {'separate': 300, 'composed': 30_000}
STOPPED_S = 3.0
LATEST_END_S = 3.0  # a run that goes on after the fault is ended by then, at any moment
# The handshake of a run waits for a minute, of the time that the processes had.
END_S = 300.0
STAY_S = 3.0  # a foreign writer that keeps a run from its begin leaves then
FILE_BYTES = 100_000
TEXTS = ('not json', '[1]', '{"a": 1}', '{"node": "plant", "index": "seven"}', '[' * 3000)
MESSAGES = 50
COMPARED_PERIODS = 50
# The first are too large for a busy machine and not delivered by Fast DDS; the others may be the
# first block of a run, as a message may that lacks no more than what the middleware pads.
NOT_LIVE = (
    'large random message', 'no bytes', 'consumed already', 'end of another run',
    'flipped bytes ahead of the numbers', 'other encapsulation')
_simulations = {}  # by number of periods


class FaultTrial:
    """
    Trial of one cell.

    Parameters
    ----------
    cell : Cell
        What is done.
    rig : Rig
        Where; its processes are gone afterwards.
    make_peer, write_plan : callable
        The fixtures.
    number : int
        Seed of the moment and of damaged messages.

    """

    def __init__(self, cell, rig, make_peer, write_plan, number):
        self.cell, self.rig = cell, rig
        self._make_peer, self._write_plan = make_peer, write_plan
        self._generator = random.Random(number)
        self._is_interrupted = False

    def run(self):
        """Return the outcome: how the command ended."""
        is_long = self.cell.moment == 'run'
        self._periods = LONG_PERIODS[self.cell.mode] if is_long else SHORT_PERIODS
        plan = self._write_plan('fbff', periods=self._periods)
        is_foreign = self.cell.fault in (*FOREIGN, FOREIGN_STATUS)
        peer = self._make_peer(self.rig) if is_foreign else None
        self.command = self.rig.piezo(
            'run', plan, '-o', self.rig.directory / 'out', f'--{self.cell.mode}')
        self._await_moment()
        was_running = self.command.exit_code is None
        if was_running:
            self._do(peer)
        if is_long and was_running:
            self._end_if_it_goes_on()
        code = self.command.wait(END_S)
        self._check(code)
        return 'whole run' if code == 0 else f'exit code {code}'

    def _await_moment(self):
        command, bag = self.command, self.rig.bag
        if self.cell.moment == 'start':
            place = self.cell.place
            if place != SUPERVISOR and self.cell.fault in (*SIGNALS, FILE_SIZE):
                wait_until(
                    lambda: command.exit_code is not None or place in self.rig.nodes(place),
                    f'the process of {place}', END_S)
            time.sleep(self._generator.uniform(0.0, 2.0))
        elif self.cell.moment == 'run':
            wait_until(
                lambda: command.exit_code is not None or any(
                    file.stat().st_size > 30_000 for file in bag.glob('*.mcap')),
                'the first samples on the disk', END_S)
        else:
            wait_until(
                lambda: command.exit_code is not None or any(bag.glob('*.mcap')), 'the bag', END_S)
            time.sleep(self._generator.uniform(0.0, 0.5))

    def _do(self, peer):
        """Do the fault."""
        fault = self.cell.fault
        if fault in SIGNALS:
            self._send(SIGNALS[fault])
        elif fault == FILE_SIZE:
            for process in self.rig.nodes('recorder').values():
                resource.prlimit(process, resource.RLIMIT_FSIZE, (FILE_BYTES, FILE_BYTES))
        else:
            self._publish(peer)

    def _send(self, number):
        if self.cell.place == SUPERVISOR:
            processes = [self.command.pid]
        else:
            processes = [*self.rig.nodes(self.cell.place).values()]
        for process in processes:
            try:
                os.kill(process, number)
                if number == signal.SIGSTOP:
                    time.sleep(STOPPED_S)
                    os.kill(process, signal.SIGCONT)
            except ProcessLookupError:
                pass

    def _publish(self, peer):
        """Publish what no node of the run does."""
        topic, reliable = self.cell.place, ReliabilityPolicy.RELIABLE
        latched = QoSProfile(
            depth=1, reliability=reliable, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        volatile = QoSProfile(depth=1000, reliability=reliable)
        message_type, qos = {
            'status': (String, latched), 'demand': (UInt64, latched),
        }.get(topic, (Float64MultiArray, volatile))
        writer = peer.node.create_publisher(message_type, topic, qos)
        deadline = time.monotonic() + 1.0
        while not writer.get_subscription_count() and time.monotonic() < deadline:
            time.sleep(0.01)
        # A reader that does not take, for its run is over, makes a publisher fail.
        with contextlib.suppress(RuntimeError):
            for message in self._messages(topic):
                writer.publish(message)
        if self.cell.moment == 'start':
            time.sleep(STAY_S)
            peer.node.destroy_publisher(writer)

    def _messages(self, topic):
        generator = self._generator
        if topic == 'status':
            return [String(data=text) for text in TEXTS]
        if self.cell.fault == 'second writer':
            return []
        if topic == 'demand':
            if self.cell.fault == 'not finite':
                return [UInt64(data=generator.getrandbits(64)) for _ in range(MESSAGES)]
            return [
                generator.randbytes(generator.choice([1, 3, 4, 8, 11, 40]))
                for _ in range(MESSAGES)]
        names = [
            name for name in MALFORMED if name not in NOT_LIVE]
        if self.cell.fault == 'not finite':
            names = ['sample that is not finite']
        messages = [
            damaged_message(generator, topic, PERIOD_S, generator.choice(names))
            for _ in range(MESSAGES)]
        return [message for message in messages if not arrives_as_block(topic, message)]

    def _end_if_it_goes_on(self):
        deadline = time.monotonic() + self._generator.uniform(0.0, LATEST_END_S)
        while self.command.exit_code is None and time.monotonic() < deadline:
            time.sleep(0.05)
        if self.command.exit_code is None:
            self.command.send(signal.SIGINT)
            self._is_interrupted = True

    def _check(self, code):
        """Assert what must hold, whatever was done."""
        output = self.command.output
        assert 'Traceback' not in output or was_cut_off_while_starting(output), output
        if self._is_killed('SIGKILL'):
            assert code == -signal.SIGKILL, output
            wait_until(lambda: not self.rig.nodes(), 'every node to end')
        else:
            # Python itself ends by a signal that comes before the first line of the command.
            early = [-SIGNALS[self.cell.fault]] if self._is_killed('SIG') else []
            early += [-signal.SIGINT] if self._is_interrupted else []  # nor after its last one
            assert code in (0, 1, *early), f'{code}: {output}'
            assert not self.rig.nodes(), f'processes are left: {output}'
        for log in (self.rig.directory / 'out' / 'logs').rglob('*.log'):
            text = log.read_text(errors='replace')
            assert 'Traceback' not in text or was_cut_off_while_starting(text), text
        samples = self._check_bag(output, code)
        if code == 1 and samples:
            told = ('the voltage deviation is 0 V', 'the voltage is unknown')
            assert any(words in output for words in told), f'no word of the voltage: {output}'

    def _is_killed(self, fault):
        return self.cell.place == SUPERVISOR and self.cell.fault.startswith(fault)

    def _check_bag(self, output, code):
        """Assert that what was recorded has the bits of the offline run; return its length."""
        bag = self.rig.bag
        if not bag.exists():
            assert code != 0, output
            return 0
        try:
            run = read(bag, allow_loss=True)
        except BagError as error:
            nothing = ('has no sample', 'no *.mcap', 'has no stream')
            if code == 0 or not any(words in str(error) for words in nothing):
                raise AssertionError(f'{error}: {output}') from error
            return 0
        expected = self._simulated()
        for stream in run.streams:
            start, values = run.whole(stream)
            assert start == 0, f'{stream} begins at {start}: {output}'
            size = min(values.size, expected[stream].size)
            assert np.array_equal(values[:size], expected[stream][:size]), f'wrong {stream}'
        if code == 0:
            recording = open_recording(bag)
            assert not recording.lost, recording.lost
            assert not recording.uneven(), recording.uneven()
            assert run.streams == tuple(STREAMS)
            assert run.samples == expected['voltage'].size, run.samples
        return run.samples

    def _simulated(self):
        """Return what is compared: all of a short run, the first periods of a long one."""
        periods = min(self._periods, COMPARED_PERIODS)
        if periods not in _simulations:
            planned = read_plan(self._write_plan('fbff', periods=periods)).runs[0]
            _simulations[periods] = simulated_streams(planned)
        return _simulations[periods]
