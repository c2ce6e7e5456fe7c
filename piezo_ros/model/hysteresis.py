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
The Maxwell resistive capacitor (MRC) hysteresis operator and its exact inverse.

n voltage-limited capacitors and a plain one (i = n + 1) in series, in Liu 2015::

    dq_i/dt = T dx/dt  while u_i sgn(du/dt) < u_S,i, else 0;   u_i = q_i / (T kappa_i)   (1, 2)
    u = u_1 + ... + u_{n+1};   x = q_{n+1} / T                                           (3, 4)

From sample to sample a limited element is a stop operator, u_i <- clip(u_i + dx / kappa_i, -u_S,i,
u_S,i). Here it is kept by its *play* r_i, the displacement at which it carries no voltage::

    u = x / kappa_{n+1} + sum of (x - r_i) / kappa_i,   -w_i <= x - r_i <= w_i = kappa_i u_S,i

A saturated element drags its play along (r_i = x -/+ w_i), every other one leaves it alone. Nothing
is accumulated, so that rounding errors do not build up, however long the input.

As long as the same elements are dragged, the voltage is a straight line, u = K x - H. The steps
keep this line and the range in which it is valid behind the plays: until the input turns or one
more element saturates, a sample costs one multiplication or division. The line is a shortcut only:
to the last bit, the result of a step is a function of plays and input alone.

Loops that are not symmetric have one-sided dead zones behind H, the superposition of the modified
Prandtl-Ishlinskii model (Kuhnen 2003), thresholds t_i and weights w_i; the operator is S(H(u))::

    S(x) = x + sum over t_i >= 0 of w_i max(x - t_i, 0) + sum over t_i < 0 of w_i min(x - t_i, 0)

S rises strictly, is a straight line between the thresholds, about zero of slope 1, and so is its
inverse.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from piezo_ros import paper
from piezo_ros.model.parameters import ParameterError, ParameterSet, parameter
from piezo_ros.model.step import Vector, step

__all__ = [
    'AsymmetryConstants',
    'HysteresisConstants',
    'HysteresisParameters',
    'compensation_step',
    'forward_step',
    'hysteresis_constants',
    'hysteresis_state',
    'hysteresis_step',
    'inverse_step',
    'settle_step',
    'state_size',
]


class AsymmetryConstants(NamedTuple):
    """What the steps need of the map; lists in a node, arrays in a kernel."""

    threshold_um: Any  # (m,) rising
    image_um: Any  # (m,) S at the thresholds
    slope_below: Any  # (m,) slope of S below a threshold
    slope_above: Any  # (m,) slope of S above it


def asymmetry_constants(
    threshold_um: Sequence[float], weight: Sequence[float],
) -> AsymmetryConstants:
    """Return the map of thresholds and weights as lists; the caller refuses slopes below zero."""
    size = len(threshold_um)
    first = sum(1 for threshold in threshold_um if threshold < 0.0)  # from zero on
    slopes = [1.0] * (size + 1)
    images = list(threshold_um)
    for i in range(first, size):
        slopes[i + 1] = slopes[i] + weight[i]
    for i in reversed(range(first)):
        slopes[i] = slopes[i + 1] + weight[i]
    for i, j in pairwise(range(first, size)):
        images[j] = images[i] + slopes[j] * (threshold_um[j] - threshold_um[i])
    for j, i in pairwise(reversed(range(first))):
        images[i] = images[j] - slopes[j] * (threshold_um[j] - threshold_um[i])
    return AsymmetryConstants(list(threshold_um), images, slopes[:-1], slopes[1:])


@step
def asymmetry_step(constants: AsymmetryConstants, displacement_um: float) -> float:
    """Return S of a displacement; the displacement itself where S has no threshold."""
    image_um = displacement_um
    for i in range(len(constants.threshold_um)):
        threshold_um = constants.threshold_um[i]
        if threshold_um < 0.0:
            if displacement_um < threshold_um:
                below_um: float = constants.image_um[i] + constants.slope_below[i] * (
                    displacement_um - threshold_um)
                return below_um
        elif displacement_um > threshold_um:
            image_um = constants.image_um[i] + constants.slope_above[i] * (
                displacement_um - threshold_um)
    return image_um


