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

"""A simulated rig made of identified models, for a stage of which there are measurements alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from piezo_ros.experiment.model_file import identified_facts, missing_of_model
from piezo_ros.model import DynamicsParameters, HysteresisParameters, ParameterSet
from piezo_ros.parameters.errors import PlanError

__all__ = ['MODEL_RIG_KEY', 'model_rig', 'model_rig_notes']

MODEL_RIG_KEY: Final = 'model_rig_files'
_NODES: Final[Mapping[str, type[ParameterSet]]] = {
    'compensator': HysteresisParameters, 'trajectory': DynamicsParameters}


def model_rig(
    path: Path, sections: Mapping[str, Mapping[str, Any]], content: Mapping[str, Any],
) -> dict[str, Any]:
    """
    Return hysteresis and dynamics of a simulated rig out of identified models.

    Parameters
    ----------
    path : Path
        The plan.
    sections : mapping of str to mapping
        What its model files say of ``compensator`` and ``trajectory``.
    content : mapping
        The plan.

    Returns
    -------
    dict of str to value
        Parameters of the node plant; none for a plan without the key.

    Raises
    ------
    PlanError
        If the files tell no hysteresis or no dynamics.

    """
    if MODEL_RIG_KEY not in content:
        return {}
    rig: dict[str, Any] = {'order': 'physical'}
    for node, parameters in _NODES.items():
        told = {
            name: value for name, value in sections[node].items() if name in parameters.names()}
        if not told:
            raise PlanError(
                f'{path}: {MODEL_RIG_KEY} have no model of the {node}, they must be what piezo '
                'identify hysteresis and piezo identify dynamics wrote')
        if missing := missing_of_model(told, parameters):
            raise PlanError(
                f'{path}: the model of the {node} in {MODEL_RIG_KEY} lacks {", ".join(missing)}; '
                'it must be whole, as piezo identify writes it')
        rig.update(told)
    return rig


def model_rig_notes(path: Path, content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return how far results on such a rig may be trusted; nothing for a plan without it."""
    if MODEL_RIG_KEY not in content:
        return ()
    notes = [(
        f'{path}: the simulated rig is made of identified models ({MODEL_RIG_KEY}): what the real '
        'stage does otherwise is not in these errors')]
    for name in content[MODEL_RIG_KEY]:
        file = path.parent / str(name)
        for section in ('identified_hysteresis', 'identified_dynamics'):
            facts = identified_facts(file, section)
            if 'verdict' in facts:
                residual = facts.get('residual_rms_um')
                left = f', residual {1e3 * residual:.3g} nm rms' if residual else ''
                notes.append(f'{file}: {facts["verdict"]}{left}')
    return tuple(notes)
