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

"""What a bag says of its run: the parameters of all nodes, as told by them or by a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezo_ros.bag.description import LOST_KEY
from piezo_ros.nodes.recorder_parts.device_status import DeviceStatus
from piezo_ros.nodes.recorder_parts.peer_parameters import PeerParameters
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_file
from piezo_ros.parameters.portable_files import told_from_bag
from piezo_ros.parameters.provenance import run_metadata
from piezo_ros.parameters.role_parameters import full_name, moved_name
from piezo_ros.parameters.roles import parameters_by_role

__all__ = ['RunDescription']


class RunDescription:
    """
    Describes one run as far as its nodes are known.

    Parameters
    ----------
    bag : Path
        Directory of the bag.
    namespace : str
        Namespace of the nodes.
    parameters_file : str
        File with their parameters, '' for none.
    peers : PeerParameters
        What the nodes have told; it counts more than the file.
    device : DeviceStatus, optional
        What the plant tells of its device, if it has one.
    bag_namespace : str, optional
        Namespace that they have in the bag, '' for the same.

    """

    def __init__(
        self, bag: Path, namespace: str, parameters_file: str, peers: PeerParameters,
        device: DeviceStatus | None = None, bag_namespace: str = '',
    ) -> None:
        self._bag = bag
        self._namespace = namespace
        self._parameters_file = parameters_file
        self._bag_namespace = bag_namespace
        self._peers = peers
        self._device = device
        self._told: tuple[dict[str, str], str] | None = None
        self._written: set[str] = set()  # names of the nodes of which parameters were told

    def news(self, *, last: bool = False) -> tuple[dict[str, str], str] | None:
        """Return `contents` if they have changed since they were returned last, else None."""
        if last and self._device:
            self._device.await_rest()
        told = self._told
        contents = self.contents()
        return None if contents == told else contents

    def contents(self) -> tuple[dict[str, str], str]:
        """Return the metadata of the run and the parameters of all nodes, as far as known."""
        parameters = told_from_bag(
            self._bag, {**self._filed_parameters(), **self._peers.parameters})
        lost = self._uncertain(parameters)
        self._written |= parameters.keys()
        metadata = run_metadata(parameters_by_role(parameters))
        if self._device:
            metadata |= self._device.metadata()
        if lost or (self._told and LOST_KEY in self._told[0]):
            metadata[LOST_KEY] = '\n'.join(lost)
        self._told = metadata, parameters_yaml(
            self._namespace, {self.moved(name): values for name, values in parameters.items()})
        return self._told

    def moved(self, name: str) -> str:
        """Return the full name that a node or topic has in the bag."""
        return moved_name(name, self._namespace, self._bag_namespace)

    def _uncertain(self, parameters: Mapping[str, Any]) -> list[str]:
        """Return a sentence on each node of which the parameters are not certain."""
        return [
            f'the parameters of {name} are '
            f'{"not certain" if name in self._written else "not recorded"}: {count} nodes have '
            'this name'
            for name, count in sorted(self._peers.twins.items()) if name not in parameters]

    def missing(self) -> list[str]:
        """Return the nodes that have not answered and are in no file, by full name."""
        return sorted(set(self._peers.owing) - self._filed_parameters().keys())

    def _filed_parameters(self) -> dict[str, dict[str, Any]]:
        """Return what the file says of the nodes, by full name."""
        if not self._parameters_file:
            return {}
        sections = read_parameter_file(Path(self._parameters_file), LOOP_NODES)
        return {full_name(self._namespace, role): values for role, values in sections.items()}
