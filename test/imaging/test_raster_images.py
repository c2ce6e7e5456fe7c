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

"""Images of raster scans: what known errors of an axis look like."""

import numpy as np
import pytest

from piezo_ros.imaging.image_quality import image_quality
from piezo_ros.imaging.raster_images import raster_images
from piezo_ros.imaging.synthetic_sample import SyntheticSample

LINES = 40
SAMPLES = 500  # of a line, to and fro
PIXELS = 64
SAMPLE = SyntheticSample()


def scan():
    """Return the references of a fast triangle of 2 um and of a slow ramp."""
    turns = np.arange(LINES * SAMPLES) / SAMPLES
    fast_um = 2.0 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * (turns - 0.25)))
    return fast_um, 3.2 * (turns / LINES - 0.5)


def images(*, fast=lambda x: x, slow=lambda y: y):
    fast_um, slow_um = scan()
    return raster_images(fast_um, fast(fast_um), slow_um, slow(slow_um), pixels=PIXELS)


def quality(**axes):
    return image_quality(images(**axes), SAMPLE)


def late(samples):
    return lambda x: np.roll(x, samples)


def test_a_stage_without_error_shows_the_sample():
    made = images()
    assert made.trace_x_um.shape == (LINES, PIXELS)
    np.testing.assert_allclose(
        made.trace_x_um, np.broadcast_to(made.nominal_x_um, made.trace_x_um.shape), atol=1e-12)
    seen = image_quality(made, SAMPLE)
    # The slow axis moves on during a line.
    assert seen.rms_px < 0.25
    assert abs(seen.scale_error_percent) < 1e-9
    assert abs(seen.trace_retrace_mean_px) < 1e-9
    assert seen.correlation > 0.98


def test_a_wrong_scale_is_all_affine():
    seen = quality(fast=lambda x: 0.95 * x)
    assert seen.scale_error_percent == pytest.approx(-5.0, abs=1e-6)
    assert seen.rms_px > 0.5 > 10.0 * seen.affine_rms_px


def test_a_late_axis_shifts_trace_against_retrace():
    samples = 5
    pixel_um = images().pixel_um
    step_um = 4.0 / (0.5 * SAMPLES)
    seen = quality(fast=late(samples))
    assert seen.trace_retrace_mean_px == pytest.approx(
        2.0 * samples * step_um / pixel_um, rel=1e-3)
    assert seen.trace_retrace_rms_px < 0.01


def test_lines_that_jitter_are_told():
    random = np.random.default_rng(5)
    offsets_um = np.repeat(0.02 * random.standard_normal(LINES), SAMPLES)
    seen = quality(fast=lambda x: x + offsets_um)
    assert seen.line_jitter_px == pytest.approx(0.02 / images().pixel_um, rel=0.25)


def test_the_image_worsens_with_the_error():
    correlations = [
        quality(fast=lambda x, bend=bend: x + bend * np.sin(np.pi * x / 2.0)).correlation
        for bend in (0.0, 0.02, 0.1)]
    assert correlations == sorted(correlations, reverse=True)
    assert correlations[0] - correlations[-1] > 0.2


@pytest.mark.parametrize(('given', 'problem'), [
    ({'pixels': 1}, 'pixels is 1'), ({'central': 0.0}, 'central is 0.0'),
    ({'central': 1.2}, 'central is 1.2')])
def test_what_makes_no_image_is_refused(given, problem):
    fast_um, slow_um = scan()
    with pytest.raises(ValueError, match=problem):
        raster_images(fast_um, fast_um, slow_um, slow_um, **given)


def test_streams_of_unlike_length_and_a_single_line_are_refused():
    fast_um, slow_um = scan()
    with pytest.raises(ValueError, match='20000, 19999, 20000, 20000 samples'):
        raster_images(fast_um, fast_um[:-1], slow_um, slow_um)
    short = slice(0, SAMPLES)
    with pytest.raises(ValueError, match='holds [01] whole lines'):
        raster_images(fast_um[short], fast_um[short], slow_um[short], slow_um[short])