@step
def symmetric_step(constants: AsymmetryConstants, image_um: float) -> float:
    """Return the displacement of which S is the image: the exact inverse."""
    displacement_um = image_um
    for i in range(len(constants.threshold_um)):
        threshold_um = constants.threshold_um[i]
        if threshold_um < 0.0:
            if image_um < constants.image_um[i]:
                below_um: float = threshold_um + (
                    image_um - constants.image_um[i]) / constants.slope_below[i]
                return below_um
        elif image_um > constants.image_um[i]:
            displacement_um = threshold_um + (
                image_um - constants.image_um[i]) / constants.slope_above[i]
    return displacement_um


@dataclass(frozen=True, kw_only=True)
class HysteresisParameters(ParameterSet):
    """The elements of the MRC model, Table 1 in Liu 2015 by default."""

    kappa_um_per_v: tuple[float, ...] = parameter(
        paper.KAPPA_UM_PER_V, 'um/V',
        'compliance kappa_i of the n voltage-limited elements and, last, of the unlimited one',
        minimum=1e-6, maximum=1e9)
    saturation_v: tuple[float, ...] = parameter(
        paper.SATURATION_V, 'V', 'saturation voltage u_S,i of the n voltage-limited elements',
        minimum=0.0, maximum=1e3)
    asymmetry_threshold_um: tuple[float, ...] = parameter(
        (), 'um',
        'thresholds, rising, of the one-sided dead zones behind the elements; none: symmetric',
        minimum=-1e5, maximum=1e5)
    asymmetry_weight: tuple[float, ...] = parameter(
        (), '', 'change of the slope at each of these thresholds, away from zero',
        minimum=-1e3, maximum=1e3)

    def check_together(self) -> None:
        """Refuse lists of lengths that do not belong together."""
        super().check_together()
        limited, all_elements = len(self.saturation_v), len(self.kappa_um_per_v)
        if all_elements != limited + 1:
            raise ParameterError(
                f'kappa_um_per_v has {all_elements} values and saturation_v {limited}; there must '
                'be one kappa more than saturation voltages (the last one is the unlimited '
                'element)')
        thresholds, weights = self.asymmetry_threshold_um, self.asymmetry_weight
        if len(thresholds) != len(weights):
            raise ParameterError(
                f'asymmetry_threshold_um has {len(thresholds)} values and asymmetry_weight '
                f'{len(weights)}; there must be one weight for each threshold')
        if any(high <= low for low, high in pairwise(thresholds)):
            raise ParameterError(
                f'asymmetry_threshold_um is {list(thresholds)}, the values must rise')
        constants = asymmetry_constants(thresholds, weights)
        flattest = min([*constants.slope_below, *constants.slope_above], default=1.0)
        if flattest < _SMALLEST_SLOPE:
            raise ParameterError(
                f'asymmetry_weight is {list(weights)}: the slope falls to {flattest:g}, allowed is '
                f'{_SMALLEST_SLOPE:g} or more, as the displacement must rise with the voltage')

    @property
    def largest_compliance_um_per_v(self) -> float:
        """How far it moves for a volt where every limited element slips, um/V."""
        constants = asymmetry_constants(self.asymmetry_threshold_um, self.asymmetry_weight)
        steepest: float = max([1.0, *constants.slope_below, *constants.slope_above])
        return self.kappa_um_per_v[-1] * steepest


class HysteresisConstants(NamedTuple):
    """What the steps need of the parameters; lists in a node, arrays in a kernel."""

    slope_v_per_um: Any  # (n,) 1/kappa_i
    width_um: Any  # (n,) half width w_i = kappa_i u_S,i of the play
    saturation_v: Any  # (n,) u_S,i
    unlimited_v_per_um: float  # 1/kappa_{n+1}
    total_v_per_um: float  # sum over all n + 1 elements
    widest_um: float  # largest half width
    rounding: float  # bound of what n + 1 additions lose, relative
    asymmetry: AsymmetryConstants


# The state of the operator: n plays and, behind them, the line that is valid at present.
_LOW, _HIGH = 0, 1  # it is valid for displacements between these two, micrometres
_HELD_V = 2  # H
_STIFFNESS = 3  # K, V/um
_DRAG = 4  # where the dragged plays go: 1 up, -1 down, 0 for none
_LAST_UM = 5  # displacement of the newest sample; dragged plays are to be moved to it
_MARGIN_UM = 6  # so close to a bound the comparison of a play decides
_LINE_SIZE = 7
# The map behind the elements must have an inverse that no rounding error is enlarged by.
_SMALLEST_SLOPE = 1e-3


