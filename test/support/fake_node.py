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
Nodes of the loop on topics in memory: their own code and lifecycle, without rclpy underneath.

What `StreamNode` and rclpy give a node is replaced: endpoints, parameters, timers, services and
threads. A request of another thread is served at once.
"""

from types import SimpleNamespace
from unittest.mock import patch

from fake_transport import FakeOwner
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from piezo_ros.runtime.node.hooks import NodeHooks
from piezo_ros.runtime.node.rclpy_node.stream_node import StreamNode
from piezo_ros.runtime.process import steady_timer

__all__ = ['activate', 'configure', 'fake_hooks', 'fake_node', 'look_after', 'poll_all']


class _OnFakeTransport(FakeOwner):
    """Comes before a class of node and hides what rclpy would do."""

    executor = None
    is_stream_loop = True

    def set_up(self, transport, name, parameters=None):
        super().set_up(transport, name)
        self.own_publishers = []
        self.values = {}
        self._own_subscriptions = []
        self._parameter_overrides = {
            key: Parameter(key, value=value) for key, value in (parameters or {}).items()}

    def begin_at(self, index):
        super(FakeOwner, self).begin_at(index)  # that of the node

    def between_samples(self, action, refusal=str):
        action()

    def create_trigger(self, name, action):
        pass

    def create_timer(self, period_s, callback, **arguments):
        return SimpleNamespace(cancel=lambda: None, reset=lambda: None)

    def declare_parameter(self, name, value, descriptor):
        given = self._parameter_overrides.get(name)
        self.values[name] = value if given is None else given.value

    def has_parameter(self, name):
        return name in self.values

    def get_parameter(self, name):
        return SimpleNamespace(value=self.values[name])

    def set_parameters(self, parameters):
        self.values.update((parameter.name, parameter.value) for parameter in parameters)

    def _take_no_callback(self, callback):
        pass

    add_pre_set_parameters_callback = _take_no_callback
    add_on_set_parameters_callback = _take_no_callback
    add_post_set_parameters_callback = _take_no_callback

    def get_fully_qualified_name(self):
        return f'{self.get_namespace()}/{self.name}'

    def destroy_publisher(self, publisher):
        publisher.destroy()

    destroy_hidden_subscription = destroy_publisher


def _make(node_class, transport, name, parameters, initialise):
    node = object.__new__(type(node_class.__name__, (_OnFakeTransport, node_class), {}))
    node.set_up(transport, name, parameters)
    with (
        patch.object(StreamNode, '__init__', lambda _node, _role: None),
        patch.object(steady_timer, 'Clock', lambda clock_type: None),
    ):
        initialise(node)
    return node


def fake_node(node_class, transport, **parameters):
    """Return a node of a class as its process makes it, with some parameters."""
    return _make(node_class, transport, node_class.__name__.lower(), parameters,
                 lambda node: node_class.__init__(node))


def fake_hooks(transport, node_class=NodeHooks, name='node', **settings):
    """Return a node without parameters and lifecycle, with endpoints of its inputs and outputs."""
    node = _make(
        node_class, transport, name, None, lambda node: NodeHooks.__init__(node, name))
    node.settings = SimpleNamespace(**settings)
    node.create_readers()
    node.writers = {stream: transport.writer(stream, node) for stream in node.outputs}
    return node


def configure(*nodes):
    for node in nodes:
        assert node.on_configure(None) == TransitionCallbackReturn.SUCCESS, node.logger.texts


def activate(*nodes):
    """Begin a run of nodes that are configured."""
    for node in nodes:
        assert node.on_activate(None) == TransitionCallbackReturn.SUCCESS, node.logger.texts


def poll_all(*nodes):
    """Let nodes do what they can, in turn, until none of them could do anything three times."""
    idle = 0
    while idle < 3:
        progress = [node.quick(1) for node in nodes if node.running]
        idle = 0 if any(progress) else idle + 1


def look_after(node, now_s):
    """Look after the run of a node as the stream loop does."""
    try:
        node.run.housekeeping(now_s)
    except Exception as error:
        node.run.break_off(error)
