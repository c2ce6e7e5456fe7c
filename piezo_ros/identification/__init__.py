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
Identification: from arrays of recorded runs to models, controller gains and predicted errors.

`hysteresis` and `response` fit models, with standard errors, `tuning` finds PI gains for them, and
`prediction` the tracking errors to expect with both.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from piezo_ros.identification.dynamics.dynamics_fit import DynamicsFit, fit_dynamics
    from piezo_ros.identification.hysteresis.hysteresis_fit import (
        Coverage,
        HysteresisFit,
        fit_hysteresis,
    )
    from piezo_ros.identification.hysteresis.models.model_comparison import (
        ModelScore,
        compare_hysteresis_models,
    )
    from piezo_ros.identification.prediction.operating_points import (
        HarmonicsChoice,
        OperatingPoint,
        choose_harmonics,
        equal_error_frequency_hz,
        feedback_table,
        predict_operating_point,
        predict_operating_points,
        recommend_scheme,
    )
    from piezo_ros.identification.prediction.tracking import TrackingPrediction, predict_tracking
    from piezo_ros.identification.response.frequency_response import (
        Amplifier,
        ExcludedPoint,
        FrequencyResponse,
        frequency_response,
        merge,
    )
    from piezo_ros.identification.response.offline_excitation import run_excitation_offline
    from piezo_ros.identification.response.uncertainty import UncertaintyBound, uncertainty_bound
    from piezo_ros.identification.tuning.feedback_table import (
        FeedbackTable,
        crossing_frequency_hz,
    )
    from piezo_ros.identification.tuning.loop_shape import LoopShape, loop_shape
    from piezo_ros.identification.tuning.pi_loop import PiLoop
    from piezo_ros.identification.tuning.pi_tuning import PiTuning, tune_pi

    HarmonicsPrediction = SchemePrediction = TrackingPrediction
    SchemeChoice = OperatingPoint

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
    'TrackingPrediction',
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
    'predict_tracking',
    'recommend_scheme',
    'run_excitation_offline',
    'tune_pi',
    'uncertainty_bound',
]

# Imported when they are asked for: all of them take a second, and a command needs a few.
_MODULES: Final = {
    'dynamics.dynamics_fit': ('DynamicsFit', 'fit_dynamics'),
    'hysteresis.hysteresis_fit': ('Coverage', 'HysteresisFit', 'fit_hysteresis'),
    'hysteresis.models.model_comparison': ('ModelScore', 'compare_hysteresis_models'),
    'prediction.operating_points': (
        'HarmonicsChoice', 'OperatingPoint', 'choose_harmonics', 'equal_error_frequency_hz',
        'feedback_table', 'predict_operating_point', 'predict_operating_points',
        'recommend_scheme'),
    'prediction.tracking': ('TrackingPrediction', 'predict_tracking'),
    'response.frequency_response': (
        'Amplifier', 'ExcludedPoint', 'FrequencyResponse', 'frequency_response', 'merge'),
    'response.offline_excitation': ('run_excitation_offline',),
    'response.uncertainty': ('UncertaintyBound', 'uncertainty_bound'),
    'tuning.feedback_table': ('FeedbackTable', 'crossing_frequency_hz'),
    'tuning.loop_shape': ('LoopShape', 'loop_shape'),
    'tuning.pi_loop': ('PiLoop',),
    'tuning.pi_tuning': ('PiTuning', 'tune_pi'),
}
# Former names of two result types, kept for programs that import them.
_FORMER: Final = {
    'HarmonicsPrediction': 'TrackingPrediction', 'SchemePrediction': 'TrackingPrediction',
    'SchemeChoice': 'OperatingPoint'}
_MODULE_OF: Final = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    current = _FORMER.get(name, name)
    if current not in _MODULE_OF:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.{_MODULE_OF[current]}'), current)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
