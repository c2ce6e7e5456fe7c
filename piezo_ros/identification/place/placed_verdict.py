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

"""What the place of the hysteresis says of the dynamics, added to their verdict."""

from dataclasses import replace
from typing import Final

from piezo_ros.identification.place.hysteresis_place import HysteresisPlace
from piezo_ros.identification.verdict import Verdict

__all__ = ['with_place']

_NAMED_PERCENT: Final = 3.0


def with_place(
    verdict: Verdict, place: HysteresisPlace | None, usable_to_hz: float, same_to_hz: float,
) -> Verdict:
    """
    Return a verdict that names what is not known of the place, and what it leaves of the record.

    Parameters
    ----------
    verdict : Verdict
        On the dynamics, by the points of their response.
    place : HysteresisPlace or None
        The place of the hysteresis; None where nothing tells it.
    usable_to_hz : float
        Up to where model and points agree.
    same_to_hz : float
        Up to where it does not matter which of the candidates for the place is right.

    """
    if place is None:
        return verdict
    remarks = []
    missed_percent = 100.0 * place.misfit_um / place.displacement_rms_um
    if missed_percent > _NAMED_PERCENT:
        remarks.append(
            f'simulated with the hysteresis in its best place, the stage is missed by '
            f'{missed_percent:.2g} % of the record, noise included')
    if not place.is_decided and place.spread_percent > _NAMED_PERCENT:
        remarks.append(
            f'which poles are before the hysteresis is undecided, which changes predictions by '
            f'{place.spread_percent:.2g} %')
    if same_to_hz < usable_to_hz and not verdict.is_poor:
        return Verdict.usable_up_to(
            f'{same_to_hz:.4g} Hz',
            'above, the model depends by over 3 % or 2 degrees on which poles are before the '
            'hysteresis, and that is undecided: a second record of another amplitude tells more '
            '(--place-from)', *verdict.reasons, *remarks)
    return replace(verdict, reasons=(*verdict.reasons, *remarks))
