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

"""How far identified models may be trusted by the commands that are given their files."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from piezo_ros.experiment.model_file import poor_verdict, recorded_period_s

__all__ = ['USUAL_PERIOD_S', 'chosen_sample_period_s', 'poor_model']

USUAL_PERIOD_S: Final = 1e-5


def poor_model(paths: Sequence[Path | None]) -> str:
    """
    Return which model is not to be trusted, and why, in one line; '' for none.

    Parameters
    ----------
    paths : sequence of Path or None
        The model files; None stands for one that is not given.

    Raises
    ------
    PlanError
        If a file cannot be read.

    """
    for path in filter(None, paths):
        if verdict := poor_verdict(path):
            return f'{path}: {verdict}'
    return ''


def chosen_sample_period_s(paths: Sequence[Path | None], given_s: float | None) -> float:
    """
    Return the sample period to compute with, and warn of models from records of another one.

    Parameters
    ----------
    paths : sequence of Path or None
        The model files, the one that decides first; None stands for one that is not given.
    given_s : float or None
        What the command line says, which counts more than what the models tell.

    Raises
    ------
    PlanError
        If a file cannot be read, or tells something else than a period.

    """
    chosen_s = given_s
    for path in filter(None, paths):
        period_s = recorded_period_s(path)
        if period_s is None:
            continue
        if chosen_s is None:
            chosen_s = period_s
        elif not math.isclose(chosen_s, period_s, rel_tol=1e-6):
            print(
                f'piezo: warning: the sample period is {chosen_s:g} s here, {path} '
                f'was identified at {period_s:g} s: delays in samples are other times, and what '
                'is above half the slower sampling rate is not known', file=sys.stderr)
    return USUAL_PERIOD_S if chosen_s is None else chosen_s
