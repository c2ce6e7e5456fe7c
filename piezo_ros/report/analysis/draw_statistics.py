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
Statistics of the scores of a sweep: quantiles, and which drawn parameter they depend on.

A quantile q of N draws lies, with 95 % confidence, between two of the sorted scores: their places
are the quantiles 0.025 and 0.975 of the binomial distribution of N and q. The rank correlation
(Spearman) r has the interval

    tanh(artanh r -+ 1.96 sqrt((1 + r^2/2)/(N - 3)))

and sees a dependence that rises or falls throughout. One that does not, such as that on a mismatch
of either sign, is seen by the correlation ratio: the share of the variance of the ranks that is
between B classes of the parameter, adjusted for the number of classes,

    1 - (1 - eta^2)(N - 1)/(N - B)
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['Dependence', 'Quantile', 'dependences', 'quantile', 'scalar_draws']

FEWEST_DRAWS: Final = 30  # for a statement about a dependence
_CLASSES: Final = 10
_CONFIDENT: Final = 1.959964  # standard errors to either side, of 95 %
_TAIL: Final = 0.1  # share of the draws at either end of a parameter

_Floats = NDArray[np.float64]


class Quantile(NamedTuple):
    """
    A quantile of the scores.

    Attributes
    ----------
    share : float
        Which one, 0 … 1.
    value : float
        Its estimate.
    low, high : float or None
        Where it lies with 95 % confidence; None where the draws are too few to say.

    """

    share: float
    value: float
    low: float | None
    high: float | None


class Dependence(NamedTuple):
    """
    How a score depends on one drawn parameter.

    Attributes
    ----------
    name : str
        ``node.name``.
    rank_correlation, low, high : float
        Spearman's, -1 … 1, and its interval of 95 %.
    variance_share : float
        Adjusted correlation ratio of the ranks, 0 … 1.
    at_lowest, at_highest : float
        Median of the score over the tenth of the draws in which the parameter is lowest, highest.
    median : float
        Median of the score over all draws.

    """

    name: str
    rank_correlation: float
    low: float
    high: float
    variance_share: float
    at_lowest: float
    at_highest: float
    median: float

    @property
    def span(self) -> float:
        """Largest distance of the two medians from each other and from that of all draws."""
        ends = (self.at_lowest, self.at_highest, self.median)
        return max(ends) - min(ends)


def quantile(scores: ArrayLike, share: float) -> Quantile:
    """
    Return a quantile with its interval of 95 % confidence.

    Parameters
    ----------
    scores : array_like, shape (N,)
        The scores, at least one, finite.
    share : float
        0 < share < 1.

    """
    from scipy.stats import binom
    ordered = np.sort(np.asarray(scores, dtype=np.float64))
    count = ordered.size
    below, above = (int(binom.ppf(end, count, share)) for end in (0.025, 0.975))
    return Quantile(
        share, float(np.quantile(ordered, share)),
        float(ordered[below - 1]) if below >= 1 else None,
        float(ordered[above]) if above < count else None)


def scalar_draws(records: Sequence[Mapping[str, Any]], name: str) -> dict[str, _Floats]:
    """
    Return the drawn values of a parameter as numbers.

    Parameters
    ----------
    records : sequence of mapping
        Records of runs.
    name : str
        ``node.name`` of the parameter.

    Returns
    -------
    dict of str to ndarray, shape (N,)
        Of a list, one entry for each element, ``name[k]``; its mean alone where a draw multiplies
        all elements. Empty for words.

    """
    values = [record[name] for record in records]
    if all(map(_is_number, values)):
        return {name: np.array(values, dtype=np.float64)}
    lists = [value for value in values if isinstance(value, list)]
    if (len(lists) < len(values) or len({len(each) for each in lists}) != 1 or not lists[0]
            or not all(_is_number(number) for each in lists for number in each)):
        return {}
    elements = np.array(lists, dtype=np.float64)
    if np.allclose(elements * elements[0].sum(), elements.sum(axis=1)[:, None] * elements[0]):
        return {f'mean of {name}': elements.mean(axis=1)}
    return {f'{name}[{k}]': column for k, column in enumerate(elements.T)}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def dependences(
    scores: ArrayLike, draws: Mapping[str, ArrayLike],
) -> tuple[Dependence, ...]:
    """
    Return how a score depends on each drawn parameter, the most important one first.

    Parameters
    ----------
    scores : array_like, shape (N,)
        The score of each draw, finite.
    draws : mapping of str to array_like, shape (N,)
        The parameters. One that is the same in all draws is left out.

    Returns
    -------
    tuple of Dependence
        Empty for fewer than 30 draws, or equal scores.

    """
    values = np.asarray(scores, dtype=np.float64)
    if values.size < FEWEST_DRAWS or np.ptp(values) == 0.0:
        return ()
    ranks = _ranks(values)
    found = [
        _dependence(name, values, ranks, np.asarray(drawn, dtype=np.float64))
        for name, drawn in draws.items() if np.ptp(np.asarray(drawn, dtype=np.float64)) > 0.0]
    return tuple(sorted(found, key=lambda each: -max(
        each.variance_share, each.rank_correlation ** 2)))


def _ranks(values: _Floats) -> _Floats:
    from scipy.stats import rankdata
    return np.asarray(rankdata(values), dtype=np.float64)


def _dependence(name: str, scores: _Floats, ranks: _Floats, drawn: _Floats) -> Dependence:
    count = scores.size
    r = float(np.clip(np.corrcoef(ranks, _ranks(drawn))[0, 1], -1.0, 1.0))
    reach = _CONFIDENT * math.sqrt((1.0 + 0.5 * r * r) / (count - 3))
    middle = math.atanh(max(min(r, 1.0 - 1e-12), -1.0 + 1e-12))
    order = np.argsort(drawn, kind='stable')
    tail = max(round(_TAIL * count), 1)
    return Dependence(
        name, r, math.tanh(middle - reach), math.tanh(middle + reach),
        _variance_share(ranks, drawn, order),
        float(np.median(scores[order[:tail]])), float(np.median(scores[order[-tail:]])),
        float(np.median(scores)))


def _variance_share(ranks: _Floats, drawn: _Floats, order: NDArray[np.intp]) -> float:
    """Return the adjusted correlation ratio of the ranks over classes of equal size."""
    levels = np.unique(drawn)
    if levels.size <= _CLASSES:
        classes = [np.flatnonzero(drawn == level) for level in levels]
    else:
        classes = np.array_split(order, _CLASSES)
    within = sum(float(np.sum((ranks[each] - ranks[each].mean()) ** 2)) for each in classes)
    whole = float(np.sum((ranks - ranks.mean()) ** 2))
    degrees = ranks.size - len(classes)
    if degrees <= 0:
        return 0.0
    return min(max(1.0 - within / whole * (ranks.size - 1) / degrees, 0.0), 1.0)
