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

"""Runs of a node against the contract of its topics: to the end, or to a fault that is provoked."""

from collections.abc import Callable, Mapping
from typing import Final

from piezo_ros.contract.checks import (
    check_answers,
    check_end,
    check_log,
    check_refusals,
    check_zero_voltage,
)
from piezo_ros.contract.driving import DrivenNode, RunOverError
from piezo_ros.contract.meeting import check_opening, check_silence, meet
from piezo_ros.contract.topics import MALFORMED

__all__ = ['FAULTS', 'SILENCE', 'broken_run', 'ordinary_run']

SILENCE: Final = 'silence ends the run'


def ordinary_run(node: DrivenNode, *, disturbed: bool) -> list[float]:
    """
    Check a run that comes to its end.

    Parameters
    ----------
    node : DrivenNode
        The node under check; it takes the findings.
    disturbed : bool
        Whether to send blocks in between that must be refused.

    Returns
    -------
    list of float
        The samples of the output.

    """
    try:
        _begin(node)
        check_answers(node)
        if disturbed:
            check_refusals(node)
        else:
            # The same samples, so that the two runs can be compared.
            for _ in MALFORMED:
                node.drive(1)
                node.await_answers()
        check_end(node)
    except RunOverError:
        pass
    check_log(node)
    return node.probe.log.samples


def broken_run(node: DrivenNode, what: str, break_it: Callable[[DrivenNode], object]) -> None:
    """
    Check that a run ends in order when something goes wrong with it.

    Parameters
    ----------
    node : DrivenNode
        The node under check; it takes the findings.
    what : str
        What is checked, as a finding says it.
    break_it : callable
        Makes it go wrong.

    """
    try:
        _begin(node)
        # The rest was told of in the ordinary run.
        node.findings = [finding for finding in node.findings if finding.right is False]
        node.drive(10)
        node.await_answers()
        answered = len(node.probe.log.samples)
        break_it(node)
        patience_s = node.settings.patience_s
        if what == SILENCE:
            patience_s += node.settings.watchdog_s
        node.probe.wait(lambda: node.probe.log.ended_at is not None, patience_s)
    except RunOverError:
        node.find(what, None, node.findings[-1].detail if node.findings else '')
        return
    log = node.probe.log
    if log.ended_at is None:
        node.find(what, False, (
            f'{node.output} has not ended within {patience_s:g} s; it must send N = 0'))
    elif len(log.samples) > answered:
        node.find(what, False, (
            f'{len(log.samples) - answered} samples were answered that came after the fault'))
    else:
        node.find(what, True, f'{node.output} ended with index {log.ended_at}')
    if node.role == 'plant':
        check_zero_voltage(node, f'{what}: voltage at zero')


def _begin(node: DrivenNode) -> None:
    """Meet the node and take what it opens with."""
    meet(node)
    if node.contract.opening:
        check_opening(node)
    else:
        check_silence(node)


def _leave_samples_out(node: DrivenNode) -> None:
    node.sent += 5
    node.drive(1)


def _change_the_period(node: DrivenNode) -> None:
    node.period_s *= 2.0
    node.drive(1)


def _add_a_writer(node: DrivenNode) -> None:
    node.probe.second_writer(node.contract.inputs[0])


def _remove_the_writer(node: DrivenNode) -> None:
    node.probe.close_writer(node.contract.inputs[0])


def _send_nothing(_node: DrivenNode) -> None:
    """Keep the writer, so that only a watchdog can end the run."""


# What breaks a run -> how to do it.
FAULTS: Final[Mapping[str, Callable[[DrivenNode], None]]] = {
    'a gap ends the run': _leave_samples_out,
    'another sample period ends the run': _change_the_period,
    'a second writer ends the run': _add_a_writer,
    'a lost writer ends the run': _remove_the_writer,
    SILENCE: _send_nothing,
}
