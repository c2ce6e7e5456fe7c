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

"""Which gains and scheme hold from which sample on, while a controller runs."""

from collections.abc import Mapping, Sequence
from typing import Any

from piezo_ros.control import ControllerParameters
from piezo_ros.control.changes import Change, changed_law
from piezo_ros.model.parameters import ParameterError

__all__ = ['LawSchedule']

NEVER = -1


class LawSchedule:
    """
    The law in use and the changes to come, by index from the first sample of the run.

    Parameters
    ----------
    law : ControllerParameters
        What holds at the start.
    changes : sequence of Change
        What is listed for the run, in the order of the samples.

    Attributes
    ----------
    law : ControllerParameters
        What holds now.
    change_at : int
        Index of the next change, `NEVER` for none.
    changed_at : int or None
        Index of the newest change.

    """

    def __init__(self, law: ControllerParameters, changes: Sequence[Change]) -> None:
        self.law = law
        self.changed_at: int | None = None
        self._coming = list(changes)
        self.change_at = NEVER
        self._look_ahead()

    def _look_ahead(self) -> None:
        self.change_at = self._coming[0].at_sample if self._coming else NEVER

    def laws(self) -> list[ControllerParameters]:
        """Return the law in use and those to come."""
        laws = [self.law]
        for change in self._coming:
            laws.append(changed_law(laws[-1], change.values))
        return laws

    def apply(self) -> None:
        """Change the law; the sample of `change_at` is the next."""
        change = self._coming.pop(0)
        self.law = changed_law(self.law, change.values)
        self.changed_at = change.at_sample
        self._look_ahead()

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
            If it does not go together with the law that holds then, or a later change not with it;
            nothing is added.

        """
        before = self._coming
        merged: dict[int, dict[str, Any]] = {change.at_sample: change.values for change in before}
        merged[at_sample] = {**merged.get(at_sample, {}), **values}
        self._coming = [Change(index, merged[index]) for index in sorted(merged)]
        try:
            self.laws()
        except ParameterError:
            self._coming = before
            raise
        self._look_ahead()
