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

"""Speed of a Monte Carlo sweep: on one worker, on two, and on two that keep the scores alone."""

import tempfile
import time
from functools import cache, partial
from pathlib import Path
from typing import Final

from benchmarks.measurement import Measurement, Ratio, higher
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.sweep.engines import local_engine
from piezo_ros.experiment.sweep.run_sweep import open_sweep, run_sweep
from piezo_ros.experiment.sweep.sweep_plan import read_sweep
from piezo_ros.experiment.sweep.work import SweepWork

__all__ = ['SWEEPS', 'SWEEP_RATIOS']

_DRAWS: Final = 1000
_PERIODS: Final = 15  # 5000 samples
_SCORED_DRAWS: Final = 4000  # runs that leave no directory are done several times as fast
_SCORED_PERIODS: Final = 12  # 4000 samples
_PLAN: Final = """\
format_version: 1
runs: [{scheme: [ff, fbff], periods: PERIODS}]
sweep:
  draws: DRAWS
  parameters:
    plant.gain_mismatch: {normal: [0.0, 0.02]}
    plant.natural_frequency_2_mismatch: {uniform: [-0.05, 0.05]}
"""


@cache
def _directory() -> tempfile.TemporaryDirectory[str]:
    """
    Return the directory of all sweeps, which is deleted when this process ends.

    For minutes after thousands of files are deleted, ext4 looks at each of their inodes before it
    makes a new one: the next sweep would take three times as long.
    """
    return tempfile.TemporaryDirectory(prefix='piezo_bench_')


def _rate(workers: int, *, scores_only: bool = False) -> tuple[float]:
    """Return the runs per second once every worker has started, which takes a second or two."""
    progress: list[tuple[float, int]] = []
    directory = Path(tempfile.mkdtemp(dir=_directory().name))
    path = directory / 'plan.yaml'
    draws, periods = (_SCORED_DRAWS, _SCORED_PERIODS) if scores_only else (_DRAWS, _PERIODS)
    path.write_text(
        _PLAN.replace('DRAWS', str(draws)).replace('PERIODS', str(periods)), encoding='utf-8')
    plan = read_sweep(read_plan(path))
    output = directory / 'out'
    open_sweep(plan, path, output, force=False)
    run_sweep(
        SweepWork(plan, str(output), scores_only=scores_only), local_engine(workers),
        workers=workers,
        progress=lambda done, _: progress.append((time.perf_counter(), done)))
    # The first entry is of the start, the next ones are of the first task of each worker.
    (first, done), *_, (last, all_done) = progress[workers:]
    return ((all_done - done) / (last - first),)


SWEEPS: Final = tuple(
    Measurement('sweep', (higher(f'sweep_{name}', 'runs/s'),), rate)
    for name, rate in (
        ('one_worker', partial(_rate, 1)), ('two_workers', partial(_rate, 2)),
        ('scores_only', partial(_rate, 2, scores_only=True))))
SWEEP_RATIOS: Final = (
    Ratio('sweep_two_over_one_worker', 'sweep_two_workers', 'sweep_one_worker',
          higher_is_better=True),
)
