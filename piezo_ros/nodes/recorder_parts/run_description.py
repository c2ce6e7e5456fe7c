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

from pathlib import Path
from typing import Any

from piezo_ros.nodes.recorder_parts.peer_parameters import PeerParameters
from piezo_ros.parameters.node_parameters import LOOP_NODES
from piezo_ros.parameters.parameter_file import parameters_yaml, read_parameter_file
from piezo_ros.parameters.provenance import run_metadata
from piezo_ros.parameters.roles import parameters_by_role

__all__ = ['RunDescription']


class RunDescription:
    """
    Describes one run as far as its nodes are known.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes.
    parameters_file : str
        File with their parameters, '' for none.
    peers : PeerParameters
        What the nodes have told; it counts more than the file.

    """

    def __init__(self, namespace: str, parameters_file: str, peers: PeerParameters) -> None:
        self._namespace = namespace
        self._parameters_file = parameters_file
        self._peers = peers

    def contents(self) -> tuple[dict[str, str], str]:
        """Return the metadata of the run and the parameters of all nodes, as far as known."""
        parameters = {**self._filed_parameters(), **self._peers.parameters}
        metadata = run_metadata(parameters_by_role(parameters))
        return metadata, parameters_yaml(self._namespace, parameters)

    def missing(self) -> list[str]:
        """Return the nodes that have not answered and are in no file, by full name."""
        return sorted(set(self._peers.owing) - self._filed_parameters().keys())

    def _filed_parameters(self) -> dict[str, dict[str, Any]]:
        """Return what the file says of the nodes, by full name."""
        if not self._parameters_file:
            return {}
        prefix = self._namespace.rstrip('/')
        sections = read_parameter_file(Path(self._parameters_file), LOOP_NODES)
        return {f'{prefix}/{role}': values for role, values in sections.items()}
