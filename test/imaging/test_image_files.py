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

"""Images as files, read back by the libraries that read such files."""

import numpy as np
import pytest

from piezo_ros.imaging.image_files import write_gwyddion, write_tiff

HEIGHT_UM = np.random.default_rng(1).random((12, 20))


def test_a_gwyddion_file_has_channels_sizes_and_units(tmp_path):
    gwyfile = pytest.importorskip('gwyfile')
    write_gwyddion(
        tmp_path / 'scan.gwy', {'Trace': HEIGHT_UM, 'Retrace': 2.0 * HEIGHT_UM}, 4.0, 2.4)
    channels = gwyfile.util.get_datafields(gwyfile.load(str(tmp_path / 'scan.gwy')))
    assert list(channels) == ['Trace', 'Retrace']
    field = channels['Retrace']
    np.testing.assert_array_equal(field.data, 2.0 * HEIGHT_UM * 1e-6)
    assert (field.xreal, field.yreal) == (4.0e-6, pytest.approx(2.4e-6))
    assert field['si_unit_xy'].unitstr == field['si_unit_z'].unitstr == 'm'


def test_a_tiff_file_has_the_heights(tmp_path):
    images = pytest.importorskip('PIL.Image')
    write_tiff(tmp_path / 'scan.tiff', HEIGHT_UM)
    with images.open(tmp_path / 'scan.tiff') as image:
        np.testing.assert_array_equal(np.array(image), HEIGHT_UM.astype(np.float32))
