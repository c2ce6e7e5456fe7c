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
The number of MRC elements by cross-validation: as few as leave no more than any at every amplitude.

The rms over a whole record is that of its large loops. Here a number of elements has to do at each
amplitude from 10 % of the largest one on, too.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.identification.hysteresis.hysteresis_validation import cross_validate
from piezo_ros.identification.hysteresis.levels import SMALLEST_SHARE, level_errors, noise_rms
from piezo_ros.identification.hysteresis.mrc_fit import PlayModel, fit_mrc
from piezo_ros.identification.hysteresis.mrc_start import Preparation, prepare, thinned
from piezo_ros.identification.hysteresis.records import Record, predict

__all__ = ['choose_elements']

_NUMBERS: Final = (*range(1, 13), 14, 16, 20, 24)
# The search ends after so many larger numbers in a row without an improvement.
_PATIENCE: Final = 3
# Share of the least cross-validated error up to which fewer elements are preferred.
_SUFFICIENT: Final = 1.01
_SUFFICIENT_OF_LOOP: Final = 1.2
_NEGLIGIBLE_PERCENT: Final = 0.05  # of the span of a loop
_FOLD_STEPS: Final = 20  # a fold starts from the fit to all data

_Floats = NDArray[np.float64]


def choose_elements(records: Sequence[Record]) -> tuple[int, dict[int, float]]:
    """
    Return the smallest sufficient number of elements, and the rms error of each number tried.

    Parameters
    ----------
    records : sequence of Record
        The data, with more weight on small loops.

    Returns
    -------
    elements : int
        The number.
    errors : dict of int to float
        Number of elements to cross-validated rms error, micrometres.

    """
    preparation = prepare(records, _NUMBERS, virgin=records[0].virgin)
    few = thinned(preparation.records)
    errors: dict[int, float] = {}
    levels: dict[int, _Floats] = {}
    for elements in _NUMBERS:
        folds, residual = cross_validate(few, partial(_fit_and_predict, preparation, elements))
        errors[elements] = math.sqrt(float(folds.mean()))
        left = level_errors(few, residual, noise_rms(few, residual))
        levels[elements] = np.array([
            level.percent for level in left if level.share >= 0.95 * SMALLEST_SHARE])
        chosen = _smallest_sufficient(errors, levels)
        if sum(1 for number in errors if number > chosen) >= _PATIENCE:
            break
    return chosen, errors


def _smallest_sufficient(errors: dict[int, float], levels: dict[int, _Floats]) -> int:
    least = np.min(np.stack(list(levels.values())), axis=0)
    limit = np.maximum(_SUFFICIENT_OF_LOOP * least, _NEGLIGIBLE_PERCENT)
    rms_limit = _SUFFICIENT * min(errors.values())
    sufficient = [
        elements for elements, error in errors.items()
        if error <= rms_limit and np.all(levels[elements] <= limit)]
    return min(sufficient, default=max(errors))


def _fit_and_predict(
    preparation: Preparation, elements: int, records: Sequence[Record],
) -> list[_Floats]:
    fit = fit_mrc(
        records, preparation.starts[elements], preparation.delay_bounds, _FOLD_STEPS)
    return predict(PlayModel(elements), records, fit.theta)
