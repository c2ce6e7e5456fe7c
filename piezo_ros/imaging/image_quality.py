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
Figures of merit of a raster scan, in pixels: what an image shows of the error of a stage.

The deviation of a pixel is where the tip was less where it should have been. The part that an
affine map of the image undoes (shift, scale, rotation, shear) does little harm; what is left bends
lines.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from piezo_ros.imaging.raster_images import RasterImages
from piezo_ros.imaging.synthetic_sample import SyntheticSample

__all__ = ['ImageQuality', 'image_quality']

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ImageQuality:
    """
    How well a scan shows its sample.

    Attributes
    ----------
    line_rms_percent : float
        Deviation along the fast axis, trace and retrace, of the travel of a line.
    rms_px, maximum_px : float
        Deviation of the trace from where it should have been.
    affine_rms_px : float
        The same after the best affine map.
    scale_error_percent : float
        Width of the image over the nominal one, less 1, along the fast axis.
    trace_retrace_mean_px, trace_retrace_rms_px : float
        Retrace less trace along the fast axis: its mean, and the scatter about that.
    line_jitter_px : float
        Scatter of the mean deviation of neighbouring lines along the fast axis.
    correlation : float
        Of the trace with the image without any error.

    """

    line_rms_percent: float
    rms_px: float
    maximum_px: float
    affine_rms_px: float
    scale_error_percent: float
    trace_retrace_mean_px: float
    trace_retrace_rms_px: float
    line_jitter_px: float
    correlation: float


def image_quality(images: RasterImages, sample: SyntheticSample) -> ImageQuality:
    """
    Return the figures of merit of a scan.

    Parameters
    ----------
    images : RasterImages
        The scan.
    sample : SyntheticSample
        What is scanned, for the correlation.

    """
    nominal_x, nominal_y = np.broadcast_arrays(
        images.nominal_x_um[None, :], images.nominal_y_um[:, None])
    x_px, y_px = images.trace_deviation_px
    back_x_px, _ = images.retrace_deviation_px
    size_px = np.hypot(x_px, y_px)
    design = np.column_stack([np.ones(x_px.size), nominal_x.ravel(), nominal_y.ravel()])
    shares, left_x, left_y = _affine(design, x_px, y_px)
    back_px = back_x_px - x_px
    lines_px = x_px.mean(axis=1)
    seen, ideal = images.trace(sample).ravel(), images.ideal(sample).ravel()
    of_travel = images.pixel_um / images.travel_um
    return ImageQuality(
        line_rms_percent=100.0 * of_travel * _rms(np.concatenate([x_px, back_x_px])),
        rms_px=_rms(size_px), maximum_px=float(size_px.max()),
        affine_rms_px=_rms(np.hypot(left_x, left_y)),
        scale_error_percent=100.0 * float(shares[1]) * images.pixel_um,
        trace_retrace_mean_px=float(back_px.mean()),
        trace_retrace_rms_px=float(back_px.std()),
        line_jitter_px=_rms(np.diff(lines_px)) / np.sqrt(2.0),
        correlation=_correlation(seen, ideal))


def _correlation(one: _Floats, other: _Floats) -> float:
    """Return the correlation of two images; nothing correlates with an image that is flat."""
    if not np.ptp(one) or not np.ptp(other):
        return 0.0
    return float(np.corrcoef(one, other)[0, 1])


def _affine(design: _Floats, x_px: _Floats, y_px: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """Return the affine part along the fast axis and what is left along both."""
    shares, *_ = np.linalg.lstsq(
        design, np.column_stack([x_px.ravel(), y_px.ravel()]), rcond=None)
    left = np.column_stack([x_px.ravel(), y_px.ravel()]) - design @ shares
    return np.asarray(shares[:, 0]), np.asarray(left[:, 0]), np.asarray(left[:, 1])


def _rms(values: _Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
