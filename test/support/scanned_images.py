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

"""Images of raster scans without a run."""

import numpy as np

from piezo_ros.imaging.image_quality import image_quality
from piezo_ros.imaging.raster_images import raster_images
from piezo_ros.imaging.synthetic_sample import SyntheticSample
from piezo_ros.report.scanned_image import ScannedImage

__all__ = ['scanned_image']

LINES, SAMPLES = 20, 200


def scanned_image(name='000_a', variant='planned', *, descends=False, scale=0.97, case='20 lines'):
    turns = np.arange((LINES + 1) * SAMPLES) / SAMPLES
    fast_um = 4.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))
    slow_um = 3.2 * (turns / LINES - 0.5) * (-1.0 if descends else 1.0)
    images = raster_images(fast_um, scale * fast_um, slow_um, slow_um, pixels=24)
    sample = SyntheticSample()
    return ScannedImage(
        name, case, variant, ('x', 'y'), images, sample, image_quality(images, sample),
        measured_rms_px=0.5, noise_removed=True, sample_period_s=1e-5)