def hysteresis_constants(parameters: HysteresisParameters) -> HysteresisConstants:
    """Return the constants of the steps as lists."""
    *limited, unlimited = parameters.kappa_um_per_v
    slope = [1.0 / kappa for kappa in limited]
    total = 1.0 / unlimited
    for value in slope:
        total += value
    width = [kappa * limit for kappa, limit in zip(limited, parameters.saturation_v, strict=True)]
    return HysteresisConstants(
        slope, width, list(parameters.saturation_v), 1.0 / unlimited, total,
        max(width, default=0.0), (len(width) + 8) * 2.0**-45,
        asymmetry_constants(parameters.asymmetry_threshold_um, parameters.asymmetry_weight))


def hysteresis_state(plays_um: Sequence[float]) -> list[float]:
    """
    Return the state of the steps at given plays.

    Parameters
    ----------
    plays_um : sequence of float, shape (n,)
        The play values, micrometres; zeros for a stage that was never driven.

    Returns
    -------
    list of float, shape (n + 7,)
        The plays, and behind them a line that is valid nowhere.

    """
    return [*plays_um, math.inf, -math.inf, 0.0, 1.0, 0.0, 0.0, 0.0]


@step
def state_size(elements: int) -> int:
    """Return how many numbers the state of an operator with so many limited elements has."""
    return elements + _LINE_SIZE


@step
def hysteresis_step(state: Vector, constants: HysteresisConstants, voltage_v: float) -> float:
    """Move the state to a voltage and return its displacement S(H(u))."""
    return asymmetry_step(constants.asymmetry, forward_step(state, constants, voltage_v))


@step
def compensation_step(
    state: Vector, constants: HysteresisConstants, displacement_um: float,
) -> float:
    """Move the state to a displacement S(H(u)) and return its voltage u."""
    return inverse_step(state, constants, symmetric_step(constants.asymmetry, displacement_um))


@step
def inverse_step(state: Vector, constants: HysteresisConstants, displacement_um: float) -> float:
    """Move the state to a displacement and return its voltage (explicit inverse model)."""
    line = len(constants.width_um)
    if state[line + _LOW] < displacement_um < state[line + _HIGH]:
        _drag(state, line, displacement_um)
        return state[line + _STIFFNESS] * displacement_um - state[line + _HELD_V]
    if not _goes_on(state, line, displacement_um):
        settle_step(state, constants)
    _take_line(state, constants, displacement_um)
    return state[line + _STIFFNESS] * displacement_um - state[line + _HELD_V]


@step
def forward_step(state: Vector, constants: HysteresisConstants, voltage_v: float) -> float:
    """
    Move the state to a voltage and return its displacement (exact solution).

    The voltage is a monotone, piecewise linear function of the displacement, concave upwards of the
    present point and convex downwards, steepest where no element is saturated. Newton's method
    started on that steepest piece therefore never overshoots, the set of saturated elements only
    grows, and the last linear piece is solved exactly: at most n + 1 solutions, mostly two. While
    dragged plays are dragged further, the line that is kept is a piece to start on as well.
    """
    line = len(constants.width_um)
    displacement_um = (voltage_v + state[line + _HELD_V]) / state[line + _STIFFNESS]
    if state[line + _LOW] < displacement_um < state[line + _HIGH]:
        _drag(state, line, displacement_um)
        return displacement_um
    goes_on = _goes_on(state, line, displacement_um)
    saturated = -1
    drag, last_um = state[line + _DRAG], state[line + _LAST_UM]
    while True:
        if not goes_on:
            settle_step(state, constants)
            displacement_um = _steepest(state, constants, voltage_v)
            saturated = 0
        if _solve(state, constants, voltage_v, displacement_um, saturated) or not goes_on:
            return state[line + _LAST_UM]
        # Rounding could decide about an element: it does so from the steepest piece.
        state[line + _DRAG], state[line + _LAST_UM] = drag, last_um
        goes_on = False


