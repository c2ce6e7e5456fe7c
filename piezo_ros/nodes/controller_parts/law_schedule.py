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

"""Which gains and scheme apply from which sample on, while a controller runs."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from piezo_ros.control import ControllerParameters
from piezo_ros.control.changes import Change, ChangeParameters, changed_law, parse_changes
from piezo_ros.model.parameters import ParameterError

__all__ = ['LawSchedule']

NEVER = -1


class LawSchedule:
    """
    The law in use and the changes to come, by index from the first sample of the run.

    Parameters
    ----------
    law : ControllerParameters
        What applies at the start.
    changes : sequence of Change
        What is listed for every run, in the order of the samples.

    Attributes
    ----------
    law : ControllerParameters
        What applies now.
    change_at : int
        Index of the next change, `NEVER` for none.
    changed_at : int or None
        Index of the newest change.

    """

    def __init__(self, law: ControllerParameters, changes: Sequence[Change] = ()) -> None:
        self._initial_law = law
        self._listed = list(changes)
        self.restart()

    @classmethod
    def listed(cls, law: ControllerParameters, changes: ChangeParameters) -> 'LawSchedule':
        """
        Return the schedule of the changes that the parameters list for every run.

        Raises
        ------
        ParameterError
            If they do not go together, or belong to a running controller only.

        """
        if changes.apply_at_sample >= 0:
            raise ParameterError(
                f'apply_at_sample is {changes.apply_at_sample}; it belongs to a change during a '
                'run, what is known before goes into changes')
        schedule = cls(law, parse_changes(changes.changes))
        schedule.laws()  # refuses what does not go together
        return schedule

    def restart(self) -> None:
        """Begin a run: what was asked for during the one before is forgotten."""
        self.law = self._initial_law
        self.changed_at: int | None = None
        self._come(self._listed)

    def _come(self, changes: Sequence[Change]) -> None:
        self._coming = list(changes)
        self.change_at = self._coming[0].at_sample if self._coming else NEVER

    def laws(self) -> list[ControllerParameters]:
        """
        Return the law in use and those to come.

        Raises
        ------
        ParameterError
            If a change does not go together with the law before it.

        """
        return self._laws_with(self._coming)

    def _laws_with(self, changes: Sequence[Change]) -> list[ControllerParameters]:
        laws = [self.law]
        for change in changes:
            laws.append(changed_law(laws[-1], change.values))
        return laws

    def samples_before_change(self, index: int) -> int:
        """Return the number of samples before the next change; no limit if it is due or none."""
        ahead = self.change_at - index
        return ahead if ahead > 0 else sys.maxsize

    def apply(self) -> None:
        """Change the law; the sample of `change_at` is the next."""
        change = self._coming[0]
        self.law = changed_law(self.law, change.values)
        self.changed_at = change.at_sample
        self._come(self._coming[1:])

    def add(self, at_sample: int, values: Mapping[str, Any]) -> None:
        """
        Add a change to those that come.

        Parameters
        ----------
        at_sample : int
            Its sample, which must not be over.
        values : mapping of str to value
            What changes.

        Raises
        ------
        ParameterError
            If it does not go together with the law that applies then, or a later change not with
            it; nothing is added.

        """
        merged: dict[int, dict[str, Any]] = {
            change.at_sample: change.values for change in self._coming}
        merged[at_sample] = {**merged.get(at_sample, {}), **values}
        coming = [Change(index, merged[index]) for index in sorted(merged)]
        self._laws_with(coming)
        self._come(coming)
