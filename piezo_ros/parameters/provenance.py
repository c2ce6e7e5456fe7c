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

"""What the metadata of a bag says about its run: settings of the nodes, versions of software."""

from collections.abc import Mapping
from importlib import metadata
from typing import Any

from piezo_ros.control import TrajectoryParameters
from piezo_ros.model import ParameterError

__all__ = ['run_metadata', 'software_versions']

_DESCRIBING = {
    'controller': ('scheme',),
    'trajectory': (
        'output', 'waveform', 'amplitude_um', 'amplitude_v', 'frequency_hz', 'harmonics',
        'periods', 'sample_period_s'),
    'plant': ('seed',),
}
_PACKAGES = ('numpy', 'scipy', 'numba', 'control', 'mcap', 'matplotlib', 'rclpy')


def software_versions() -> dict[str, str]:
    """Return the versions of this package and of what it stands on, '' for what is absent."""
    versions = {'piezo_ros': _version('piezo_ros')}
    versions.update((name, _version(name)) for name in _PACKAGES)
    return versions


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ''


def run_metadata(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """
    Return the entries of a bag's metadata record.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Role of each node to its parameters, as `parameters_by_role` gives them; foreign nodes may
        lack any.

    Returns
    -------
    dict of str to str
        Scheme, waveform, amplitude, frequency, harmonics, seed … as far as known, and versions.

    """
    entries = {
        name: str(parameters[node][name])
        for node, names in _DESCRIBING.items() if node in parameters
        for name in names if name in parameters[node]}
    if 'harmonics' in entries:
        entries['harmonics'] = _harmonics(parameters['trajectory'])
    entries.update(
        (f'version.{name}', version) for name, version in software_versions().items() if version)
    return entries


def _harmonics(trajectory: Mapping[str, Any]) -> str:
    """Return the highest harmonic that the run had, also where the node was to choose it."""
    try:
        return str(TrajectoryParameters.among(trajectory).harmonics)
    except ParameterError:  # of a foreign node
        return str(trajectory['harmonics'])
