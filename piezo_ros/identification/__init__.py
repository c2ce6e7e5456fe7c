"""Identification: from arrays of recorded runs to models with standard errors."""

from piezo_ros.identification.hysteresis import Coverage, HysteresisFit, fit_hysteresis
from piezo_ros.identification.hysteresis_comparison import ModelScore, compare_hysteresis_models

__all__ = [
    'Coverage',
    'HysteresisFit',
    'ModelScore',
    'compare_hysteresis_models',
    'fit_hysteresis',
]
