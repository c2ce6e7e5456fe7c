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

"""A node graph for every run of a plan: its processes are started, watched and ended."""

import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Final

from piezo_ros.live.node_status import has_begun, voltage_at_the_end
from piezo_ros.live.process_group import POLL_S
from piezo_ros.live.rescue import rescue
from piezo_ros.live.run_parameters import rig_file, run_parameters
from piezo_ros.live.supervisor import Supervisor, how_it_ended, stopped_by
from piezo_ros.parameters.errors import CampaignError
from piezo_ros.parameters.node_parameters import HARDWARE_PLANT
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.resource_limits import memory_limit
from piezo_ros.runtime.process.running_time import RunningTime

__all__ = ['GraphPerRun', 'LiveRun']

# How long a run must be for compiled steps to make up for the compiler's start: without feedback a
# second's work of Python steps; with it, what the loop waits for the plant, which has the longest
# step, and for all of them.
_WORTH_COMPILING_BLOCKS: Final = 200_000
_WORTH_COMPILING_PLANT: Final = 30_000
_WORTH_COMPILING_LOOP: Final = 40_000
_LAST_STATUS_S: Final = 5.0  # how long to wait for it once all is recorded


class GraphPerRun:
    """
    Does each run of a plan on node processes of its own.

    Parameters
    ----------
    supervisor : Supervisor
        What starts and ends the processes.
    directory : Path
        Output directory; logs/ and parameters/ go below it.
    composed : bool
        One process for the four nodes of the loop in place of four.
    record : bool
        Whether a recorder writes the bag.
    progress : callable
        Is told the share of the run that is done, 0 … 1.

    """

    def __init__(
        self, supervisor: Supervisor, directory: Path, *, composed: bool = False,
        record: bool = True, progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        self._supervisor = supervisor
        self._directory = directory
        self._composed = composed
        self._record = record
        self._progress = progress

    def __call__(self, planned: PlannedRun, bag: Path) -> RunResult:
        """
        Do one run.

        Parameters
        ----------
        planned : PlannedRun
            The run.
        bag : Path
            Bag directory; must not exist.

        Returns
        -------
        RunResult
            Wall-clock time while samples flowed.

        Raises
        ------
        CampaignError
            If a node failed or died, or the run was stopped from outside; what was recorded is in
            the bag.

        """
        run = self.start(planned, bag)
        try:
            while not (run.over() or self.interrupted()):
                self.follow(run)
                time.sleep(POLL_S)
            self.end(run)
        finally:
            self.kill()
        return self.result(run, bag)

    def start(self, planned: PlannedRun, bag: Path) -> 'LiveRun':
        """
        Start the processes of a run.

        Parameters
        ----------
        planned : PlannedRun
            The run.
        bag : Path
            Bag directory; must not exist.

        Raises
        ------
        CampaignError
            If this process was asked to end.

        """
        supervisor = self._supervisor
        if supervisor.stop_signal:
            raise CampaignError(stopped_by(supervisor.stop_signal))
        if self._composed and planned.hardware:
            raise CampaignError(f'{planned.name}: a device has a process of its own, not composed')
        logs = self._logs(planned)
        logs.mkdir(parents=True)
        supervisor.begin_graph()
        run = LiveRun(supervisor, planned)
        arguments = self._write_parameters(planned, bag)
        nodes = ['loop'] if self._composed and not planned.bare else planned.nodes
        try:
            for name in [*(['recorder'] if self._record else []), *nodes]:
                executable = HARDWARE_PLANT if name == 'plant' and planned.hardware else name
                supervisor.processes.start(name, arguments, logs / f'{name}.log', executable)
        except BaseException:
            self.kill()
            raise
        return run

    def interrupted(self) -> bool:
        """Return whether a process has failed or this one was asked to end."""
        return self._supervisor.processes.dead() or bool(self._supervisor.stop_signal)

    def follow(self, run: 'LiveRun') -> None:
        """Take in what the nodes say."""
        self._supervisor.take_statuses()
        self._progress(run.share_done)

    def end(self, run: 'LiveRun') -> None:
        """End every process, and take in the last that the nodes say."""
        self.follow(run)
        run.stop()
        self.follow(run)

    def kill(self) -> None:
        """Leave no process; whatever was raised, nodes zero the voltage and close the bag first."""
        self._supervisor.processes.stop()
        self._supervisor.processes.kill()

    def _write_parameters(self, planned: PlannedRun, bag: Path) -> list[str]:
        """Write the parameter file of the run and return the arguments that load it."""
        path = self._directory / 'parameters' / f'{planned.name}.yaml'
        if planned.hardware and not planned.hardware.is_real:
            # The rig that the device simulates is no parameter of the node.
            self._supervisor.write_parameters(
                rig_file(path), {'plant': planned.plant.to_mapping()})
        return self._supervisor.write_parameters(path, run_parameters(
            planned, bag, record=self._record, autostart=True,
            compiled=planned.nodes if self._composed else _worth_compiling(planned), file=path,
            bag_namespace=self._supervisor.bag_namespace))

    def _logs(self, planned: PlannedRun) -> Path:
        return self._directory / 'logs' / planned.name

    def result(self, run: 'LiveRun', bag: Path) -> RunResult:
        """
        Return how an ended run went.

        Raises
        ------
        CampaignError
            If a node failed or died, or the run was stopped from outside.

        """
        notes = rescue(bag)
        stop_signal = self._supervisor.stop_signal
        problems = run.problems(stopped=bool(stop_signal))
        if stop_signal:
            problems.insert(0, stopped_by(stop_signal))
        if problems:
            problems += voltage_at_the_end(
                run.plant_status, killed=self._supervisor.processes.was_killed('plant', 'loop'))
            problems.append(f'logs: {self._logs(run.planned)}')
            raise CampaignError('; '.join([*problems, *notes]))
        return RunResult(run.wall_seconds, tuple(notes))


def _worth_compiling(planned: PlannedRun) -> Collection[str]:
    """Return the nodes, each a process, for which compiled steps make up for their start."""
    samples = planned.trajectory.samples
    if planned.bare or not planned.controller.uses_feedback:
        return planned.nodes if samples > _WORTH_COMPILING_BLOCKS else ()
    if samples > _WORTH_COMPILING_LOOP:
        return planned.nodes
    return ('plant',) if samples > _WORTH_COMPILING_PLANT else ()


class LiveRun:
    """
    The processes of one run and what they have said of it.

    Parameters
    ----------
    supervisor : Supervisor
        What starts and ends them.
    planned : PlannedRun
        The run.

    """

    def __init__(self, supervisor: Supervisor, planned: PlannedRun) -> None:
        self.planned = planned
        self._statuses = supervisor.statuses
        self._processes = supervisor.processes
        self._processes.has_begun = self._has_begun
        self._take_statuses = supervisor.take_statuses
        self._recorded: RunningTime | None = None  # since all is recorded
        self._stopped_early: dict[str, str] = {}
        self._faults_before_stop: list[str] = []

    def over(self) -> bool:
        """Return whether every stream has ended and is recorded."""
        recorded = 'recorder' in self._processes
        if recorded and self._processes.runs('recorder'):
            return False
        states = [self._statuses.get(node, {}).get('state') for node in self.planned.nodes]
        if all(state in ('finished', 'faulted', 'stopped') for state in states):
            return True
        if not recorded:
            return False
        # The last statuses may be on their way, or their writers not discovered yet.
        self._recorded = self._recorded or RunningTime()
        return self._recorded.elapsed_s() > _LAST_STATUS_S

    def _has_begun(self, name: str) -> bool:
        """Return whether a process that has ended well had begun the run, as far as is known."""
        self._take_statuses()  # It has waited until they were here.
        nodes = self.planned.nodes if name == 'loop' else (name,)
        own = [status for node, status in self._statuses.items() if node in nodes]
        # One that is not discovered yet has begun if another has: each waits for its peers.
        known = own or list(self._statuses.values())
        return not known or any(map(has_begun, known))

    def finished(self) -> bool:
        """Return whether every node has come to the end of the run."""
        return self.over() and not self._faults() and all(
            self._statuses.get(node, {}).get('state') == 'finished'
            for node in self.planned.nodes)

    @property
    def plant_status(self) -> dict[str, Any]:
        """The newest status of the plant, nothing before the first."""
        return self._statuses.get('plant', {})

    @property
    def share_done(self) -> float:
        """Share of the samples that the plant has answered, 0 … 1."""
        return min(1.0, self.plant_status.get('index', 0) / self.planned.trajectory.samples)

    @property
    def wall_seconds(self) -> float:
        """Wall-clock time from the first voltage to the last."""
        return float(self.plant_status.get('elapsed_s', 0.0))

    def stop(self) -> None:
        """End every process, remembering which runs were over before and why."""
        self._faults_before_stop = self._faults()
        self._stopped_early = {
            name: status['reason'] for name, status in self._statuses.items()
            # A node that has made others stop says why.
            if status['state'] == 'stopped' and not status['by_peer']}
        self._processes.stop()

    def problems(self, *, stopped: bool) -> list[str]:
        """Return what went wrong, the first failure only; the others follow from it."""
        self._processes.dead()
        unresponsive = [
            f'{name} did not end when it was asked to, and was killed'
            for name in self._processes.unresponsive]
        problems = [*self._causes(stopped=stopped), *unresponsive]
        limits = memory_limit()
        return [*problems, f'every process had an {limits}'] if problems and limits else problems

    def _causes(self, *, stopped: bool) -> list[str]:
        # Told to end one after the other, some see their peers go before they are told themselves.
        faults = self._faults_before_stop if stopped else self._faults()
        for name, code in self._processes.blamed.items():
            if code < 0:
                return [f'{name} {how_it_ended(code)}']
        # They were told to end from outside; that others had to fail then may be seen before.
        for node, reason in self._stopped_early.items():
            name = node if node in self._processes else 'loop'
            return [f'{name} was stopped: {reason}', *faults]
        for name, code in self._processes.blamed.items():
            # A process that is told to end before its run is over fails, as it should.
            if not stopped or faults:
                reason = self._statuses.get(name, {}).get('reason', '')
                others = [fault for fault in faults if fault != f'{name}: {reason}']
                how = how_it_ended(code)
                return [f'{name} {how}' + (f': {reason}' if reason else ''), *others]
        return [] if stopped else self._cut_short()

    def _cut_short(self) -> list[str]:
        """Return what shows that the run is not whole although no node says why."""
        for status in self._statuses.values():
            if status['state'] == 'stopped':
                return [f'{status["node"]} was stopped: {status["reason"]}']
        plant, samples = self.plant_status, self.planned.trajectory.samples
        if plant and plant['index'] < samples:
            return [f'the run ended after {plant["index"]} of {samples} samples']
        return []

    def _faults(self) -> list[str]:
        return [
            f'{status["node"]}: {status["reason"]}' for status in self._statuses.values()
            if status['state'] == 'faulted']
