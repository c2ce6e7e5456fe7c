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

"""A peer that is no node of this project: plain rclpy, typed messages."""

import collections
import json
import time

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from piezo_ros.runtime.process.middleware import without_shared_memory

UNITS = {
    'reference': 'um', 'feedforward': 'um', 'command': 'um', 'voltage': 'v', 'displacement': 'um'}
PERIOD_S = 1e-5
ANSWER_S = 20.0
ATTEMPTS = 4
TARGETS = {
    'configure': 'inactive', 'activate': 'active', 'deactivate': 'inactive',
    'cleanup': 'unconfigured', 'shutdown': 'finalized'}


def typed_block(stream, index, samples, period_s=PERIOD_S):
    """Return a block as any user would write it."""
    message = Float64MultiArray()
    message.layout.dim = [MultiArrayDimension(
        label=f'{stream}_{UNITS[stream]}', size=len(samples), stride=len(samples))]
    message.layout.data_offset = 2
    message.data = [float(index), period_s, *(float(sample) for sample in samples)]
    return message


class Peer:
    """A foreign node in the domain and namespace of a rig."""

    def __init__(self, rig, until):
        self._context = Context()
        # Shared memory that killed processes have left would keep it from hearing the nodes.
        with without_shared_memory():
            rclpy.init(
                args=[], context=self._context, domain_id=rig.domain,
                signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node('foreign', namespace=rig.namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._until = until
        self._status = {}
        self.reports = collections.Counter()  # statuses of each node so far
        self.received = {}
        self.node.create_subscription(
            String, 'status', self._take_status, QoSProfile(
                depth=100, reliability=ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def _take_status(self, message):
        status = json.loads(message.data)
        self._status[status['node']] = status
        self.reports[status['node']] += 1

    def status(self, node):
        """Return the newest status of a node, nothing where there was none."""
        return self._status.get(node, {})

    def forget(self, node):
        """Forget what a node has said; its next process speaks for itself."""
        self._status.pop(node, None)

    def writer(self, stream):
        return self.node.create_publisher(
            Float64MultiArray, stream, QoSProfile(
                depth=1000, reliability=ReliabilityPolicy.RELIABLE))

    def read(self, stream):
        """Collect the messages of a stream from now on."""
        messages = self.received.setdefault(stream, [])
        self.node.create_subscription(
            Float64MultiArray, stream, messages.append, QoSProfile(
                depth=1000, reliability=ReliabilityPolicy.RELIABLE))
        return messages

    def wait(self, condition, what):
        """Serve this node until a condition holds."""
        def turn():
            self._executor.spin_once(0.02)
            for _ in range(50):  # a stream has many messages
                self._executor.spin_once(0.0)
            return condition()
        return self._until(turn, what)

    def wait_for_status(self, node, **fields):
        """Return the status of a node once it has these fields."""
        self.wait(
            lambda: fields.items() <= self._status.get(node, {}).items(),
            f'{fields} in the status of {node}')
        return self._status[node]

    def wait_for_samples(self, stream, count):
        """Return all samples of a stream once there are so many."""
        self.wait(
            lambda: len(self.samples(stream)) >= count, f'{count} samples of {stream}')
        return self.samples(stream)

    def samples(self, stream):
        """Return all samples so far; their indices must follow each other from 0."""
        samples = []
        for message in self.received[stream]:
            index, period_s, *values = message.data
            assert period_s == PERIOD_S
            assert index == len(samples)
            samples += values
        return samples

    def call(self, service_type, name, request, was_done=lambda: False):
        """
        Call a service and return its answer.

        A server that has not discovered this client yet throws its answer away. Then it is called
        again, unless the request is seen to have been carried out: that gives None.
        """
        client = self.node.create_client(service_type, name)
        try:
            self.wait(client.service_is_ready, f'the service {name}')
            for attempt in range(ATTEMPTS):
                future = client.call_async(request)
                is_done = self._done_in_time(future)
                # The first request may be carried out late, and the second refused then.
                if (attempt or not is_done) and was_done():
                    return None
                if is_done:
                    return future.result()
        finally:
            self.node.destroy_client(client)
        pytest.fail(f'{name} did not answer')

    def _done_in_time(self, future):
        """Return whether an answer comes; none takes so long but one that is lost."""
        deadline = time.monotonic() + ANSWER_S
        self.wait(lambda: future.done() or time.monotonic() > deadline, 'an answer')
        return future.done()

    def change_state(self, node, transition):
        """Ask a managed node for a transition; return whether it made it."""
        number = getattr(Transition, f'TRANSITION_{transition.upper()}')
        answer = self.call(
            ChangeState, f'{node}/change_state',
            ChangeState.Request(transition=Transition(id=number)),
            was_done=lambda: self.state(node) == TARGETS[transition.rpartition('_')[2]])
        return answer is None or answer.success

    def set_parameter(self, node, name, value):
        """Set one parameter, which the node must take."""
        answer = self.call(
            SetParameters, f'{node}/set_parameters',
            SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        assert answer.results[0].successful, answer.results[0].reason

    def state(self, node):
        return self.call(GetState, f'{node}/get_state', GetState.Request()).current_state.label

    def destroy(self):
        self._executor.shutdown()
        # Fast DDS hangs if a node is destroyed while it hears of another one that leaves.
        time.sleep(0.1)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)