def approached(lines_up=8, rest=3):
    """Return a scan with soft start, approach, rest, and a frame that goes up and half down."""
    lines = 4 + rest + lines_up + lines_up // 2
    turns = np.arange(lines * SAMPLES) / SAMPLES
    fast_um = np.minimum(turns, 2.0) / 2.0 * 2.0 * np.sin(2.0 * np.pi * turns)
    start = 4 + rest
    slow_um = np.interp(
        turns, [0.0, 1.0, 4.0, start - 0.3, start + lines_up - 0.2, lines],
        [0.0, 0.0, -1.6, -1.6, 1.6, 0.0])
    return fast_um, slow_um, start


def test_the_frame_leaves_out_soft_start_approach_rest_and_the_way_back():
    fast_um, slow_um, start = approached()
    made = raster_images(fast_um, fast_um, slow_um, slow_um, pixels=PIXELS)
    assert made.nominal_y_um.size == 8
    assert np.ptp(np.diff(made.nominal_y_um)) < 1e-3
    assert made.samples[0] == pytest.approx((start - 0.25) * SAMPLES, abs=1)
    assert made.samples[1] == pytest.approx((start + 7.75) * SAMPLES, abs=1)
    assert made.travel_um == pytest.approx(4.0, abs=1e-3)
    # Along a steady slow axis the tip is where it should be.
    assert image_quality(made, SAMPLE).rms_px < 1e-6


def test_a_scan_about_another_place_is_one_about_that_place():
    fast_um, slow_um, _ = approached()
    made = raster_images(fast_um + 1.5, fast_um + 1.5, slow_um, slow_um, pixels=PIXELS)
    assert made.nominal_x_um.mean() == pytest.approx(1.5, abs=1e-3)


def test_lines_cut_by_the_ends_of_the_record_are_left_out():
    fast_um, slow_um = scan()
    first, last = int(0.3 * SAMPLES), int(0.2 * SAMPLES)
    whole = raster_images(fast_um, fast_um, slow_um, slow_um, pixels=PIXELS)
    cut = raster_images(*(
        stream[first:-last] for stream in (fast_um, fast_um, slow_um, slow_um)), pixels=PIXELS)
    assert whole.nominal_y_um.size - 2 <= cut.nominal_y_um.size < whole.nominal_y_um.size
    np.testing.assert_allclose(
        cut.trace_x_um, np.broadcast_to(cut.nominal_x_um, cut.trace_x_um.shape), atol=1e-9)


def test_a_measured_reference_with_noise_has_the_same_lines():
    fast_um, slow_um = scan()
    noise_um = 1e-3 * np.random.default_rng(3).standard_normal((2, fast_um.size))
    made = raster_images(
        fast_um + noise_um[0], fast_um, slow_um + 0.1 * noise_um[1], slow_um, pixels=PIXELS)
    assert made.nominal_y_um.size == images().nominal_y_um.size
    assert image_quality(made, SAMPLE).rms_px < 0.2


@pytest.mark.parametrize(('fast', 'slow', 'problem'), [
    (lambda x, y: x, lambda x, y: 0.0 * y, 'stays within 0 um'),
    (lambda x, y: y, lambda x, y: x, 'goes to and fro on each line'),
    (lambda x, y: np.where(np.arange(x.size) == 7, np.nan, x), lambda x, y: y,
     'fast reference is nan at sample 7'),
])
def test_what_is_no_raster_scan_is_refused(fast, slow, problem):
    fast_um, slow_um = scan()
    x_um, y_um = fast(fast_um, slow_um), slow(fast_um, slow_um)
    with pytest.raises(ValueError, match=problem):
        raster_images(x_um, fast_um, y_um, slow_um)


def test_a_line_deviation_is_of_the_travel():
    # 1 % of the place: the lines are straight, over 80 % of the travel.
    seen = quality(fast=lambda x: 1.01 * x)
    assert seen.line_rms_percent == pytest.approx(0.8 * 50.0 / np.sqrt(3.0) * 0.01, rel=0.01)


def test_a_flat_image_correlates_with_nothing():
    made = images(fast=lambda x: 0.0 * x, slow=lambda y: 0.0 * y)
    assert image_quality(made, SAMPLE).correlation == 0.0
