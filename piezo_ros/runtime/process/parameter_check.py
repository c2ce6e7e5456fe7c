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

"""Compares what a command line gives to the nodes of a process with what these have declared."""

from collections.abc import Mapping, Sequence

from rclpy.node import Node

from piezo_ros.parameters.given_parameters import TakingNode, check_given, given_parameters

__all__ = ['check_given_parameters']


def check_given_parameters(nodes: Mapping[str, Node], arguments: Sequence[str]) -> None:
    """
    Refuse misspelt parameters, and warn of those that are given in vain.

    Parameters
    ----------
    nodes : mapping of str to Node
        Role to node, for every node of the process; they have declared their parameters.
    arguments : sequence of str
        The command line.

    Raises
    ------
    ParameterError
        If a parameter is misspelt, or named for a node that is not there.
    PlanError
        If a parameter file cannot be read.

    """
    taking = [
        TakingNode(role, node.get_namespace(), node.get_name(), node.has_parameter)
        for role, node in nodes.items()]
    for warning in check_given(given_parameters(arguments), taking):
        next(iter(nodes.values())).get_logger().warning(warning)
