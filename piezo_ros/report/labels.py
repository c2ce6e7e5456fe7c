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

"""Names of schemes and runs for tables, legends and headings."""

from collections.abc import Sequence
from typing import Final

from piezo_ros.report.score import ScoredRun

__all__ = ['run_label', 'scheme_label']

_SCHEME_LABELS: Final = {'fb': 'FB', 'ff': 'FF', 'fbff': 'FBFF', 'open_loop': 'open loop'}


def scheme_label(scheme: str) -> str:
    """Return the name of a control scheme as the paper prints it."""
    return _SCHEME_LABELS.get(scheme, scheme)


def run_label(run: ScoredRun, among: Sequence[ScoredRun]) -> str:
    """
    Return the shortest name that distinguishes a run from the others of a figure.

    Parameters
    ----------
    run : ScoredRun
        The run.
    among : sequence of ScoredRun
        All runs of the figure.

    Returns
    -------
    str
        The scheme; followed by the offset if runs differ in it, by the number of harmonics if
        another run has the same scheme and offset, and by the bag if one has the same harmonics
        too.

    """
    label = scheme_label(run.scheme)
    if len({other.offset_um for other in among}) > 1:
        label = f'{label}, offset {run.offset_um:g} µm'
    rivals = [
        other for other in among if other is not run
        and (other.scheme, other.offset_um) == (run.scheme, run.offset_um)]
    if not rivals:
        return label
    label = f'{label}, m = {run.harmonics}'
    if all(other.harmonics != run.harmonics for other in rivals):
        return label
    return f'{label}, {run.bag}'
