"""Waveforms, feedforward, the PI controller with its schemes, and the loop closed offline."""

from piezo_ros.control.closed_loop import BareRun, ClosedLoopRun, simulate, simulate_bare
from piezo_ros.control.controller import SCHEMES, ControllerParameters
from piezo_ros.control.trajectory import TrajectoryParameters
from piezo_ros.control.waveform import WAVEFORMS

__all__ = [
    'SCHEMES',
    'WAVEFORMS',
    'BareRun',
    'ClosedLoopRun',
    'ControllerParameters',
    'TrajectoryParameters',
    'simulate',
    'simulate_bare',
]
