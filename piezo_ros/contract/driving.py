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
Drives a node under check: sends the next samples, waits for the answers that are due.

One `DrivenNode` is one run of the node, from the first sample to the end.
"""

import math
from collections.abc import Callable
from typing import Final

from piezo_ros.contract.probe import Probe, block_message
from piezo_ros.contract.topics import CONTRACTS, CheckSettings, Finding

__all__ = ['DrivenNode', 'RunOverError']

_SINE_SAMPLES: Final = 50  # samples per period of what the node is driven with


class RunOverError(Exception):
    """Nothing more can be checked in this run."""


class DrivenNode:
    """
    The node under check, seen by its peer during one run.

    Parameters
    ----------
    role : str
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
    sent : int
        Samples that every input has got.
    period_s : float
        Sample period of the run; NaN until the node has opened with a block of its own.

    """

    def __init__(
        self, role: str, probe: Probe, settings: CheckSettings,
        alive: Callable[[], str] = lambda: '',
    ) -> None:
        self.findings: list[Finding] = []
        self.role = role
        self.contract = CONTRACTS[role]
        self.probe = probe
        self.settings = settings
        self.alive = alive
        self.sent = 0
        self.period_s = settings.sample_period_s or math.nan

    def find(self, what: str, right: bool | None, detail: str = '') -> None:
        """Note one thing that was checked."""
        self.findings.append(Finding(what, right, detail))

    @property
    def output(self) -> str:
        """Full name of the topic that the node writes."""
        return self.probe.topic(self.contract.output)

    def settle(self, seconds: float) -> None:
        """Take what arrives for so long."""
        self.probe.wait(lambda: False, seconds)

    def drive(self, count: int) -> None:
        """Send the next samples on every input."""
        samples = [
            self.settings.amplitude * math.sin(2.0 * math.pi * (self.sent + k) / _SINE_SAMPLES)
            for k in range(count)]
        for stream in self.contract.inputs:
            self.probe.publish(
                stream, block_message(stream, self.sent, self.period_s, samples))
        self.sent += count

    @property
    def due(self) -> int:
        """Count of the samples that the node must have sent by now."""
        return self.sent + self.contract.opening

    def await_answers(self) -> str:
        """
        Return '' once exactly what is due has arrived, else what is wrong.

        Nothing is due before the end of a run that is sent ahead, but it must go on.
        """
        log = self.probe.log
        if self.settings.ahead:
            self.settle(0.0)
            if log.ended_at is None:
                return self.alive()
            return f'the run ended at sample {log.ended_at}{self._reason()}'
        self.probe.wait(
            lambda: len(log.samples) >= self.due or log.ended_at is not None
            or bool(self.alive()), self.settings.patience_s)
        self.settle(0.0)
        got = len(log.samples)
        if got == self.due:
            return ''
        if self.alive():
            return self.alive()
        if log.ended_at is not None:
            return f'the run ended at sample {log.ended_at}{self._reason()}'
        after = f'after {self.contract.inputs[-1]} up to sample {self.sent - 1}'
        if got < self.due:
            hint = ''
            if self.contract.opening == 0 and got == 0:
                hint = f'; does the node expect another sample period than {self.period_s!r} s?'
            elif any(status.get('device') for status in self.probe.statuses):
                hint = '; a plant that plays whole runs by the clock of a device needs --ahead'
            return (
                f'{after}, {got} samples of {self.output} have arrived within '
                f'{self.settings.patience_s:g} s, {self.due} are due{hint}')
        return f'{after}, {got} samples of {self.output} have arrived, {self.due} are due'

    def _reason(self) -> str:
        reasons = [status['reason'] for status in self.probe.statuses if status.get('reason')]
        return f': {reasons[-1]}' if reasons else ''
