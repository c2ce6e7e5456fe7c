"""Identification: from arrays of recorded runs to models with standard errors."""

from piezo_ros.identification.dynamics import DynamicsFit, fit_dynamics
from piezo_ros.identification.frequency_response import (
    Amplifier,
    ExcludedPoint,
    FrequencyResponse,
    frequency_response,
    merge,
)
from piezo_ros.identification.hysteresis import Coverage, HysteresisFit, fit_hysteresis
from piezo_ros.identification.hysteresis_comparison import ModelScore, compare_hysteresis_models
from piezo_ros.identification.offline_excitation import run_excitation_offline
from piezo_ros.identification.uncertainty import UncertaintyBound, uncertainty_bound

__all__ = [
    'Amplifier',
    'Coverage',
    'DynamicsFit',
    'ExcludedPoint',
    'FrequencyResponse',
    'HysteresisFit',
    'ModelScore',
    'UncertaintyBound',
    'compare_hysteresis_models',
    'fit_dynamics',
    'fit_hysteresis',
    'frequency_response',
    'merge',
    'run_excitation_offline',
    'uncertainty_bound',
]
