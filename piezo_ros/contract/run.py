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
Checks of a node that runs against the contract of its topics: answers, refusals, the end, faults.

One `ContractRun` is one run of the node under check, from the first sample to the end or to the
fault that the check provokes.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from piezo_ros.contract.probe import Probe, block_message, wait_for
from piezo_ros.contract.topics import CONTRACTS, MALFORMED, CheckSettings, Finding

__all__ = ['FAULTS', 'SILENCE', 'ContractRun']

_TYPE: Final = 'std_msgs/msg/Float64MultiArray'
_SETTLE_S: Final = 0.02  # how long an answer that should not be there gets
_QUIET_S: Final = 0.3
_SINE_SAMPLES: Final = 50  # samples per period of what the node is driven with
_GOING: Final = (None, 'inactive', 'active')  # states in a status before the run is over
_LENGTHS: Final = (2, 7, 100, 1)


class _Over(Exception):
    """Nothing more can be checked in this run."""


class ContractRun:
    """
    One run of a node under check.

    Parameters
    ----------
    stage : str
        One of `CONTRACTS`.
    probe : Probe
        Its peer.
    settings : CheckSettings
        How to check.
    alive : callable
        Returns '' while the node may be there, else how it ended.

    Attributes
    ----------
    findings : list of Finding
        What was found so far.

    """

    def __init__(
        self, stage: str, probe: Probe, settings: CheckSettings,
        alive: Callable[[], str] = lambda: '',
    ) -> None:
        self.findings: list[Finding] = []
        self._stage = stage
        self._contract = CONTRACTS[stage]
        self._probe = probe
        self._settings = settings
        self._alive = alive
        self._sent = 0
        self._period_s = settings.sample_period_s or math.nan

    # -- whole runs -------------------------------------------------------------------------------

    def ordinary(self, *, disturbed: bool) -> list[float]:
        """
        Check a run that comes to its end.

        Parameters
        ----------
        disturbed : bool
            Whether to send blocks in between that must be refused.

        Returns
        -------
        list of float
            The samples of the output.

        """
        try:
            self._begin()
            self._check_answers()
            if disturbed:
                self._check_refusals()
            else:
                # The same samples, so that the two runs can be compared.
                for _ in MALFORMED:
                    self._drive(1)
                    self._await_answers()
            self._check_end()
        except _Over:
            pass
        self._check_log()
        return self._probe.log.samples

    def broken(self, what: str, break_it: Callable[['ContractRun'], None]) -> None:
        """Check that a run ends in order when something goes wrong with it."""
        try:
            self._begin(tell=False)
            self._drive(10)
            self._await_answers()
            answered = len(self._probe.log.samples)
            break_it(self)
            patience_s = self._settings.patience_s
            if what == SILENCE:
                patience_s += self._settings.watchdog_s
            self._probe.wait(lambda: self._probe.log.ended_at is not None, patience_s)
        except _Over:
            self._find(what, None, self.findings[-1].detail if self.findings else '')
            return
        log = self._probe.log
        if log.ended_at is None:
            self._find(what, False, (
                f'{self._output} has not ended within {patience_s:g} s; it must send N = 0'))
        elif len(log.samples) > answered:
            self._find(what, False, (
                f'{len(log.samples) - answered} samples were answered that came after the fault'))
        else:
            self._find(what, True, f'{self._output} ended with index {log.ended_at}')
        if self._stage == 'plant':
            self._check_zero_voltage(f'{what}: voltage at zero')

    def break_gap(self) -> None:
        """Leave samples out."""
        self._sent += 5
        self._drive(1)

    def break_period(self) -> None:
        """Change the sample period."""
        self._period_s *= 2.0
        self._drive(1)

    def break_second_writer(self) -> None:
        """Become two."""
        self._probe.second_writer(self._contract.inputs[0])

    def break_lost_writer(self) -> None:
        """Leave without a word."""
        self._probe.close_writer(self._contract.inputs[0])

    def break_silence(self) -> None:
        """Stay, and say nothing."""

    # -- steps ------------------------------------------------------------------------------------

    def _find(self, what: str, right: bool | None, detail: str = '') -> None:
        self.findings.append(Finding(what, right, detail))

    @property
    def _output(self) -> str:
        return self._probe.topic(self._contract.output)

    def _begin(self, *, tell: bool = True) -> None:
        """Meet the node and take what it opens with."""
        self._meet()
        if self._contract.opening:
            self._check_opening()
        else:
            self._check_silence()
        if not tell:
            # Told of in the ordinary run.
            self.findings = [finding for finding in self.findings if finding.right is False]

    def _meet(self) -> None:
        contract, probe = self._contract, self._probe
        what = f'one writer of {contract.output}, a reader of {" and ".join(contract.inputs)}'
        wait_for(
            lambda: bool(self._alive()) or (bool(probe.writers(contract.output)) and all(
                map(probe.readers, contract.inputs))),
            self._settings.discovery_s)
        # A second writer would end a run that is going on.
        self._settle(self._settings.look_around_s)
        problem = self._alive() or self._missing()
        if problem:
            self._find(what, False, problem)
            raise _Over
        writer = probe.writers(contract.output)[0]
        self._check_qos(writer)
        probe.open(
            contract.inputs,
            reliable=writer.qos_profile.reliability == ReliabilityPolicy.RELIABLE)
        if self._stage == 'controller':
            probe.read_demand()
        met = probe.wait(
            lambda: bool(self._alive()) or probe.connected(), self._settings.discovery_s)
        problem = self._alive() or ('' if met else 'their endpoints do not match; see the quality '
                                    'of service')
        self._find(what, not problem, problem)
        if problem:
            raise _Over

    def _missing(self) -> str:
        """Return what is wrong with the endpoints of the node, '' for nothing."""
        contract, probe = self._contract, self._probe
        writers = probe.writers(contract.output)
        if len(writers) != 1:
            return _counted(len(writers), 'writer', self._output, writers)
        for stream in contract.inputs:
            others = probe.writers(stream)
            if others:
                return (
                    f'{probe.topic(stream)} has a writer already, {_names(others)}; check a node '
                    'that runs alone')
            readers = probe.readers(stream)
            if not readers:
                return f'nobody reads {probe.topic(stream)}'
            for endpoint in readers:
                if endpoint.topic_type != _TYPE:
                    return f'{probe.topic(stream)} is read as {endpoint.topic_type}, not {_TYPE}'
        if writers[0].topic_type != _TYPE:
            return f'{self._output} is written as {writers[0].topic_type}, not {_TYPE}'
        return ''

    def _check_qos(self, writer: Any) -> None:
        problems = []
        if writer.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
            problems.append(
                f'the writer of {self._output} is best effort: samples may be lost, and no '
                'reliable reader gets any; it must be reliable')
        for stream in self._contract.inputs:
            topic = self._probe.topic(stream)
            for reader in self._probe.readers(stream):
                if reader.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
                    problems.append(
                        f'the reader of {topic} is best effort: samples may be lost; it must be '
                        'reliable')
                if reader.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                    problems.append(
                        f'the reader of {topic} asks for transient_local, which no stream offers; '
                        'it must be volatile')
        self._find('quality of service', not problems, '; '.join(problems))

    def _check_opening(self) -> None:
        probe, what = self._probe, 'y[0] alone before any voltage'
        came = probe.wait(lambda: bool(
            probe.log.samples or probe.log.malformed or self._alive()), self._settings.discovery_s)
        self._settle(_QUIET_S)
        log = probe.log
        if self._alive():
            self._find(what, False, self._alive())
        elif not came:
            self._find(what, False, self._missing() or (
                f'nothing arrived on {self._output} within {self._settings.discovery_s:g} s'))
        elif not log.samples:
            self._find(what, False, 'what arrived is no block')
        elif len(log.samples) > 1 or log.first_index != 0:
            self._find(what, False, (
                f'{len(log.samples)} samples arrived from index {log.first_index}; it must be one, '
                'with index 0'))
        else:
            self._find(what, True)
        if not log.samples:
            raise _Over
        if math.isnan(self._period_s):
            self._period_s = min(log.periods_s)

    def _check_silence(self) -> None:
        self._settle(_QUIET_S)
        log = self._probe.log
        sent = len(log.samples) + len(log.malformed)
        self._find(
            f'no {self._contract.output} before the first {self._contract.inputs[0]}', not sent,
            f'{sent} blocks arrived before anything was sent' if sent else '')

    def _settle(self, seconds: float) -> None:
        self._probe.wait(lambda: False, seconds)

    def _drive(self, count: int) -> None:
        """Send the next samples on every input."""
        samples = [
            self._settings.amplitude * math.sin(2.0 * math.pi * (self._sent + k) / _SINE_SAMPLES)
            for k in range(count)]
        for stream in self._contract.inputs:
            self._probe.publish(
                stream, block_message(stream, self._sent, self._period_s, samples))
        self._sent += count

    @property
    def _due(self) -> int:
        return self._sent + self._contract.opening

    def _await_answers(self) -> str:
        """Return '' once exactly what is due has arrived, else what is wrong."""
        log = self._probe.log
        self._probe.wait(
            lambda: len(log.samples) >= self._due or log.ended_at is not None
            or bool(self._alive()), self._settings.patience_s)
        self._settle(0.0)
        got = len(log.samples)
        if got == self._due:
            return ''
        if self._alive():
            return self._alive()
        if log.ended_at is not None:
            return f'the run ended at sample {log.ended_at}{self._reason()}'
        after = f'after {self._contract.inputs[-1]} up to sample {self._sent - 1}'
        if got < self._due:
            hint = ''
            if self._contract.opening == 0 and got == 0:
                hint = f'; does the node expect another sample period than {self._period_s!r} s?'
            return (
                f'{after}, {got} samples of {self._output} have arrived within '
                f'{self._settings.patience_s:g} s, {self._due} are due{hint}')
        return f'{after}, {got} samples of {self._output} have arrived, {self._due} are due'

    def _reason(self) -> str:
        reasons = [status['reason'] for status in self._probe.statuses if status.get('reason')]
        return f': {reasons[-1]}' if reasons else ''

    def _check_answers(self) -> None:
        what = {
            'plant': 'u[k] answered by y[k+1], sample by sample',
            'controller': 'v[k] as soon as y_d[k], u_ff[k] and y[k] are there',
        }.get(self._stage, 'every sample answered by one')
        for _ in range(3):
            self._drive(1)
            problem = self._await_answers()
            self._settle(_SETTLE_S)
            problem = problem or self._await_answers()
            if problem:
                self._find(what, False, problem)
                raise _Over
        self._find(what, True)
        what = 'blocks of any length'
        for count in _LENGTHS:
            self._drive(count)
            problem = self._await_answers()
            if problem:
                self._find(what, False, f'a block of {count}: {problem}')
                raise _Over
        self._find(what, True)
        if self._stage == 'controller':
            self._check_demand()

    def _check_demand(self) -> None:
        topic = self._probe.topic('demand')
        writers = self._probe.writers('demand')
        problem = ''
        if len(writers) != 1:
            problem = _counted(len(writers), 'writer', topic, writers)
        elif writers[0].qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            problem = f'the writer of {topic} is volatile; it must be transient_local'
        elif not self._probe.wait(
                lambda: self._probe.demanded > self._sent, self._settings.patience_s):
            problem = (
                f'{topic} is {self._probe.demanded}, and {self._sent} samples are consumed; it '
                'must lead them')
        self._find('demand ahead of what is consumed', not problem, problem)

    def _check_refusals(self) -> None:
        """Send one block of each malformed kind; the next good one must be answered as ever."""
        for number, (kind, make) in enumerate(MALFORMED.items()):
            stream = self._contract.inputs[number % len(self._contract.inputs)]
            # Two samples: a node that takes them answers once too often.
            bad = make(block_message(
                stream, self._sent, self._period_s, [0.5 * self._settings.amplitude] * 2))
            self._probe.publish(stream, bad)
            self._settle(_SETTLE_S)
            ended = self._probe.log.ended_at is not None
            self._drive(1)
            problem = self._await_answers()
            self._settle(_SETTLE_S)
            problem = problem or self._await_answers()
            if problem:
                problem = (
                    f'after one on {self._probe.topic(stream)} {problem}; it must be refused, and '
                    'the run go on')
            self._find(f'refusal of {kind}', not problem, problem)
            if problem and (ended or self._probe.log.ended_at is not None or self._alive()):
                raise _Over
            # What was taken by mistake shall not be counted against the next kind.
            self._sent += len(self._probe.log.samples) - self._due

    def _check_end(self) -> None:
        probe, log, what = self._probe, self._probe.log, 'end of the stream passed on'
        ends = dict.fromkeys(self._contract.inputs, self._sent)
        if self._stage == 'controller':
            # The displacement has one sample more, and ends only once the command has.
            probe.publish('displacement', block_message(
                'displacement', self._sent, self._period_s, [0.0]))
            ends['displacement'] += 1
        for stream, index in ends.items():
            if stream == 'displacement':
                probe.wait(lambda: log.ended_at is not None, self._settings.patience_s)
            probe.publish(stream, block_message(stream, index, self._period_s, []))
        probe.wait(lambda: log.ended_at is not None, self._settings.patience_s)
        self._settle(_QUIET_S)
        if log.ended_at is None:
            self._find(what, False, (
                f'no N = 0 on {self._output} within {self._settings.patience_s:g} s of that on '
                f'{probe.topic(self._contract.inputs[-1])}'))
        elif log.ended_at != self._due:
            self._find(what, False, (
                f'N = 0 has index {log.ended_at}; it must be the count of samples, {self._due}'))
        elif log.late:
            self._find(what, False, '; '.join(log.late[:3]))
        else:
            self._find(what, True)
        self._check_status()
        if self._stage == 'plant':
            self._check_zero_voltage('voltage at zero at the end')

    def _check_status(self) -> None:
        probe = self._probe
        told = probe.wait(
            lambda: bool(probe.statuses) and probe.statuses[-1].get('state') not in _GOING,
            self._settings.patience_s)
        topic, problem = probe.topic('status'), ''
        if not probe.statuses:
            problem = f'nothing arrived on {topic} (std_msgs/String, JSON, transient_local)'
        elif not all('node' in status and 'state' in status for status in probe.statuses):
            problem = f'a message on {topic} is no JSON object with node and state'
        elif not told:
            problem = f'{topic} still says {probe.statuses[-1]["state"]!r} after the end'
        self._find('status', not problem, problem)

    def _check_zero_voltage(self, what: str) -> None:
        probe = self._probe
        zero = probe.wait(
            lambda: bool(self._voltages()) and self._voltages()[-1] == 0.0,
            self._settings.patience_s)
        if zero:
            self._find(what, True)
        elif self._voltages():
            self._find(what, False, (
                f'{probe.topic("status")} says voltage_v {self._voltages()[-1]!r} after the end'))
        else:
            self._find(what, False, (
                f'no message on {probe.topic("status")} since the end has voltage_v: nobody can '
                'know that the voltage is at zero'))

    def _voltages(self) -> list[float]:
        """Return what was told of the voltage since the run was over."""
        return [
            status['voltage_v'] for status in self._probe.statuses
            if 'voltage_v' in status and status.get('state') not in _GOING]

    def _check_log(self) -> None:
        """Tell what all messages of the run have shown."""
        log = self._probe.log
        if not log.heard:
            return
        self._find('layout of every block', not log.malformed, '; '.join(log.malformed[:3]))
        self._find('indices without gaps', not log.discontinuous, '; '.join(log.discontinuous[:3]))
        wanted = self._settings.sample_period_s
        problem = ''
        if len(log.periods_s) > 1:
            problem = f'it changed: {", ".join(map(repr, sorted(log.periods_s)))} s'
        elif wanted is not None and log.periods_s - {wanted}:
            problem = f'it is {min(log.periods_s)!r} s, expected {wanted!r} s'
        self._find('sample period', None if not log.periods_s else not problem, problem)
        writers = self._probe.writers(self._contract.output)
        several = len(writers) > 1
        self._find(
            'only writer', not several,
            _counted(len(writers), 'writer', self._output, writers) if several else '')


def _counted(count: int, what: str, topic: str, endpoints: list[Any]) -> str:
    if not count:
        return f'{topic} has no {what}, exactly one is needed'
    return f'{topic} has {count} {what}s, exactly one is needed: {_names(endpoints)}'


def _names(endpoints: list[Any]) -> str:
    return ', '.join(
        f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}' for endpoint in endpoints)


SILENCE: Final = 'silence ends the run'
# What breaks a run -> how to do it.
FAULTS: Final[Mapping[str, Callable[[ContractRun], None]]] = {
    'a gap ends the run': ContractRun.break_gap,
    'another sample period ends the run': ContractRun.break_period,
    'a second writer ends the run': ContractRun.break_second_writer,
    'a lost writer ends the run': ContractRun.break_lost_writer,
    SILENCE: ContractRun.break_silence,
}
