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

"""The handing over of a table: asked for at a sample to come, later where that is over."""

from collections.abc import Callable
from typing import Final

from piezo_ros.control.tables.table_changes import TableChange
from piezo_ros.nodes.learner_parts.learning_protocol import Learning
from piezo_ros.nodes.learner_parts.scan_peers import ScanPeers

__all__ = ['HandOver']

FIRST_MARGIN: Final = 2000  # samples between the newest reference and a change
_MOST_MARGIN: Final = 2**22
_IS_OVER: Final = 'already'  # what a trajectory says of a sample that it has sent


class HandOver:
    """
    Hands the tables of a learning over, one after the other.

    Parameters
    ----------
    peers : ScanPeers
        The trajectory that is asked.
    log : callable
        Takes what is to be told.

    """

    def __init__(self, peers: ScanPeers, log: Callable[[str], object]) -> None:
        self._peers = peers
        self._log = log
        self._asked: TableChange | None = None
        self._margin = FIRST_MARGIN

    def advance(self, learning: Learning, next_index: int, *, has_ended: bool) -> bool:
        """
        Ask for the table that shall follow, or take the answer; return whether there was one.

        Parameters
        ----------
        learning : Learning
            What wants a table.
        next_index : int
            Index of the next sample of the reference.
        has_ended : bool
            Whether no sample follows.

        """
        peers = self._peers
        if self._asked is None and not has_ended:
            peers.forget_change()
            self._asked = learning.change_from(next_index + self._margin)
        if self._asked is None or (peers.refusal is None and has_ended):
            learning.end()
            return True
        if peers.refusal is None:
            peers.change_file(self._asked)
            return False
        change, self._asked = self._asked, None
        if not peers.refusal:
            learning.accept(change)
            self._log(f'from sample {change.at_sample} on: {change.file}')
        elif _IS_OVER in peers.refusal and self._margin < _MOST_MARGIN:
            self._margin *= 2
        else:
            self._log(f'{change.file} was refused: {peers.refusal}')
            learning.refuse(peers.refusal)
        return True
