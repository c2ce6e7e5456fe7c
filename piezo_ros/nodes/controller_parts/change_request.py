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

"""What a call asks of the gains and the scheme of a running controller."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from piezo_ros.control.changes import CHANGEABLE
from piezo_ros.model.parameters import ParameterError
from piezo_ros.nodes.controller_parts.law_schedule import LawSchedule

__all__ = ['ChangeRequest']


class ChangeRequest(NamedTuple):
    """What one call changes of a running controller, and at which sample (-1: the next)."""

    values: dict[str, Any]
    at_sample: int

    @classmethod
    def among(cls, changes: Mapping[str, Any]) -> 'ChangeRequest':
        """Return what changed parameters of the node say of gains and scheme."""
        return cls(
            {name: changes[name] for name in CHANGEABLE if name in changes},
            int(changes.get('apply_at_sample', -1)))

    @property
    def refusal_without_run(self) -> str:
        """Why it is refused where nothing is to be changed in a run, '' if it is not."""
        return '' if self.at_sample < 0 else (
            f'apply_at_sample is {self.at_sample}; it goes with gains or scheme in one call of '
            'set_parameters_atomically, during a run')

    def add_to(
        self, schedule: LawSchedule, *, next_index: int, first: int | None, unfed_topic: str,
    ) -> str:
        """
        Add the change to a schedule, between two samples of a run.

        Parameters
        ----------
        schedule : LawSchedule
            Of the run.
        next_index : int
            Index of the next sample, as the streams count.
        first : int or None
            Index of the first sample of the run; None where that is not known yet.
        unfed_topic : str
            Topic of the feedforward if it has no writer, else ''.

        Returns
        -------
        str
            Why it was not added, '' if it was.

        """
        if first is None:
            if self.at_sample >= 0:
                return (
                    f'apply_at_sample is {self.at_sample}; at which sample the run begins is not '
                    'known yet (start_index -1); call again once commands are sent')
            first = next_index
        at_sample = next_index if self.at_sample < 0 else self.at_sample
        if at_sample < next_index:
            return f'apply_at_sample is {at_sample}; the next sample is {next_index} already'
        try:
            if unfed_topic and schedule.law.replaced(**self.values).uses_feedforward:
                return f'scheme is {self.values.get("scheme")!r}, and {unfed_topic} has no writer'
            schedule.add(at_sample - first, self.values)
        except ParameterError as error:
            return str(error)
        return ''
