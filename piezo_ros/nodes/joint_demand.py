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

"""The demand that rigs in lockstep have in common."""

from collections.abc import Sequence

from piezo_ros.nodes.demand import DemandReader
from piezo_ros.runtime.node.loop_node import LoopNode
from piezo_ros.runtime.process.running_time import RunningTime

__all__ = ['JointDemand']

_WARN_S = 3.0  # after the start of a run


class JointDemand:
    """
    The demand of the own rig, as far as rigs that are kept in step demand the same.

    A rig of which the demand has ended delays none: its run is over, well or not, and a
    supervisor of both knows which.

    Parameters
    ----------
    node : LoopNode
        The trajectory.
    namespaces : sequence of str
        Of the other rigs.

    """

    def __init__(self, node: LoopNode, namespaces: Sequence[str] = ()) -> None:
        self._node = node
        self._waited: RunningTime | None = None  # since the start, until it was looked at
        self._own = DemandReader(node)
        self._others = [DemandReader(node, f'{namespace}/demand') for namespace in namespaces]

    @property
    def limit(self) -> int:
        """Samples below this index are demanded."""
        return min(reader.limit for reader in self._awaited)

    @property
    def _awaited(self) -> list[DemandReader]:
        """The demands that are waited for."""
        return [self._own, *(other for other in self._others if other.newest != 0)]

    @property
    def ended(self) -> bool:
        """Whether the own rig wants nothing more."""
        return self._own.ended

    def start(self) -> None:
        """Begin a run."""
        self._waited = RunningTime()
        for reader in (self._own, *self._others):
            reader.start()

    def wrong_writers(self) -> str:
        """Return which writers a demand has, if that is not exactly one, else ''."""
        return next(filter(None, (
            reader.wrong_writers() for reader in (self._own, *self._others))), '')

    def why_ended(self) -> str:
        """Return what has ended the demand, see `DemandReader.why_ended`."""
        return self._own.why_ended()

    def take(self) -> bool:
        """Take the newest demands; return whether there is a new one."""
        taken = [reader.take() for reader in (self._own, *self._others)]
        return any(taken)

    def check_writer(self, timeout_s: float) -> None:
        """Check that every demand that is waited for has its writer, as `DemandReader` does."""
        for reader in self._awaited:
            reader.check_writer(timeout_s)

    def warn_of_none(self) -> None:
        """Warn once in a run, some time after its start, if there is no sample to send yet."""
        if self._waited is None or self._waited.elapsed_s() < _WARN_S:
            return
        self._waited = None
        if reasons := [why for reader in self._awaited if (why := reader.why_none())]:
            self._node.get_logger().warning(f'waiting: {"; ".join(reasons)}')
