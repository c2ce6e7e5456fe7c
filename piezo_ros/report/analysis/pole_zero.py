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

"""Draws the poles and zeros of a transfer function in the s plane."""

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter
from numpy.typing import ArrayLike

from piezo_ros.report.figures.style import FAINT, SERIES, figure_style

__all__ = ['pole_zero_figure']


def pole_zero_figure(poles_rad_per_s: ArrayLike, zeros_rad_per_s: ArrayLike) -> Figure:
    """
    Draw poles as crosses and zeros as circles.

    Parameters
    ----------
    poles_rad_per_s, zeros_rad_per_s : array_like of complex, shape (N,) and (M,)
        Poles and zeros.

    Returns
    -------
    Figure
        Real and imaginary part over 2 pi, kilohertz, on scales that are linear about 0 and
        logarithmic beyond, since poles may be decades apart.

    """
    poles, zeros = (
        np.asarray(roots, dtype=np.complex128) / (2e3 * np.pi)
        for roots in (poles_rad_per_s, zeros_rad_per_s))
    sizes = np.abs(np.concatenate([poles, zeros]))
    sizes = sizes[sizes > 0.0]
    linear = 0.2 * float(sizes.min()) if sizes.size else 1.0
    reach = 2.0 * float(sizes.max()) if sizes.size else 1.0
    with figure_style():
        figure = Figure(figsize=(5.6, 4.6))
        axes = figure.add_axes((0.14, 0.12, 0.83, 0.79))
        axes.axhline(0.0, color=FAINT, linewidth=0.9)
        axes.axvline(0.0, color=FAINT, linewidth=0.9)
        axes.set_xscale('symlog', linthresh=linear)
        axes.set_yscale('symlog', linthresh=linear)
        axes.plot(poles.real, poles.imag, linestyle='none', marker='x', markersize=8,
                  markeredgewidth=1.8, color=SERIES[3], label='poles')
        axes.plot(zeros.real, zeros.imag, linestyle='none', marker='o', markersize=7.5,
                  markeredgewidth=1.6, markerfacecolor='none', color=SERIES[0], label='zeros')
        exponents = range(math.ceil(math.log10(linear)), math.floor(math.log10(reach)) + 1)
        ticks = [sign * 10.0 ** exponent for exponent in exponents for sign in (-1.0, 1.0)]
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(FixedLocator([0.0, *ticks]))
            axis.set_major_formatter(StrMethodFormatter('{x:g}'))
            axis.set_minor_locator(NullLocator())
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_xlabel('Re s / 2π (kHz)')
        axes.set_ylabel('Im s / 2π (kHz)')
        axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncol=2, borderpad=0,
                    borderaxespad=0.4)
    return figure
