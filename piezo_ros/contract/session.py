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

"""Checks of a node that runs already, and of a command that starts one: afresh for every fault."""

import os
import signal
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final

from piezo_ros.contract.contract_runs import FAULTS, SILENCE, broken_run, ordinary_run
from piezo_ros.contract.driving import DrivenNode
from piezo_ros.contract.probe import Probe, wait_for
from piezo_ros.contract.topics import CONTRACTS, CheckSettings, Finding

__all__ = ['StartedNode', 'check_command', 'check_running', 'compared']

_GRACE_S: Final = 10.0  # for a node that was asked to end
_LAST_LINES: Final = 3
_NOT_THERE: Final = 'nothing to compare: '


def check_running(role: str, namespace: str, settings: CheckSettings) -> list[Finding]:
    """
    Check a node that runs, in one run that comes to its end.

    Parameters
    ----------
    role : str
        plant, compensator or controller.
    namespace : str
        Namespace of the node.
    settings : CheckSettings
        How to check.

    """
    probe = Probe(namespace, CONTRACTS[role].output)
    try:
        node = DrivenNode(role, probe, settings)
        ordinary_run(node, disturbed=True)
        return node.findings
    finally:
        probe.close()


def check_command(
    role: str, command: Sequence[str], settings: CheckSettings,
    progress: Callable[[str], None] = lambda what: None,
) -> list[Finding]:
    """
    Check the node that a command starts: an ordinary run, and one for every fault.

    Parameters
    ----------
    role : str
        plant, compensator or controller.
    command : sequence of str
        The command; ``--ros-args -r __ns:=…`` is appended, a namespace of its own for every start.
    settings : CheckSettings
        How to check.
    progress : callable
        Is told what is checked next.

    """
    progress('an ordinary run with blocks that must be refused')
    with StartedNode(role, command, settings) as started:
        disturbed = ordinary_run(started.node, disturbed=True)
    findings = started.node.findings
    if not any(finding.what == 'end of the stream passed on' for finding in findings):
        return findings  # It has not come through one run: the others would say the same.
    undisturbed = []
    for number in (1, 2):
        progress(f'undisturbed run {number} of 2')
        with StartedNode(role, command, settings) as started:
            undisturbed.append(ordinary_run(started.node, disturbed=False))
    findings.append(compared(disturbed, undisturbed))
    for what, break_it in FAULTS.items():
        if what == SILENCE and role != 'plant':
            continue
        progress(what)
        with StartedNode(role, command, settings) as started:
            broken_run(started.node, what, break_it)
        findings += started.node.findings
    progress('SIGINT')
    findings += _interrupted(role, command, settings)
    return findings


def compared(disturbed: list[float], undisturbed: list[list[float]]) -> Finding:
    """Return whether a run with refused blocks gave what two runs without them gave."""
    what = 'state left alone by what was refused'
    first, second = undisturbed
    if not first or first != second:
        return Finding(what, None, f'{_NOT_THERE}two undisturbed runs differ')
    if len(disturbed) != len(first):
        return Finding(what, None, f'{_NOT_THERE}the runs have {len(disturbed)} and {len(first)} '
                       'samples')
    for index, (sample, expected) in enumerate(zip(disturbed, first, strict=True)):
        if sample != expected:
            return Finding(
                what, False, f'sample {index} is {sample!r}, without refused blocks {expected!r}')
    return Finding(what, True, f'{len(first)} samples are the same')


def _begin_a_group() -> None:
    """Let a Ctrl-C reach what is started through this process alone, as SIGINT."""
    # Not a session: Linux shares the processor among these, and the node would yield in vain.
    os.setpgid(0, 0)
    # A shell lets what it starts behind its back ignore SIGINT, and that would be inherited.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _interrupted(role: str, command: Sequence[str], settings: CheckSettings) -> list[Finding]:
    with StartedNode(role, command, settings) as started:
        broken_run(
            started.node, 'SIGINT ends the run', lambda _: started.send(signal.SIGINT))
        ended = wait_for(lambda: not started.runs(), _GRACE_S)
    return [*started.node.findings, Finding(
        'SIGINT ends the process', ended, '' if ended else
        f'it is still there {_GRACE_S:g} s later')]


class StartedNode:
    """A process of the node under check and its peer, in a namespace of their own."""

    _count = 0

    def __init__(self, role: str, command: Sequence[str], settings: CheckSettings) -> None:
        StartedNode._count += 1
        self._namespace = f'/piezo_check_{os.getpid()}/run_{StartedNode._count}'
        self._command = [*command, '--ros-args', '-r', f'__ns:={self._namespace}']
        self._role = role
        self._settings = settings

    def __enter__(self) -> 'StartedNode':
        """Start both."""
        # The command and what it says; gone with the file.
        self._output = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.DEVNULL, stdout=self._output,
            stderr=subprocess.STDOUT, preexec_fn=_begin_a_group)
        try:
            self._probe = Probe(self._namespace, CONTRACTS[self._role].output)
        except BaseException:
            self._end()
            raise
        self.node = DrivenNode(
            self._role, self._probe, self._settings, self._how_it_ended)
        return self

    def __exit__(
        self, exception_type: type[BaseException] | None, exception: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End both."""
        self._probe.close()
        self._end()

    def _end(self) -> None:
        for number, grace_s in ((signal.SIGINT, _GRACE_S), (signal.SIGKILL, _GRACE_S)):
            self.send(number)
            if wait_for(lambda: not self.runs(), grace_s):
                break
        self._output.close()

    def runs(self) -> bool:
        """Return whether the process is there."""
        return self._process.poll() is None

    def send(self, number: int) -> None:
        """Send a signal to the process and what it has started, as a terminal does."""
        if self.runs():
            os.killpg(self._process.pid, number)

    def _how_it_ended(self) -> str:
        if self.runs():
            return ''
        self._output.seek(0)
        lines = self._output.read().decode(errors='replace').strip().splitlines()
        said = ' / '.join(lines[-_LAST_LINES:]) or 'nothing'
        return f'the command ended with exit code {self._process.returncode}; it wrote: {said}'
