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
Learning of a planned scan: run, compare with the reference, improve, run again.

The runs are without feedback (scheme ff), or beside feedback with aligned delays (fbff), see
`piezo_ros.experiment.scan_beside_feedback`.

The output directory has ``bags/000`` …, one for every run, ``learning.json`` with what came of
each, and ``best.yaml`` with its motion, the best scan so far. All of it is written after each run,
so that an interrupted learning keeps its best and can be resumed.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from piezo_ros.bag import BagError, read
from piezo_ros.control import ControllerParameters
from piezo_ros.control.tables.motion_table import write_motion_table
from piezo_ros.experiment.motion_files import MOTION_SUFFIX
from piezo_ros.experiment.plan.run_entry import plan_run
from piezo_ros.experiment.planned_scan import ScanRequest, write_planned_scan
from piezo_ros.experiment.scan_beside_feedback import ScanBesideFeedback
from piezo_ros.model import RigParameters
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.planning.learning import period_average
from piezo_ros.planning.periodic_plan import PeriodicPlan
from piezo_ros.report.files import put_in_place, write_atomically

__all__ = ['RECORD', 'LearnedRun', 'ScanLearning']

RECORD: Final = 'learning.json'
_BEST: Final = 'best.yaml'
_FORMAT_VERSION: Final = 1


@dataclass(frozen=True)
class LearnedRun:
    """
    What came of one run.

    Attributes
    ----------
    name : str
        Of its bag.
    nrmse_percent, sigma_percent : float
        Weighted error of the period average and its standard deviation, of the peak-to-peak
        reference.
    predicted_percent : float
        What the model expected of this run.
    is_best : bool
        Whether it was the best one when it came.

    """

    name: str
    nrmse_percent: float
    sigma_percent: float
    predicted_percent: float
    is_best: bool


