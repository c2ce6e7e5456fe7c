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

"""What the feedforward (13) in Liu 2015 makes of a scan that was planned and learned."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import read
from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.experiment.plan.automatic import known_rig
from piezo_ros.experiment.plan.run_entry import plan_run
from piezo_ros.experiment.scan_learning import ScanLearning
from piezo_ros.model import RigParameters
from piezo_ros.parameters.run_and_result import PlannedRun, RunResult
from piezo_ros.report.metrics import nrmse, tail

__all__ = ['feedforward_comparison']

_PERIODS: Final = 15.0
_SCORED: Final = 4.0


def feedforward_comparison(
    learning: ScanLearning, base: Mapping[str, Mapping[str, Any]],
    run: Callable[[PlannedRun, Path], RunResult],
) -> str:
    """
    Run the same scan under feedforward with the same models; return by how much learning is better.

    Parameters
    ----------
    learning : ScanLearning
        With one run at least.
    base : mapping of str to mapping
        Node to the parameters of all runs.
    run : callable
        Does one run into the bag directory that it is given.

    Raises
    ------
    CampaignError
        If the run does not come to its end.
    ValueError
        If there is no run to compare with.

    """
    from piezo_ros.identification import choose_harmonics
    request = learning.request
    if not learning.runs:
        raise ValueError('runs is empty: there is nothing to compare with')
    plant = RigParameters.among(base['plant'])
    law = ControllerParameters(
        scheme='ff', command_minimum_um=-plant.reach_um, command_maximum_um=plant.reach_um)
    scan = TrajectoryParameters.among({
        **request.dynamics.to_mapping(), 'waveform': request.waveform,
        'offset_um': request.offset_um, 'turn_fraction': request.turn_fraction,
        'flyback_fraction': request.flyback_fraction,
        'amplitude_um': request.amplitude_um, 'frequency_hz': request.frequency_hz,
        'sample_period_s': request.sample_period_s, 'periods': _PERIODS,
        'model_response': 'sampled'})
    harmonics = choose_harmonics(
        known_rig({}, plant, request.hysteresis, request.dynamics), scan, law).harmonics
    nodes = {
        node: {**values, 'sample_period_s': request.sample_period_s}
        for node, values in base.items()}
    nodes['compensator'] |= request.hysteresis.to_mapping()
    nodes['controller'] = {
        'command_minimum_um': law.command_minimum_um,
        'command_maximum_um': law.command_maximum_um, **nodes['controller']}
    nodes['trajectory'] |= scan.to_mapping()
    planned = plan_run(
        nodes, {'scheme': 'ff', 'harmonics': harmonics}, where='comparison', number=0,
        name='feedforward')
    bag = learning.directory / 'bags' / planned.name
    shutil.rmtree(bag, ignore_errors=True)  # of a comparison before the learning was resumed
    run(planned, bag)
    feedforward_percent = _percent(bag, learning)
    best = learning.runs[learning.best_run].name
    best_percent = _percent(learning.directory / 'bags' / best, learning)
    return (
        f'feedforward (13) with m = {harmonics}, the best for these models: NRMSE '
        f'{feedforward_percent:.3f} % over {_SCORED:g} periods, '
        f'{feedforward_percent / best_percent:.1f} times that of run {best}')


def _percent(bag: Path, learning: ScanLearning) -> float:
    run, request = read(bag), learning.request
    window = tail(run.samples, request.frequency_hz, request.sample_period_s, _SCORED)
    return 100.0 * nrmse(run.reference_um[window], run.displacement_um[window])
