"""What the printed numbers mean as functions, where more than one command needs it."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_ros import paper

__all__ = ['published_bound']


def published_bound(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """
    Return |W| of (19) in Liu 2015.

    Parameters
    ----------
    frequency_hz : array_like, shape (N,)
        Frequencies, hertz.

    """
    w = paper.UNCERTAINTY_BOUND
    s = 2j * math.pi * np.asarray(frequency_hz, dtype=np.float64)
    return np.asarray(w['gain'] * np.abs((s + w['zero_rad_per_s']) ** 2 / (
        (s + w['pole_1_rad_per_s']) * (s + w['pole_2_rad_per_s']))))
