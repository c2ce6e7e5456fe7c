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

"""What the nodes of a supervised run are told beyond the plan."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, Final

from piezo_ros.bag import STREAMS
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.parameters.node_parameters import HARDWARE_PLANT, parameter_names
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['rig_file', 'run_parameters']

_BARE_LOOKAHEAD: Final = 1000
_RECORDED_BLOCK_SAMPLES: Final = 1000
# A loaded machine takes its time, and the supervisor sees which process died.
_PARAMETERS_TIMEOUT_S: Final = 15.0
_HANDSHAKE_TIMEOUT_S: Final = 60.0


def run_parameters(
    planned: PlannedRun, bag: Path, *, record: bool, autostart: bool,
    compiled: Collection[str] = (), file: Path | None = None, bag_namespace: str = '',
) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of every node of a run.

    Parameters
    ----------
    planned : PlannedRun
        The run.
    bag : Path
        Bag directory.
    record : bool
        Whether a recorder takes part.
    autostart : bool
        Whether the nodes bring themselves up; where not, they have been told at their start.
    compiled : collection of str
        Nodes that compute in compiled code, beside those of which the plan says so.
    file : Path, optional
        Where the parameters will be written: the recorder takes from there what a node that is
        delayed up to the end does not tell.
    bag_namespace : str, optional
        Namespace that topics and nodes have in the bag.

    Returns
    -------
    dict of str to dict
        Node name to its parameters, the recorder first.

    """
    # The nodes stay until the recorder has all it wants of them.
    # Without feedback from a controller the streams come in long blocks as they are.
    copies = record and not planned.bare
    common = {
        'required_readers': 2 if record else 1,
        'recorded_block_samples': _RECORDED_BLOCK_SAMPLES if copies else 0,
        'linger_s': -1.0}
    sections = {node: {**planned.parameters[node], **common} for node in planned.nodes}
    for node in compiled:
        sections[node]['compiled'] = True
    for values in sections.values():
        values['handshake_timeout_s'] = max(
            _HANDSHAKE_TIMEOUT_S, values.get('handshake_timeout_s', 0.0))
    # Every run of a plan is one of its own, whichever process does it.
    sections['plant']['keep_state'] = False
    # Without a controller the plant demands, and only the recorder reads its displacement.
    sections['plant']['demand_lookahead_samples'] = _BARE_LOOKAHEAD if planned.bare else 0
    if planned.bare:
        sections['plant']['required_readers'] = int(record)
    if planned.hardware:
        _adapt_to_device(planned, planned.hardware, sections, file)
    if record:
        sections = {'recorder': {
            'streams': 'voltage,displacement' if planned.bare else ','.join(STREAMS),
            'bag_directory': str(bag.absolute()), 'bag_namespace': bag_namespace,
            'from_copies': copies,
            'linger_s': 0.0 if autostart else -1.0,
            'parameters_timeout_s': _PARAMETERS_TIMEOUT_S,
            'handshake_timeout_s': _HANDSHAKE_TIMEOUT_S,
            'parameters_file': '' if file is None else str(file.absolute()),
            'sample_period_s': planned.trajectory.sample_period_s}, **sections}
    for values in sections.values():
        values.pop('autostart', None)
        if autostart:
            values['autostart'] = True
    return sections


def rig_file(file: Path) -> Path:
    """Return the file of the rig that a device simulates, beside the parameters of the run."""
    return file.with_name(f'{file.stem}.rig.yaml')


def _adapt_to_device(
    planned: PlannedRun, hardware: HardwareParameters, sections: dict[str, dict[str, Any]],
    file: Path | None,
) -> None:
    """Let the run come as far ahead as the device wants it, and tell the plant its own."""
    names = parameter_names(HARDWARE_PLANT)
    plant = sections['plant'] = {
        name: value for name, value in sections['plant'].items() if name in names}
    if not hardware.is_real and file is not None:
        plant['simulated_rig_file'] = str(rig_file(file).absolute())
    lookahead = hardware.lookahead_samples(
        planned.trajectory.samples, planned.trajectory.sample_period_s)
    if planned.bare:
        plant['demand_lookahead_samples'] = max(plant['demand_lookahead_samples'], lookahead)
        return
    controller = sections['controller']
    for name in ('lookahead_samples', 'max_buffer_samples'):
        controller[name] = max(controller[name], lookahead)
