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

"""Checks of a run that comes to its end: answers, refusals, the end, the status, all messages."""

from typing import Final

from rclpy.qos import DurabilityPolicy

from piezo_ros.contract.driving import DrivenNode, RunOverError
from piezo_ros.contract.probe import block_message
from piezo_ros.contract.topics import MALFORMED

__all__ = ['check_answers', 'check_end', 'check_log', 'check_refusals', 'check_zero_voltage']

_SETTLE_S: Final = 0.02  # how long an answer that should not be there gets
_QUIET_S: Final = 0.3
_GOING: Final = (None, 'inactive', 'active')  # states in a status before the run is over
_LENGTHS: Final = (2, 7, 100, 1)
_AHEAD: Final = 'u[k] answered by y[k+1], once the whole run is there'


def check_answers(node: DrivenNode) -> None:
    """Check that every sample is answered, alone and in blocks of any length."""
    if node.settings.ahead:
        _send_ahead(node)
        return
    what = {
        'plant': 'u[k] answered by y[k+1], sample by sample',
        'controller': 'v[k] as soon as y_d[k], u_ff[k] and y[k] are there',
    }.get(node.role, 'every sample answered by one')
    for _ in range(3):
        node.drive(1)
        problem = node.await_answers()
        node.settle(_SETTLE_S)
        problem = problem or node.await_answers()
        if problem:
            node.find(what, False, problem)
            raise RunOverError
    node.find(what, True)
    what = 'blocks of any length'
    for count in _LENGTHS:
        node.drive(count)
        problem = node.await_answers()
        if problem:
            node.find(what, False, f'a block of {count}: {problem}')
            raise RunOverError
    node.find(what, True)
    if node.role == 'controller':
        _check_demand(node)


def _send_ahead(node: DrivenNode) -> None:
    """Send the same samples, which are answered at the end; the run must go on meanwhile."""
    for count in (1, 1, 1, *_LENGTHS):
        node.drive(count)
        node.settle(_SETTLE_S)
        if problem := node.await_answers():
            node.find(_AHEAD, False, problem)
            raise RunOverError


def _check_demand(node: DrivenNode) -> None:
    topic = node.probe.topic('demand')
    problem = node.probe.problem_of_writers('demand')
    if problem:
        pass
    elif node.probe.writers('demand')[0].qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
        problem = f'the writer of {topic} is volatile; it must be transient_local'
    elif not node.probe.wait(
            lambda: node.probe.demanded > node.sent, node.settings.patience_s):
        problem = (
            f'{topic} is {node.probe.demanded}, and {node.sent} samples are consumed; it '
            'must lead them')
    node.find('demand ahead of what is consumed', not problem, problem)


def check_refusals(node: DrivenNode) -> None:
    """Send one block of each malformed kind; the next good one must be answered as ever."""
    for number, (kind, make) in enumerate(MALFORMED.items()):
        stream = node.contract.inputs[number % len(node.contract.inputs)]
        # Two samples: a node that takes them answers once too often.
        bad = make(block_message(
            stream, node.sent, node.period_s, [0.5 * node.settings.amplitude] * 2))
        node.probe.publish(stream, bad)
        node.settle(_SETTLE_S)
        ended = node.probe.log.ended_at is not None
        node.drive(1)
        problem = node.await_answers()
        node.settle(_SETTLE_S)
        problem = problem or node.await_answers()
        if problem:
            problem = (
                f'after one on {node.probe.topic(stream)} {problem}; it must be refused, and '
                'the run go on')
        node.find(f'refusal of {kind}', not problem, problem)
        if problem and (ended or node.probe.log.ended_at is not None or node.alive()):
            raise RunOverError
        if not node.settings.ahead:
            # What was taken by mistake shall not be counted against the next kind.
            node.sent += len(node.probe.log.samples) - node.due


