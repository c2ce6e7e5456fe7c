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
Images of a recorded raster scan: two runs, one of each axis, brought together by index.

The tip is where the displacements say. Of a simulated rig the noise of the sensor is known, sample
by sample, and is taken away: it moves no tip. Of any other rig it is part of the image.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_ros.bag import Run
from piezo_ros.bag.recorded_node import recorded_node
from piezo_ros.imaging.image_quality import ImageQuality, image_quality
from piezo_ros.imaging.raster_images import RasterImages, raster_images
from piezo_ros.imaging.synthetic_sample import SyntheticSample
from piezo_ros.model.noise import unit_noise

__all__ = ['ScannedImage', 'scanned_image', 'tip_um']

_GRATINGS: Final = 8.0  # periods of the sample's grating across the image
_SAME_PERIOD: Final = 1e-9  # relative


@dataclass(frozen=True)
class ScannedImage:
    """
    The images of one scan.

    Attributes
    ----------
    name : str
        Stem of its files.
    case, variant : str
        What is scanned, in words, and what distinguishes this scan from others of the case.
    bags : tuple of str
        Paths of the bags of the fast and the slow axis.
    images : RasterImages
        Where the tip was.
    sample : SyntheticSample
        What it saw there.
    quality : ImageQuality
        Figures of merit.
    measured_rms_px : float
        `ImageQuality.rms_px` with the noise of the sensors.
    noise_removed : bool
        Whether the noise of both sensors is known and taken away.
    sample_period_s : float
        Sample period of both axes.
    time_s : float
        Duration of the frame.

    """

    name: str
    case: str
    variant: str
    bags: tuple[str, str]
    images: RasterImages = field(repr=False, compare=False)
    sample: SyntheticSample
    quality: ImageQuality
    measured_rms_px: float
    noise_removed: bool
    sample_period_s: float

    @property
    def time_s(self) -> float:
        """Duration of the frame."""
        first, last = self.images.samples
        return (last - first) * self.sample_period_s

    @property
    def line_rate_hz(self) -> float:
        """Lines a second, to and fro."""
        return float(self.images.nominal_y_um.size / self.time_s)

    def record(self) -> dict[str, Any]:
        """Return everything but the positions, for report.json."""
        first, last = self.images.samples
        return {
            'name': self.name, 'case': self.case, 'variant': self.variant,
            'fast_bag': self.bags[0], 'slow_bag': self.bags[1],
            'lines': self.images.nominal_y_um.size, 'pixels': self.images.nominal_x_um.size,
            'first_sample': first, 'last_sample': last, 'sample_period_s': self.sample_period_s,
            'line_rate_hz': self.line_rate_hz,
            'pixel_um': self.images.pixel_um, 'line_um': self.images.line_um,
            'noise_removed': self.noise_removed, 'measured_rms_px': self.measured_rms_px,
            **vars(self.quality)}


def scanned_image(
    fast: Run, slow: Run, *, name: str, case: str, variant: str, bags: tuple[str, str],
    pixels: int = 256, central: float = 0.8,
) -> ScannedImage:
    """
    Return the images of two recorded runs.

    Parameters
    ----------
    fast, slow : Run
        The axis that goes to and fro on each line, and the one that goes from line to line.
    name, case, variant, bags
        As `ScannedImage` has them.
    pixels : int, optional
        Pixels of a line.
    central : float, optional
        Share of a line that is taken.

    Raises
    ------
    ValueError
        If the runs have unlike sample periods, no index in common, or are no raster scan.
    BagError
        If a run lacks reference or displacement.

    """
    if abs(fast.sample_period_s / slow.sample_period_s - 1.0) > _SAME_PERIOD:
        raise ValueError(
            f'sample_period_s is {fast.sample_period_s:.9g} s in {fast.path} and '
            f'{slow.sample_period_s:.9g} s in {slow.path}: the axes were not in lockstep')
    first = max(fast.start_index, slow.start_index)
    stop = min(run.start_index + run.samples for run in (fast, slow))
    if stop <= first:
        raise ValueError(
            f'{fast.path} has samples {fast.start_index} … {fast.start_index + fast.samples - 1}, '
            f'{slow.path} {slow.start_index} … {slow.start_index + slow.samples - 1}: no index in '
            'common')
    fast, slow = (
        run.part(first - run.start_index, stop - run.start_index) for run in (fast, slow))
    fast_um, slow_um = tip_um(fast), tip_um(slow)

    def made(x_um: NDArray[np.float64], y_um: NDArray[np.float64]) -> RasterImages:
        images = raster_images(
            fast.reference_um, x_um, slow.reference_um, y_um, pixels=pixels, central=central)
        start, end = images.samples
        return replace(images, samples=(start + first, end + first))

    measured = made(fast.displacement_um, slow.displacement_um)
    known = fast_um is not None and slow_um is not None
    images = made(fast_um, slow_um) if fast_um is not None and slow_um is not None else measured
    width_um = images.pixel_um * images.nominal_x_um.size
    length_um = images.line_um * images.nominal_y_um.size
    sample = SyntheticSample(pitch_um=width_um / _GRATINGS, size_um=max(width_um, length_um))
    return ScannedImage(
        name, case, variant, bags, images, sample, image_quality(images, sample),
        float(np.sqrt(np.mean(sum(part**2 for part in measured.trace_deviation_px)))), known,
        fast.sample_period_s)


def tip_um(run: Run) -> NDArray[np.float64] | None:
    """
    Return the displacement without the noise of the sensor.

    Parameters
    ----------
    run : Run
        A recorded run.

    Returns
    -------
    ndarray, shape (samples,), or None
        None if the noise is not known: the bag does not tell of a simulated rig, or what it tells
        is not in the displacement.

    """
    plant: Mapping[str, Any] = recorded_node(run, 'plant', anywhere=True) or {}
    noise_um, seed = plant.get('noise_rms_um'), plant.get('seed')
    if not isinstance(noise_um, float) or not isinstance(seed, int):
        return None
    measured_um = run.displacement_um
    if not noise_um:
        return measured_um
    known_um = measured_um - noise_um * unit_noise(seed, run.start_index, measured_um.size)
    # Whatever the bag says: noise that is taken away leaves less of it.
    if _roughness(known_um) < _roughness(measured_um):
        return known_um
    return None


def _roughness(values: NDArray[np.float64]) -> float:
    return float(np.median(np.abs(np.diff(values, n=2)))) if values.size > 2 else 0.0
