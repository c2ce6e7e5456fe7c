"""Identification: from arrays of recorded runs to models with standard errors."""

from piezo_ros.identification.dynamics import DynamicsFit, fit_dynamics
from piezo_ros.identification.frequency_response import (
    Amplifier,
    ExcludedPoint,
    FrequencyResponse,
    frequency_response,
    merge,
)
from piezo_ros.identification.harmonics import (
    HarmonicsChoice,
    HarmonicsPrediction,
    choose_harmonics,
)
from piezo_ros.identification.hysteresis import Coverage, HysteresisFit, fit_hysteresis
from piezo_ros.identification.hysteresis_comparison import ModelScore, compare_hysteresis_models
from piezo_ros.identification.loop_shape import LoopShape, PiLoop, loop_shape
from piezo_ros.identification.offline_excitation import run_excitation_offline
from piezo_ros.identification.operating_points import (
    FeedbackTable,
    OperatingPoint,
    feedback_table,
    predict_operating_point,
    predict_operating_points,
)
from piezo_ros.identification.scheme_choice import (
    SchemeChoice,
    SchemePrediction,
    crossing_frequency_hz,
    equal_error_frequency_hz,
    recommend_scheme,
)
from piezo_ros.identification.tuning import PiTuning, tune_pi
from piezo_ros.identification.uncertainty import UncertaintyBound, uncertainty_bound

__all__ = [
    'Amplifier',
    'Coverage',
    'DynamicsFit',
    'ExcludedPoint',
    'FeedbackTable',
    'FrequencyResponse',
    'HarmonicsChoice',
    'HarmonicsPrediction',
    'HysteresisFit',
    'LoopShape',
    'ModelScore',
    'OperatingPoint',
    'PiLoop',
    'PiTuning',
    'SchemeChoice',
    'SchemePrediction',
    'UncertaintyBound',
    'choose_harmonics',
    'compare_hysteresis_models',
    'crossing_frequency_hz',
    'equal_error_frequency_hz',
    'feedback_table',
    'fit_dynamics',
    'fit_hysteresis',
    'frequency_response',
    'loop_shape',
    'merge',
    'predict_operating_point',
    'predict_operating_points',
    'recommend_scheme',
    'run_excitation_offline',
    'tune_pi',
    'uncertainty_bound',
]
