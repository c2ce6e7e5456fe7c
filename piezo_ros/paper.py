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
The published numbers of Liu 2015, and nothing else.

Source: AUTHORS, TITLE, JOURNAL; its DOI is DOI.
Units are micrometres, volts at the amplifier's input, radians per second and seconds.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    'AUTHORS',
    'COMPENSATED_NONLINEARITY_PERCENT',
    'DOI',
    'FEEDBACK_ACCEPTABLE_FREQUENCY_HZ',
    'HARMONICS',
    'JOURNAL',
    'KAPPA_UM_PER_V',
    'MAXIMUM_ERROR_300_HZ_UM',
    'SATURATION_V',
    'TABLE_1',
    'TABLE_2',
    'TABLE_3',
    'TABLE_4',
    'TITLE',
    'TrackingError',
    'UNCERTAINTY_BOUND',
    'UNCOMPENSATED_NONLINEARITY_PERCENT',
    'table_4',
    'uncertainty_magnitude',
]

AUTHORS: Final = 'Yanfang Liu, Jinjun Shan, Ulrich Gabbert'
TITLE: Final = (
    'Feedback/feedforward control of hysteresis-compensated piezoelectric actuators for high-speed '
    'scanning applications')
JOURNAL: Final = 'Smart Materials and Structures 24 (2015) 015012'
DOI: Final = '10.1088/0964-1726/24/1/015012'

# Table 1: kappa_i in um/V (n + 1 values, the last is the unlimited capacitor) and u_S,i in V.
KAPPA_UM_PER_V: Final = (
    3.5859, 8.5447, 11.4930, 34.5231, 15.7278, 22.6789, 32.5152, 41.3930, 180.1652, 24.6952, 1.2808,
)
SATURATION_V: Final = (
    0.0162, 0.0340, 0.0494, 0.0335, 0.0567, 0.0630, 0.0650, 0.0434, 0.0123, 0.1048,
)
TABLE_1: Final = {'kappa_um_per_v': KAPPA_UM_PER_V, 'saturation_v': SATURATION_V}

# Table 2: the linear dynamics (6) and the PI gains. Only the reading (s + 1/tau) of the sensor pole
# gives the dc gain 0.988 um/um.
TABLE_2: Final = {
    'damping_ratio_1': 0.632,
    'natural_frequency_1_rad_per_s': 1.529e4,
    'damping_ratio_2': 0.113,
    'natural_frequency_2_rad_per_s': 4.573e4,
    'zero_b1_rad_per_s': -3.470e4,
    'zero_b2_rad2_per_s2': 1.193e9,
    'time_constant_s': 1.5997e-4,
    'gain_k_rad3_per_s3': 2.531e12,
    'proportional_gain': 0.239,
    'integral_gain_per_s': 2.63e3,
}

# (19): gain (s + zero)^2 / ((s + pole_1)(s + pole_2)), poles and zero in rad/s.
UNCERTAINTY_BOUND: Final = {
    'gain': 1.075,
    'zero_rad_per_s': 1.885e3,
    'pole_1_rad_per_s': 4.712e3,
    'pole_2_rad_per_s': 1.257e4,
}

# Section 4: harmonics of the feedforward in the experiments, (13).
HARMONICS: Final = 9

# Section 5.2, Fig. 11: largest error of the 300 Hz triangle (its amplitude is not printed).
MAXIMUM_ERROR_300_HZ_UM: Final = {'ff': 0.22, 'fbff': 0.12}

# Fig. 5: nonlinearity without and with the inverse model, percent of peak to peak.
UNCOMPENSATED_NONLINEARITY_PERCENT: Final = {'input': 11.84, 'output': 13.14}
COMPENSATED_NONLINEARITY_PERCENT: Final = {'input': 0.40, 'output': 0.38}

# Table 3: amplitude (um) -> band of frequencies (Hz) at which FF and FBFF do equally well.
FEEDBACK_ACCEPTABLE_FREQUENCY_HZ: Final = {
    0.5: (450.0, 500.0),
    1.0: (550.0, 850.0),
    1.5: (650.0, 750.0),
    2.0: (650.0, 650.0),
    2.5: (550.0, 550.0),
}
TABLE_3: Final = FEEDBACK_ACCEPTABLE_FREQUENCY_HZ


class TrackingError(NamedTuple):
    """NRMSE of one cell pair of Table 4, percent of the peak-to-peak reference."""

    ff: float
    fbff: float


# Table 4: amplitude (um) -> frequency (Hz) -> NRMSE (%) of triangle tracking.
TABLE_4: Final = {
    0.5: {
        300.0: TrackingError(1.85, 1.45), 400.0: TrackingError(2.49, 2.07),
        500.0: TrackingError(2.30, 2.79), 600.0: TrackingError(3.12, 3.10),
        700.0: TrackingError(3.18, 3.50), 800.0: TrackingError(3.71, 4.03),
    },
    1.0: {
        300.0: TrackingError(1.99, 1.23), 400.0: TrackingError(2.39, 1.81),
        500.0: TrackingError(2.65, 2.18), 600.0: TrackingError(2.81, 2.45),
        700.0: TrackingError(2.99, 2.94), 800.0: TrackingError(3.32, 3.44),
    },
    1.5: {
        300.0: TrackingError(2.10, 1.19), 400.0: TrackingError(2.46, 1.72),
        500.0: TrackingError(2.78, 2.03), 600.0: TrackingError(2.71, 2.31),
        700.0: TrackingError(2.69, 2.73), 800.0: TrackingError(3.02, 4.20),
    },
    2.0: {
        300.0: TrackingError(2.10, 1.22), 400.0: TrackingError(2.51, 1.70),
        500.0: TrackingError(2.71, 2.07), 600.0: TrackingError(2.62, 2.47),
        700.0: TrackingError(3.05, 4.26), 800.0: TrackingError(4.39, 9.73),
    },
    2.5: {
        300.0: TrackingError(2.19, 1.29), 400.0: TrackingError(2.63, 1.79),
        500.0: TrackingError(2.63, 2.18), 600.0: TrackingError(2.57, 3.43),
        700.0: TrackingError(4.12, 8.75), 800.0: TrackingError(8.70, 10.2),
    },
}


def table_4(scheme: str, amplitude_um: float, frequency_hz: float) -> float | None:
    """
    Return the published NRMSE of a triangle scan.

    Parameters
    ----------
    scheme : str
        ``'ff'`` or ``'fbff'``; the paper tabulates no other.
    amplitude_um : float
        Peak amplitude of the triangle, micrometres.
    frequency_hz : float
        Fundamental frequency, hertz.

    Returns
    -------
    float or None
        Percent of the peak-to-peak reference (Table 4 in Liu 2015), None where it has no number.

    """
    row = TABLE_4.get(amplitude_um, {}).get(frequency_hz)
    if row is None or scheme not in row._fields:
        return None
    return float(getattr(row, scheme))


def uncertainty_magnitude(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """
    Return the published bound of the multiplicative uncertainty, |W| of (19) in Liu 2015.

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Frequencies, hertz.

    Returns
    -------
    ndarray, shape (N,)
        |W|, a share of |G|.

    """
    w = UNCERTAINTY_BOUND
    s = 2j * math.pi * np.asarray(frequency_hz, dtype=np.float64)
    return np.asarray(w['gain'] * np.abs((s + w['zero_rad_per_s']) ** 2 / (
        (s + w['pole_1_rad_per_s']) * (s + w['pole_2_rad_per_s']))))