class ScanLearning:
    """
    The runs of a learning, one after the other.

    Parameters
    ----------
    request : ScanRequest
        What is wanted.
    plan : PeriodicPlan
        Where it begins.
    directory : Path
        Of the output.
    base : mapping of str to mapping
        Node to the parameters of all runs: the rig, the compensator, the controller.
    scheme : str, optional
        ``'ff'`` or ``'fbff'``.

    Attributes
    ----------
    runs : list of LearnedRun
        What came of the runs so far.
    plans : list of PeriodicPlan
        What was played in each.

    """

    def __init__(
        self, request: ScanRequest, plan: PeriodicPlan, directory: Path,
        base: Mapping[str, Mapping[str, Any]], *, scheme: str = 'ff',
    ) -> None:
        self.request = request
        self.directory = directory
        self._scheme = scheme
        self._scan = ScanBesideFeedback(
            request, plan, ControllerParameters.among({**base['controller'], 'scheme': scheme}))
        self.learner = self._scan.learner
        self.runs: list[LearnedRun] = []
        self.plans: list[PeriodicPlan] = []
        self._base = base
        self._repetitions = self._scan.repetitions

    @property
    def is_done(self) -> bool:
        """Whether no further run pays."""
        return self.learner.is_done

    @property
    def best_run(self) -> int:
        """Number of the run, of one at least, that played the best scan last."""
        best_v = self.learner.best.coefficients_v
        return max(
            number for number, plan in enumerate(self.plans)
            if np.array_equal(plan.coefficients_v, best_v))

    def resume(self) -> int:
        """
        Take the runs of an earlier learning into account; return how many there were.

        Raises
        ------
        BagError
            If a bag of a finished run cannot be read.
        CampaignError
            If the record of the runs is damaged, or they were under another scheme.
        OSError
            If there is no record.

        """
        path = self.directory / RECORD
        try:
            record = json.loads(path.read_text(encoding='utf-8'))
            names = [str(run['name']) for run in record['runs']]
        except (ValueError, KeyError, TypeError) as error:
            raise CampaignError(f'{path} is damaged: {error!r}') from None
        scheme = record.get('scheme', 'ff')
        if scheme != self._scheme:
            raise CampaignError(
                f'{path}: its runs are under the scheme {scheme}, not '
                f'{self._scheme}')
        for name in names:
            self._take(name, self.learner.propose())
        return len(names)

    def next_run(self, run: Callable[[PlannedRun, Path], RunResult]) -> LearnedRun:
        """
        Do the next run and learn from it.

        Parameters
        ----------
        run : callable
            Does one run into the bag directory that it is given.

        Raises
        ------
        CampaignError
            If the run does not come to its end, or its bag lacks samples.

        """
        plan = self.learner.propose()
        name = self._free_name()
        bag = self.directory / 'bags' / name
        motion = self._scan.motion(plan)
        path = self.directory / 'motions' / f'{name}.npz'
        path.parent.mkdir(parents=True, exist_ok=True)
        write_motion_table(path, motion)
        assert motion.repeat_from is not None
        samples = motion.repeat_from + self._repetitions * plan.reference_um.size
        run(self._planned(path, samples), bag)
        learned = self._take(name, plan)
        self._keep()
        return learned

    def _free_name(self) -> str:
        """Return a name for the next run; the bag of one that was interrupted keeps its own."""
        first = name = f'{len(self.runs):03d}'
        tries = 1
        while (self.directory / 'bags' / name).exists():
            tries += 1
            name = f'{first}_{tries}'
        return name

    def _planned(self, motion: Path, samples: int) -> PlannedRun:
        request, number = self.request, len(self.runs)
        nodes = {
            node: {**values, 'sample_period_s': request.sample_period_s}
            for node, values in self._base.items()}
        # The noise of a simulated stage is another one in every run: else it would be learned.
        seed = nodes['plant'].get('seed', RigParameters().seed)
        nodes['plant']['seed'] = int(seed) + number
        nodes['compensator'] |= request.hysteresis.to_mapping()
        # Unless they are told, the limits of the command are those of the stage.
        reach_um = RigParameters.among(nodes['plant']).reach_um
        nodes['controller'] = {
            'command_minimum_um': -reach_um, 'command_maximum_um': reach_um,
            **nodes['controller']}
        nodes['trajectory'] |= {
            'waveform': 'file', 'file': str(motion.resolve()), 'harmonics': 0,
            'amplitude_um': request.amplitude_um, 'frequency_hz': request.frequency_hz,
            'periods': samples * request.frequency_hz * request.sample_period_s}
        return plan_run(
            nodes, {'scheme': self._scheme}, where=f'learning, run {number}', number=number)

    def _take(self, name: str, plan: PeriodicPlan) -> LearnedRun:
        run = read(self.directory / 'bags' / name)
        if run.lost:
            raise BagError(f'{run.path}: {"; ".join(run.lost)}')
        try:
            measured = period_average(
                run.displacement_um[:run.reference_um.size], plan.reference_um, plan.weight,
                self._repetitions)
        except ValueError as error:
            raise CampaignError(f'{run.path}: {error}') from None
        before_um = self.learner.best_rms_um
        self.learner.tell(measured)
        learned = LearnedRun(
            name, *self._scan.percent(measured),
            predicted_percent=self._scan.predicted_percent(plan),
            is_best=self.learner.best_rms_um == measured.rms_um < before_um)
        self.runs.append(learned)
        self.plans.append(plan)
        return learned

    def _keep(self) -> None:
        write_planned_scan(
            self.directory / _BEST, self.request, self.learner.best,
            [f'learned from {len(self.runs)} runs under the scheme {self._scheme}'])
        motion = (self.directory / _BEST).with_suffix(MOTION_SUFFIX)
        with put_in_place(motion) as unfinished:
            write_motion_table(unfinished, self._scan.motion(self.learner.best))
        write_atomically(self.directory / RECORD, json.dumps({
            'format_version': _FORMAT_VERSION, 'scheme': self._scheme, 'is_done': self.is_done,
            'certificate_gamma': self.learner.plan.certificate.gamma,
            'runs': [asdict(run) for run in self.runs]}, indent=2) + '\n')
