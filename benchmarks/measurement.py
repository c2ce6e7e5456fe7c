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
Measurements as data, taken in rounds.

The speed of a machine drifts. Each round therefore takes every measurement once, one after the
other, and two benchmarks are compared by the ratios of quantities of the same round.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from piezo_ros.parameters.errors import CampaignError

__all__ = [
    'BenchmarkError',
    'Measurement',
    'Quantity',
    'Ratio',
    'Readings',
    'chosen',
    'higher',
    'lower',
    'seconds',
    'shortest',
    'take_rounds',
]

_CALLS: Final = 7


class BenchmarkError(ValueError):
    """An option that cannot be used, or a file that is no benchmark."""


class Quantity(NamedTuple):
    """
    One number that a measurement gives.

    Attributes
    ----------
    name, unit : str
        Its name in the results, and its unit.
    higher_is_better : bool
        Whether a larger value is the better one.

    """

    name: str
    unit: str
    higher_is_better: bool


def higher(name: str, unit: str) -> Quantity:
    """Return a quantity of which a larger value is better."""
    return Quantity(name, unit, higher_is_better=True)


def lower(name: str, unit: str) -> Quantity:
    """Return a quantity of which a smaller value is better."""
    return Quantity(name, unit, higher_is_better=False)


def _nothing_is_missing() -> str:
    return ''


@dataclass(frozen=True)
class Measurement:
    """
    Something to measure.

    Attributes
    ----------
    group : str
        Group of measurements that ``--only`` can choose.
    quantities : tuple of Quantity
        The numbers that it gives.
    measure : callable
        Takes the measurement once and returns the value of each quantity.
    missing : callable
        Returns the reason why the measurement cannot be taken on this machine, '' if it can.

    """

    group: str
    quantities: tuple[Quantity, ...]
    measure: Callable[[], Sequence[float]]
    missing: Callable[[], str] = _nothing_is_missing

    @property
    def title(self) -> str:
        """Group and quantities, for the display of progress."""
        return f'{self.group}: {", ".join(quantity.name for quantity in self.quantities)}'


class Ratio(NamedTuple):
    """
    One quantity over another one of the same round.

    Attributes
    ----------
    name : str
        Its name in the results.
    over, under : str
        The quantities in the numerator and in the denominator.
    higher_is_better : bool
        Whether a larger value is the better one.

    """

    name: str
    over: str
    under: str
    higher_is_better: bool


class Readings(NamedTuple):
    """
    The values of some rounds.

    Attributes
    ----------
    values : dict of str to list of float
        The values of each quantity, one for each round.
    skipped : dict of str to str
        Why a quantity could not be measured on this machine.
    failed : dict of str to str
        What went wrong with a quantity; later rounds did not measure it.

    """

    values: dict[str, list[float]]
    skipped: dict[str, str]
    failed: dict[str, str]


def seconds(action: Callable[[], Any]) -> float:
    """Return the wall-clock time that a call takes, seconds."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def shortest(action: Callable[[], Any]) -> float:
    """
    Return the shortest wall-clock time of several calls, seconds, as `timeit` takes it.

    A virtual machine takes freed memory away, and it can take three times as long to get it back
    as to compute what goes into it.
    """
    return min(seconds(action) for _ in range(_CALLS))


def chosen(measurements: Iterable[Measurement], names: Sequence[str]) -> list[Measurement]:
    """
    Return the measurements of the named groups or quantities; all of them without names.

    Parameters
    ----------
    measurements : iterable of Measurement
        The measurements to choose from.
    names : sequence of str
        Groups and quantities.

    Raises
    ------
    BenchmarkError
        If a name is neither.

    """
    table = list(measurements)
    names_of = [
        {entry.group, *(quantity.name for quantity in entry.quantities)} for entry in table]
    known = set().union(*names_of)
    for name in names:
        if name not in known:
            raise BenchmarkError(
                f'{name!r} is no measurement and no group; there are {", ".join(sorted(known))}')
    return [
        entry for entry, own in zip(table, names_of, strict=True)
        if not names or not own.isdisjoint(names)]


def take_rounds(
    measurements: Sequence[Measurement], rounds: int,
    announce: Callable[[str], None] = lambda text: None,
) -> Readings:
    """
    Take every measurement once in each round, one after the other.

    A measurement that fails is left out from then on; the others go on.

    Parameters
    ----------
    measurements : sequence of Measurement
        The measurements.
    rounds : int
        Number of rounds.
    announce : callable, optional
        Called with the title of each measurement before it begins.

    """
    readings = Readings({}, {}, {})
    possible: list[Measurement] = []
    for entry in measurements:
        reason = entry.missing()
        if reason:
            readings.skipped.update((quantity.name, reason) for quantity in entry.quantities)
        else:
            possible.append(entry)
    for number in range(1, rounds + 1):
        for entry in list(possible):
            announce(f'round {number}/{rounds}: {entry.title}')
            try:
                values = [float(value) for value in entry.measure()]
                if not all(map(math.isfinite, values)):
                    raise CampaignError(f'the values are {values}, they must be finite')
            except (CampaignError, OSError, ValueError) as error:
                possible.remove(entry)
                readings.failed.update(
                    (quantity.name, f'round {number}: {error}') for quantity in entry.quantities)
                continue
            for quantity, value in zip(entry.quantities, values, strict=True):
                readings.values.setdefault(quantity.name, []).append(value)
    return readings