@step
def _steepest(state: Vector, constants: HysteresisConstants, voltage_v: float) -> float:
    """Return the displacement of a voltage if no element is saturated."""
    held_v = 0.0
    for i in range(len(constants.width_um)):
        held_v += constants.slope_v_per_um[i] * state[i]
    return (voltage_v + held_v) / constants.total_v_per_um


@step
def _solve(
    state: Vector, constants: HysteresisConstants, voltage_v: float, displacement_um: float,
    saturated: int,
) -> bool:
    """
    Move the state to a voltage by Newton's method.

    It begins at a displacement not beyond the solution, on a piece with so many saturated elements
    (-1: not known). The result is whether the solution is so far from where any element saturates
    that, to the last bit, it does not depend on where the search began.
    """
    line = len(constants.width_um)
    for _ in range(line + 1):
        count = _take_line(state, constants, displacement_um)
        if count == saturated:
            return False
        saturated = count
        displacement_um = (voltage_v + state[line + _HELD_V]) / state[line + _STIFFNESS]
        if state[line + _LOW] < displacement_um < state[line + _HIGH]:
            _drag(state, line, displacement_um)
            return True
    return False


@step
def _goes_on(state: Vector, line: int, displacement_um: float) -> bool:
    """Return whether a displacement beyond the line's reach drags its dragged plays further."""
    drag = state[line + _DRAG]
    if drag > 0.0:
        return displacement_um > state[line + _LOW]
    return drag < 0.0 and displacement_um < state[line + _HIGH]


@step
def settle_step(state: Vector, constants: HysteresisConstants) -> None:
    """Move the dragged plays to where the newest displacement has them; give the line up."""
    line = len(constants.width_um)
    if state[line + _DRAG] != 0.0:
        _move_plays(state, constants, state[line + _LAST_UM])
        state[line + _DRAG] = 0.0
    state[line + _LOW] = math.inf
    state[line + _HIGH] = -math.inf


@step
def _drag(state: Vector, line: int, displacement_um: float) -> None:
    """Note a displacement on the line: there is no way back on it while plays are dragged."""
    drag = state[line + _DRAG]
    if drag > 0.0:
        state[line + _LOW] = displacement_um + state[line + _MARGIN_UM]
    elif drag < 0.0:
        state[line + _HIGH] = displacement_um - state[line + _MARGIN_UM]
    state[line + _LAST_UM] = displacement_um


@step
def _move_plays(state: Vector, constants: HysteresisConstants, displacement_um: float) -> None:
    width_um = constants.width_um
    for i in range(len(width_um)):
        play = state[i]
        width = width_um[i]
        if displacement_um - play > width:
            state[i] = displacement_um - width
        elif play - displacement_um > width:
            state[i] = displacement_um + width


@step
def _take_line(state: Vector, constants: HysteresisConstants, displacement_um: float) -> int:
    """Keep the line of a displacement and its reach; return how many elements are saturated."""
    slope_v_per_um = constants.slope_v_per_um
    width_um = constants.width_um
    saturation_v = constants.saturation_v
    line = len(width_um)
    size_um = abs(displacement_um) + constants.widest_um
    low_um = displacement_um - size_um
    high_um = displacement_um + size_um
    held_v = 0.0
    stiffness_v_per_um = constants.unlimited_v_per_um
    up = 0
    down = 0
    for i in range(line):
        play = state[i]
        width = width_um[i]
        if displacement_um - play > width:
            held_v -= saturation_v[i]
            up += 1
        elif play - displacement_um > width:
            held_v += saturation_v[i]
            down += 1
        else:
            slope = slope_v_per_um[i]
            held_v += slope * play
            stiffness_v_per_um += slope
            if play - width > low_um:
                low_um = play - width
            if play + width < high_um:
                high_um = play + width
    # Plays and sums are rounded: where that could decide about an element, the line must not.
    margin_um = constants.rounding * size_um * constants.total_v_per_um / stiffness_v_per_um
    if up > 0:
        low_um = displacement_um
    if down > 0:
        high_um = displacement_um
    state[line + _LOW] = low_um + margin_um
    state[line + _HIGH] = high_um - margin_um
    state[line + _HELD_V] = held_v
    state[line + _STIFFNESS] = stiffness_v_per_um
    state[line + _DRAG] = 1.0 if up > 0 else -1.0 if down > 0 else 0.0
    state[line + _LAST_UM] = displacement_um
    state[line + _MARGIN_UM] = margin_um
    return up + down
