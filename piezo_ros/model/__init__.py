"""The rig: hysteresis, linear dynamics, converters, noise, and the whole of them."""

from piezo_ros.model.dynamics import DynamicsParameters, LinearDynamics
from piezo_ros.model.hysteresis import HysteresisParameters, MaxwellResistiveCapacitor
from piezo_ros.model.parameters import ParameterError, ParameterSet
from piezo_ros.model.rig import Rig, RigParameters

__all__ = [
    'DynamicsParameters',
    'HysteresisParameters',
    'LinearDynamics',
    'MaxwellResistiveCapacitor',
    'ParameterError',
    'ParameterSet',
    'Rig',
    'RigParameters',
]
