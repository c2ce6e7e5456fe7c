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
Where the hysteresis may stand among the poles of a stage, where no measurement has decided it.

Each pole, or pair of poles, is before the hysteresis or behind it; all zeros are behind. Of up to
three poles and pairs all choices are possible, of more those with one of them before, and none.
"""

import itertools
from collections.abc import Iterable
from typing import Final

from piezo_ros.model import DynamicsParameters, ParameterError

__all__ = ['placements']

_FEW: Final = 3


def placements(dynamics: DynamicsParameters) -> tuple[DynamicsParameters, ...]:
    """
    Return the dynamics with every place of the hysteresis that is possible.

    Parameters
    ----------
    dynamics : DynamicsParameters
        The dynamics; what they are a part of, such as a rig, is kept.

    Returns
    -------
    tuple of DynamicsParameters
        The given place first; it is the only one where ``hysteresis_place`` is ``'known'``.

    Examples
    --------
    >>> places = placements(DynamicsParameters(hysteresis_place='undecided'))
    >>> [(each.rates_before_hysteresis, each.pairs_before_hysteresis) for each in places]
    [(0, 1), (0, 0), (1, 0), (0, 1), (1, 1), (1, 1)]

    """
    if dynamics.hysteresis_place == 'known':
        return (dynamics,)
    rates, pairs = len(dynamics.rates_rad_per_s), len(dynamics.pole_pairs)
    poles = [*(('rate', i) for i in range(rates)), *(('pair', i) for i in range(pairs))]
    most = len(poles) if len(poles) <= _FEW else 1
    given = {('rate', i) for i in range(dynamics.rates_before_hysteresis)} | {
        ('pair', i) for i in range(min(dynamics.pairs_before_hysteresis, pairs))}
    found = [dynamics]
    for count in range(most + 1):
        for chosen in itertools.combinations(poles, count):
            if set(chosen) == given:
                continue
            try:
                found.append(_placed(dynamics, chosen))
            except ParameterError:  # more zeros than poles behind
                continue
    return tuple(found)


def _placed(
    dynamics: DynamicsParameters, before: Iterable[tuple[str, int]],
) -> DynamicsParameters:
    """Return the dynamics with some poles before the hysteresis, put first in their lists."""
    rates = [i for kind, i in before if kind == 'rate']
    pairs = [i for kind, i in before if kind == 'pair']
    values: dict[str, object] = {
        'rates_before_hysteresis': len(rates), 'pairs_before_hysteresis': len(pairs)}
    if dynamics.dynamics == 'liu':
        if pairs == [1]:
            (w1, z1), (w2, z2) = dynamics.pole_pairs
            values.update(
                natural_frequency_1_rad_per_s=w2, damping_ratio_1=z2,
                natural_frequency_2_rad_per_s=w1, damping_ratio_2=z1)
    else:
        for name, first in (
            ('pole_rates_rad_per_s', rates), ('pole_frequencies_rad_per_s', pairs),
            ('pole_damping_ratios', pairs),
        ):
            listed = getattr(dynamics, name)
            order = [*first, *(i for i in range(len(listed)) if i not in first)]
            values[name] = [listed[i] for i in order]
    return dynamics.replaced(**values)
