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

"""Checks of a node before its first sample: endpoints, quality of service, what it opens with."""

import math
from typing import Any, Final

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from piezo_ros.contract.driving import DrivenNode, RunOverError
from piezo_ros.contract.probe import wait_for
from piezo_ros.runtime.streams.writer_names import names_of_endpoints

__all__ = ['check_opening', 'check_silence', 'meet']

_TYPE: Final = 'std_msgs/msg/Float64MultiArray'
_QUIET_S: Final = 0.3  # how long a node gets for messages that should not be there


def meet(node: DrivenNode) -> None:
    """Find the endpoints of the node, check them, and connect to them."""
    contract, probe = node.contract, node.probe
    what = f'one writer of {contract.output}, a reader of {" and ".join(contract.inputs)}'
    wait_for(
        lambda: bool(node.alive()) or (bool(probe.writers(contract.output)) and all(
            map(probe.readers, contract.inputs))),
        node.settings.discovery_s)
    # A second writer would end a run that is going on.
    node.settle(node.settings.look_around_s)
    problem = node.alive() or _missing(node)
    if problem:
        node.find(what, False, problem)
        raise RunOverError
    writer = probe.writers(contract.output)[0]
    _check_qos(node, writer)
    probe.open(
        contract.inputs,
        reliable=writer.qos_profile.reliability == ReliabilityPolicy.RELIABLE)
    if node.role == 'controller':
        probe.read_demand()
    met = probe.wait(
        lambda: bool(node.alive()) or probe.connected(), node.settings.discovery_s)
    problem = node.alive() or ('' if met else 'their endpoints do not match; see the quality '
                                'of service')
    node.find(what, not problem, problem)
    if problem:
        raise RunOverError


def _missing(node: DrivenNode) -> str:
    """Return what is wrong with the endpoints of the node, '' for nothing."""
    contract, probe = node.contract, node.probe
    problem = probe.problem_of_writers(contract.output)
    if problem:
        return problem
    for stream in contract.inputs:
        others = probe.writers(stream)
        if others:
            return (
                f'{probe.topic(stream)} has a writer already, {names_of_endpoints(others)}; check '
                'a node that runs alone')
        readers = probe.readers(stream)
        if not readers:
            return f'{probe.topic(stream)} has no reader'
        for endpoint in readers:
            if endpoint.topic_type != _TYPE:
                return f'{probe.topic(stream)} is read as {endpoint.topic_type}, not {_TYPE}'
    writer = probe.writers(contract.output)[0]
    if writer.topic_type != _TYPE:
        return f'{node.output} is written as {writer.topic_type}, not {_TYPE}'
    return ''


def _check_qos(node: DrivenNode, writer: Any) -> None:
    problems = []
    if writer.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
        problems.append(
            f'the writer of {node.output} is best effort: samples may be lost, and no '
            'reliable reader gets any; it must be reliable')
    for stream in node.contract.inputs:
        topic = node.probe.topic(stream)
        for reader in node.probe.readers(stream):
            if reader.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
                problems.append(
                    f'the reader of {topic} is best effort: samples may be lost; it must be '
                    'reliable')
            if reader.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
                problems.append(
                    f'the reader of {topic} asks for transient_local, which no stream offers; '
                    'it must be volatile')
    node.find('quality of service', not problems, '; '.join(problems))


def check_opening(node: DrivenNode) -> None:
    """Check that the first measurement comes alone, before any voltage."""
    probe, what = node.probe, 'y[0] alone before any voltage'
    came = probe.wait(lambda: bool(
        probe.log.samples or probe.log.malformed or node.alive()), node.settings.discovery_s)
    node.settle(_QUIET_S)
    log = probe.log
    if node.alive():
        node.find(what, False, node.alive())
    elif not came:
        node.find(what, False, _missing(node) or (
            f'nothing arrived on {node.output} within {node.settings.discovery_s:g} s'))
    elif not log.samples:
        node.find(what, False, 'what arrived is no block')
    elif len(log.samples) > 1 or log.first_index != 0:
        node.find(what, False, (
            f'{len(log.samples)} samples arrived from index {log.first_index}; it must be one, '
            'with index 0'))
    else:
        node.find(what, True)
    if not log.samples:
        raise RunOverError
    if math.isnan(node.period_s):
        node.period_s = min(log.periods_s)


def check_silence(node: DrivenNode) -> None:
    """Check that nothing comes before the first input."""
    node.settle(_QUIET_S)
    log = node.probe.log
    sent = len(log.samples) + len(log.malformed)
    node.find(
        f'no {node.contract.output} before the first {node.contract.inputs[0]}', not sent,
        f'{sent} blocks arrived before anything was sent' if sent else '')
