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

"""A campaign as a live view sees it, from simulated runs: no processes, no clock."""

import numpy as np
import yaml
from processes import ROOT

from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.experiment.plan import read_plan

__all__ = ['planned_runs', 'show_run', 'status_of']


def planned_runs(directory, *runs):
    """Return planned runs of the simulated rig of config/, from what a plan says of them."""
    path = directory / 'plan.yaml'
    path.write_text(yaml.safe_dump({
        'format_version': 1, 'score_periods': 1, 'runs': list(runs),
        'parameter_files': [
            str(ROOT / 'config' / f'{name}.yaml')
            for name in ('rig', 'compensator', 'controller', 'trajectory')]}))
    return read_plan(path).runs


def status_of(node, index, state='active', **fields):
    """Return a status as the supervisor hands it on."""
    return {
        'node': node, 'state': state, 'index': index, 'reason': '', 'by_peer': False,
        'voltage_v': None, 'elapsed_s': 0.0, **fields}


def show_run(view, planned, *, rig='', step=173, most=400, seed=1):
    """Let a view see single samples of a simulated run, about `step` of its samples apart."""
    streams = simulated_streams(planned)
    ways = np.random.default_rng(seed).integers(max(1, step // 2), step + step // 2 + 1, most)
    for index in np.minimum(np.cumsum(ways), planned.trajectory.samples - 1):
        for stream, samples in streams.items():
            # The trajectory is ahead of the plant.
            place = min(int(index) + (50 if stream in ('reference', 'feedforward') else 0),
                        planned.trajectory.samples - 1)
            view.take_sample(rig, stream, place, float(samples[place]))
        voltage_v = float(streams['voltage'][index])
        view.take_status(rig, status_of(
            'plant', int(index), voltage_v=voltage_v, elapsed_s=float(index) / 3000.0))
        view.show(index / planned.trajectory.samples)
