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
Distributions of parameters in a sweep, and draws from them.

A draw is a function of seed, number of the draw and name of the parameter alone: more draws later,
or another parameter beside, leave those that were there as they are. They are made in blocks of
256 draws, each with a generator of its own.
"""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ['KINDS', 'RELATIVE', 'Distribution', 'read_distribution']

_Draw = Callable[[np.random.Generator, tuple[float, ...], tuple[int, int]], NDArray[Any]]


def _log_uniform(
    generator: np.random.Generator, bounds: tuple[float, ...], shape: tuple[int, int],
) -> NDArray[np.float64]:
    return np.exp(generator.uniform(math.log(bounds[0]), math.log(bounds[1]), shape))


# Kind -> what it needs, and what makes draws of it; of a choice the places in the list.
KINDS: Final[Mapping[str, tuple[str, _Draw]]] = {
    'uniform': ('[low, high]', lambda generator, p, shape: generator.uniform(p[0], p[1], shape)),
    'log_uniform': ('[low, high], both above 0', _log_uniform),
    'normal': (
        '[mean, standard deviation]',
        lambda generator, p, shape: generator.normal(p[0], p[1], shape)),
    'integers': (
        '[lowest, highest]',
        lambda generator, p, shape: generator.integers(
            int(p[0]), int(p[1]), shape, endpoint=True)),
    'choice': (
        'a list of values', lambda generator, p, shape: generator.integers(0, int(p[0]), shape)),
}
_BLOCK: Final = 256  # draws that are made at once
RELATIVE: Final = ('times', 'each_times')


@dataclass(frozen=True)
class Distribution:
    """
    How a parameter is drawn.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    arguments : tuple
        What that kind needs.
    relative : str
        ``''``: the draw is the value; ``'times'``: it multiplies the value that the run has
        otherwise, a list as a whole; ``'each_times'``: every number of a list has a draw of its
        own.

    """

    kind: str
    arguments: tuple[Any, ...]
    relative: str

    def draw(self, base: Any, name: str, seed: int, number: int) -> Any:
        """
        Return a value.

        Parameters
        ----------
        base : value
            What the run has otherwise.
        name : str
            The parameter, as ``node.name``.
        seed, number : int
            Seed of the sweep and number of the draw.

        """
        is_list = bool(self.relative) and isinstance(base, list | tuple)
        count = len(base) if is_list and self.relative == 'each_times' else 1
        is_choice = self.kind == 'choice'
        numbers = (len(self.arguments),) if is_choice else self.arguments
        block, place = divmod(number, _BLOCK)
        drawn = _drawn_block(self.kind, numbers, count, seed, block, name)[place]
        if is_choice:
            drawn = [self.arguments[place] for place in drawn]
        if not self.relative:
            return drawn[0]
        if not is_list:
            return base * drawn[0]
        factors = drawn if self.relative == 'each_times' else drawn * len(base)
        return [value * factor for value, factor in zip(base, factors, strict=True)]


@lru_cache(maxsize=256)
def _drawn_block(
    kind: str, numbers: tuple[float, ...], count: int, seed: int, block: int, name: str,
) -> list[list[Any]]:
    """Return ``count`` numbers for each draw of a block."""
    generator = np.random.Generator(np.random.Philox(
        np.random.SeedSequence([seed, block, zlib.crc32(name.encode())])))
    _, draw = KINDS[kind]
    drawn: list[list[Any]] = draw(generator, numbers, (_BLOCK, count)).tolist()
    return drawn


def read_distribution(content: Any) -> Distribution:
    """
    Return a distribution as a plan writes it.

    Parameters
    ----------
    content : mapping
        ``{uniform: [0, 1]}``, or ``{times: {normal: [1, 0.01]}}``.

    Raises
    ------
    ValueError
        If it is none; the text says what is allowed.

    """
    kind, arguments = _only_entry(content)
    relative = ''
    if kind in RELATIVE:
        relative = kind
        kind, arguments = _only_entry(arguments)
    if kind not in KINDS:
        raise ValueError(
            f'{kind!r} is no distribution, allowed are {", ".join((*KINDS, *RELATIVE))}')
    _check(kind, arguments, relative)
    return Distribution(kind, tuple(arguments), relative)


def _only_entry(content: Any) -> tuple[Any, Any]:
    if not isinstance(content, Mapping) or len(content) != 1:
        raise ValueError(
            f'{content!r} is no distribution, which is a mapping of one entry, such as '
            '{uniform: [0, 1]}')
    return next(iter(content.items()))


def _check(kind: str, arguments: Any, relative: str) -> None:
    what, _ = KINDS[kind]
    refusal = ValueError(f'{kind} is {arguments!r}, it must be {what}')
    if not isinstance(arguments, list) or not arguments:
        raise refusal
    if kind == 'choice' and not relative:
        return
    numbers = [
        value for value in arguments
        if isinstance(value, int | float) and not isinstance(value, bool)
        and math.isfinite(value)]
    if len(numbers) != len(arguments) or (kind != 'choice' and len(numbers) != 2):
        raise refusal
    if (
        (kind == 'normal' and numbers[1] < 0)
        or (kind in ('uniform', 'log_uniform', 'integers') and numbers[0] > numbers[1])
        or (kind == 'log_uniform' and numbers[0] <= 0)
        or (kind == 'integers' and any(number != int(number) for number in numbers))
    ):
        raise refusal
