"""Identification: from arrays of recorded runs to models with standard errors."""

from piezo_ros.identification.dynamics import DynamicsFit, fit_dynamics
from piezo_ros.identification.excitation import (
    Excitation,
    Window,
    multisine,
    odd_lines,
    run_excitation_offline,
    stepped_sine,
)
from piezo_ros.identification.frequency_response import (
    Amplifier,
    ExcludedPoint,
    FrequencyResponse,
    frequency_response,
    merge,
)
from piezo_ros.identification.hysteresis import Coverage, HysteresisFit, fit_hysteresis
from piezo_ros.identification.hysteresis_comparison import ModelScore, compare_hysteresis_models
from piezo_ros.identification.uncertainty import UncertaintyBound, uncertainty_bound

__all__ = [
    'Amplifier',
    'Coverage',
    'DynamicsFit',
    'Excitation',
    'ExcludedPoint',
    'FrequencyResponse',
    'HysteresisFit',
    'ModelScore',
    'UncertaintyBound',
    'Window',
    'compare_hysteresis_models',
    'fit_dynamics',
    'fit_hysteresis',
    'frequency_response',
    'merge',
    'multisine',
    'odd_lines',
    'run_excitation_offline',
    'stepped_sine',
    'uncertainty_bound',
]
