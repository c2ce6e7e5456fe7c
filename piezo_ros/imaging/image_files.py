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
Images as files: Gwyddion (``.gwy``), with units and all channels, and TIFF of 32-bit floats.

Gwyddion files need the package ``gwyfile`` (``pip install piezo_ros[images]``).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ['write_gwyddion', 'write_tiff']

_METRES = 1e-6  # of a micrometre


def write_gwyddion(
    path: Path, height_um: Mapping[str, NDArray[np.float64]], width_um: float, length_um: float,
) -> None:
    """
    Write images as the channels of one Gwyddion file.

    Parameters
    ----------
    path : Path
        The file.
    height_um : mapping of str to ndarray, shape (L, N)
        Title of each channel, and its heights, line by line.
    width_um, length_um : float
        Size of the images along a line and across the lines.

    Raises
    ------
    ModuleNotFoundError
        If the package gwyfile is not installed.

    """
    from gwyfile.objects import GwyContainer, GwyDataField, GwySIUnit
    container = GwyContainer()
    for number, (title, heights) in enumerate(height_um.items()):
        container[f'/{number}/data/title'] = title
        container[f'/{number}/data'] = GwyDataField(
            heights * _METRES, xreal=width_um * _METRES, yreal=length_um * _METRES,
            si_unit_xy=GwySIUnit(unitstr='m'), si_unit_z=GwySIUnit(unitstr='m'))
    container.tofile(str(path))


def write_tiff(path: Path, height_um: NDArray[np.float64]) -> None:
    """
    Write an image as TIFF of 32-bit floats, micrometres.

    Parameters
    ----------
    path : Path
        The file.
    height_um : ndarray, shape (L, N)
        Heights, line by line.

    """
    from PIL import Image
    Image.fromarray(height_um.astype(np.float32)).save(path, format='TIFF')