def check_end(node: DrivenNode) -> None:
    """End the inputs; check the end of the output, the status, and the voltage of a plant."""
    probe, log, what = node.probe, node.probe.log, 'end of the stream passed on'
    ends = dict.fromkeys(node.contract.inputs, node.sent)
    if node.role == 'controller':
        # The displacement has one sample more, and ends only once the command has.
        probe.publish('displacement', block_message(
            'displacement', node.sent, node.period_s, [0.0]))
        ends['displacement'] += 1
    for stream, index in ends.items():
        if stream == 'displacement':
            probe.wait(lambda: log.ended_at is not None, node.settings.patience_s)
        probe.publish(stream, block_message(stream, index, node.period_s, []))
    probe.wait(lambda: log.ended_at is not None, node.settings.patience_s)
    node.settle(_QUIET_S)
    if node.settings.ahead:
        got = len(log.samples)
        node.find(_AHEAD, got == node.due, '' if got == node.due else (
            f'{got} samples of {node.output} have arrived, {node.due} are due'
            + ('; blocks that must be refused were taken' if got > node.due else '')))
    if log.ended_at is None:
        node.find(what, False, (
            f'no N = 0 on {node.output} within {node.settings.patience_s:g} s of that on '
            f'{probe.topic(node.contract.inputs[-1])}'))
    elif log.ended_at != node.due:
        node.find(what, False, (
            f'N = 0 has index {log.ended_at}; it must be the count of samples, {node.due}'))
    elif log.late:
        node.find(what, False, '; '.join(log.late[:3]))
    else:
        node.find(what, True)
    _check_status(node)
    if node.role == 'plant':
        check_zero_voltage(node, 'voltage at zero at the end')


def _check_status(node: DrivenNode) -> None:
    probe = node.probe
    told = probe.wait(
        lambda: bool(probe.statuses) and probe.statuses[-1].get('state') not in _GOING,
        node.settings.patience_s)
    topic, problem = probe.topic('status'), ''
    if not probe.statuses:
        problem = f'nothing arrived on {topic} (std_msgs/String, JSON, transient_local)'
    elif not all('node' in status and 'state' in status for status in probe.statuses):
        problem = f'a message on {topic} is no JSON object with node and state'
    elif not told:
        problem = f'{topic} still says {probe.statuses[-1]["state"]!r} after the end'
    node.find('status', not problem, problem)


def check_zero_voltage(node: DrivenNode, what: str) -> None:
    """Check that the status of a plant says that its voltage is zero."""
    probe = node.probe
    zero = probe.wait(
        lambda: bool(_voltages(node)) and _voltages(node)[-1] == 0.0,
        node.settings.patience_s)
    if zero:
        node.find(what, True)
    elif _voltages(node):
        node.find(what, False, (
            f'{probe.topic("status")} says voltage_v {_voltages(node)[-1]!r} after the end'))
    else:
        node.find(what, False, (
            f'no message on {probe.topic("status")} since the end has voltage_v: nothing '
            'tells that the voltage is at zero'))


def _voltages(node: DrivenNode) -> list[float]:
    """Return what was told of the voltage since the run was over."""
    return [
        status['voltage_v'] for status in node.probe.statuses
        if 'voltage_v' in status and status.get('state') not in _GOING]


def check_log(node: DrivenNode) -> None:
    """Tell what all messages of the run have shown."""
    log = node.probe.log
    if not log.heard:
        return
    node.find('layout of every block', not log.malformed, '; '.join(log.malformed[:3]))
    node.find('indices without gaps', not log.discontinuous, '; '.join(log.discontinuous[:3]))
    wanted = node.settings.sample_period_s
    problem = ''
    if len(log.periods_s) > 1:
        problem = f'it changed: {", ".join(map(repr, sorted(log.periods_s)))} s'
    elif wanted is not None and log.periods_s - {wanted}:
        problem = f'it is {min(log.periods_s)!r} s, expected {wanted!r} s'
    node.find('sample period', None if not log.periods_s else not problem, problem)
    several = len(node.probe.writers(node.contract.output)) > 1
    node.find(
        'only writer', not several,
        node.probe.problem_of_writers(node.contract.output) if several else '')
