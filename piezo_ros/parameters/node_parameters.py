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
Every parameter of every node: the one source of defaults, descriptions and ranges.

The nodes declare these sets, plans and offline simulation check against them, and the tables of the
documentation are printed from them.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from piezo_ros.control import ControllerParameters, TrajectoryParameters
from piezo_ros.control.changes import ChangeParameters
from piezo_ros.model import CompensatorParameters, ParameterError, ParameterSet, RigParameters
from piezo_ros.model.parameters import parameter
from piezo_ros.parameters.hardware_parameters import HardwareParameters
from piezo_ros.streams import STREAMS
from piezo_ros.suggestions import did_you_mean

__all__ = [
    'LOOP_NODES',
    'NODE_PARAMETERS',
    'ONLOOKER_PARAMETERS',
    'PARAMETERS_OF_RCLPY',
    'PROGRAM_PARAMETERS',
    'BareParameters',
    'BlockParameters',
    'DemandParameters',
    'FileChangeParameters',
    'HARDWARE_PLANT',
    'HistoryParameters',
    'InitialiseParameters',
    'JoiningNodeParameters',
    'LearnerParameters',
    'LoopNodeParameters',
    'PaceParameters',
    'RecorderParameters',
    'SafetyParameters',
    'StampedParameters',
    'check_node_parameters',
    'is_of_rclpy',
    'parameter_names',
    'parameter_sets',
]


@dataclass(frozen=True, kw_only=True)
class LoopNodeParameters(ParameterSet):
    """What every managed node has, whatever it computes."""

    sample_period_s: float = parameter(
        1e-5, 's', 'simulated sample period; blocks with another one end the run',
        minimum=1e-9, maximum=1e3)
    start_index: int = parameter(
        0, '', 'index of the first sample; -1 takes any (replay from the middle)',
        minimum=-1, maximum=2**53)
    handshake_timeout_s: float = parameter(
        10.0, 's', 'how long activation waits for the peers; it goes slower on a busy machine',
        minimum=0.0, maximum=1e6)
    lost_writer_timeout_s: float = parameter(
        0.5, 's', 'how long an input may be without a writer during a run',
        minimum=0.0, maximum=1e6, change='running')
    required_readers: int = parameter(
        1, '', 'reliable readers that each output, with its copy, needs before the run starts: 2 '
        'with a recorder',
        minimum=0, maximum=1000)
    recorded_block_samples: int = parameter(
        0, 'samples', 'largest block of recorded/<stream>, a copy of each output for a recorder '
        'with from_copies; 0: no copies', minimum=0, maximum=10**6, change='configuration')
    compiled: bool = parameter(
        False, '', 'compute in compiled code: quicker for each sample, a second more to start')
    autostart: bool = parameter(
        True, '', 'configure and activate at start, without a lifecycle manager', change='start')
    linger_s: float = parameter(
        1.0, 's', 'how long the process stays after its run, so that its parameters and status can '
        'still be read; negative: until it is told to end',
        minimum=-1.0, maximum=1e6, change='running')
    monitor_rate_hz: float = parameter(
        20.0, 'Hz', 'wall-clock rate of monitor/<stream>, the newest sample of each output; 0: off',
        minimum=0.0, maximum=100.0, change='running')


@dataclass(frozen=True, kw_only=True)
class SafetyParameters(ParameterSet):
    """How the plant guards its voltage."""

    watchdog_s: float = parameter(
        2.0, 's', 'time without voltage after which the run ends; it goes slower on a busy machine',
        minimum=0.01, maximum=1e6, change='running')
    safe_slew_v_per_s: float = parameter(
        1000.0, 'V/s', 'how fast the voltage goes to zero deviation at the end',
        minimum=1.0, maximum=1e9, change='running')


@dataclass(frozen=True, kw_only=True)
class PaceParameters(ParameterSet):
    """How simulated time relates to the wall clock."""

    realtime_factor: float = parameter(
        0.0, '', 'simulated seconds per wall-clock second; 0: as fast as possible',
        minimum=0.0, maximum=1e6)
    publish_clock: bool = parameter(
        False, '', 'publish the simulated time on the topic clock, for one rig remapped to /clock',
        change='configuration')


@dataclass(frozen=True, kw_only=True)
class InitialiseParameters(ParameterSet):
    """How ~/initialise clears the history of the stage."""

    initialise_amplitude_v: float = parameter(
        0.0, 'V', 'first peak of the decaying triangle of ~/initialise; 0: up to the nearer rail',
        minimum=0.0, maximum=1e3, change='running')
    initialise_levels: int = parameter(
        100, '', 'periods of the decaying triangle', minimum=1, maximum=10_000, change='running')


@dataclass(frozen=True, kw_only=True)
class HistoryParameters(InitialiseParameters):
    """The state of the simulated stage at the start of a run."""

    keep_state: bool = parameter(
        False, '', 'begin a run where the one before has left the stage, as a real one does, '
        'instead of with a stage that was never driven; ~/initialise demagnetises it')


@dataclass(frozen=True, kw_only=True)
class BareParameters(ParameterSet):
    """How the plant is driven without a controller."""

    demand_lookahead_samples: int = parameter(
        0, 'samples', 'how far the demand of the plant leads its displacement; 0: the controller '
        'demands', minimum=0, maximum=10**9, change='configuration')


@dataclass(frozen=True, kw_only=True)
class DemandParameters(ParameterSet):
    """How far the trajectory may run ahead of the controller."""

    lookahead_samples: int = parameter(
        1000, 'samples', 'how far the demand leads the displacement', minimum=1, maximum=10**9)
    max_buffer_samples: int = parameter(
        10**6, 'samples', 'how much of a stream may wait; more is a fault',
        minimum=1, maximum=10**9)


@dataclass(frozen=True, kw_only=True)
class BlockParameters(ParameterSet):
    """In which blocks the trajectory sends, and which rigs it does not run ahead of."""

    block_samples: int = parameter(
        500, 'samples', 'largest block', minimum=1, maximum=10**6)
    lockstep_with: str = parameter(
        '', '', 'namespaces of other rigs, separated by commas, that must demand a sample as well '
        'before it is sent, as of the other axis of a scan: /x,/y; ../y is beside the own one',
        change='configuration')

    def check_together(self) -> None:
        """Refuse what is no namespace."""
        for namespace in self.rigs_in_step:
            if not re.fullmatch(r'(\.\.)?(/[A-Za-z_][A-Za-z0-9_]*)+', namespace):
                raise ParameterError(
                    f'lockstep_with has {namespace!r}, it must be a full namespace such as /x, or '
                    'one beside the own such as ../x')

    @property
    def rigs_in_step(self) -> tuple[str, ...]:
        """The namespaces as a tuple."""
        return tuple(name.strip() for name in self.lockstep_with.split(',') if name.strip())

    def namespaces_in_step(self, own: str) -> tuple[str, ...]:
        """Return the full namespaces, for a node in a namespace of its own."""
        beside = own.rpartition('/')[0]
        return tuple(
            beside + name[2:] if name.startswith('..') else name for name in self.rigs_in_step)


@dataclass(frozen=True, kw_only=True)
class FileChangeParameters(ParameterSet):
    """When another file is played that is set during a run."""

    apply_at_sample: int = parameter(
        -1, '', 'sample from which a file is played that the same atomic call sets during a run; '
        '-1: where it is nearest to the present one in the next repetition; holds for that call '
        'alone', minimum=-1, maximum=2**53, change='running')


@dataclass(frozen=True, kw_only=True)
class RecorderParameters(ParameterSet):
    """Where and what to record."""

    bag_directory: str = parameter(
        '', '', 'directory of the bag; must not exist; empty: named after date and time')
    streams: str = parameter(
        ','.join(STREAMS), '', 'streams to record, separated by commas', change='configuration')
    from_copies: bool = parameter(
        False, '', 'take recorded/<stream> in place of the streams themselves: hardly any load for '
        'the loop; needs recorded_block_samples in the other nodes', change='configuration')
    compression: str = parameter(
        'zstd', '', 'compression of the chunks', choices=('zstd', 'lz4', 'none'))
    flush_period_s: float = parameter(
        1.0, 's', 'wall-clock time after which what was recorded is on its way to the disk',
        minimum=0.01, maximum=1e6)
    parameters_timeout_s: float = parameter(
        3.0, 's', 'how long to wait for the parameters of the other nodes',
        minimum=0.0, maximum=1e6)

    parameters_file: str = parameter(
        '', '', 'parameter file of the other nodes, for what these do not tell themselves in time')
    bag_namespace: str = parameter(
        '', '', 'namespace that topics and nodes have in the bag in place of that of the recorder; '
        'empty: the same')

    def check_together(self) -> None:
        """Refuse streams that do not exist."""
        for stream in self.stream_names:
            if stream not in STREAMS:
                raise ParameterError(
                    f'streams has {stream!r}, allowed are {", ".join(STREAMS)}'
                    f'{did_you_mean(stream, STREAMS)}')

    @property
    def stream_names(self) -> tuple[str, ...]:
        """The streams as a tuple."""
        return tuple(name.strip() for name in self.streams.split(','))


@dataclass(frozen=True, kw_only=True)
class JoiningNodeParameters(LoopNodeParameters):
    """What a managed node has that may join a run at any sample."""

    start_index: int = parameter(
        -1, '', 'index of the first sample; -1 takes any: it may join a run that goes on',
        minimum=-1, maximum=2**53)


@dataclass(frozen=True, kw_only=True)
class LearnerParameters(ParameterSet):
    """What is learned of a running scan, and how long."""

    scan: str = parameter(
        '', '', 'the planned scan that the trajectory plays: what piezo plan or piezo learn wrote')
    directory: str = parameter(
        '', '', 'directory of the tables and of what came of them; must not exist; empty: named '
        'after date and time')
    runs: int = parameter(
        5, '', 'how many tables are measured at most, that of the scan included', minimum=1,
        maximum=1000)
    settling_s: float = parameter(
        0.02, 's', 'how long a table settles before it is measured, one repetition at least',
        minimum=0.0, maximum=1e6)
    from_copies: bool = parameter(
        False, '', 'take recorded/<stream> in place of the streams themselves: hardly any load for '
        'the loop; needs recorded_block_samples in the other nodes', change='configuration')
    parameters_timeout_s: float = parameter(
        10.0, 's', 'how long to wait for the parameters of trajectory and controller',
        minimum=0.0, maximum=1e6)


# Node -> its parameter sets, the model's first. Also the order of bring-up: readers before writers.
NODE_PARAMETERS: Final[Mapping[str, tuple[type[ParameterSet], ...]]] = {
    'recorder': (RecorderParameters, LoopNodeParameters),
    'learner': (LearnerParameters, JoiningNodeParameters),
    'compensator': (CompensatorParameters, LoopNodeParameters),
    'controller': (
        ControllerParameters, ChangeParameters, DemandParameters, LoopNodeParameters),
    'plant': (
        RigParameters, SafetyParameters, PaceParameters, HistoryParameters, BareParameters,
        LoopNodeParameters),
    'trajectory': (
        TrajectoryParameters, FileChangeParameters, BlockParameters, LoopNodeParameters),
}
# The program that drives hardware in the role of the plant.
HARDWARE_PLANT: Final = 'hardware_plant'
# Program in the role of a node -> its parameter sets, where they are not those of the role.
PROGRAM_PARAMETERS: Final[Mapping[str, tuple[type[ParameterSet], ...]]] = {
    HARDWARE_PLANT: (
        HardwareParameters, SafetyParameters, InitialiseParameters, BareParameters,
        LoopNodeParameters),
}
# The nodes of the control loop: all of them but recorder and learner.
LOOP_NODES: Final = ('compensator', 'controller', 'plant', 'trajectory')


@dataclass(frozen=True, kw_only=True)
class StampedParameters(ParameterSet):
    """What is offered as stamped messages, and with which stamp."""

    streams: str = parameter(
        ','.join(STREAMS), '', 'streams to offer on stamped/<stream>, separated by commas',
        change='start')
    rate_hz: float = parameter(
        25.0, 'Hz', 'wall-clock rate at which each stream is looked at; newest/<stream> itself '
        'comes with the monitor_rate_hz of its writer', minimum=0.1, maximum=1000.0,
        change='start')
    stamp: str = parameter(
        'auto', '', 'simulated: index times sample period; wall: when the writer showed the '
        'sample; auto: simulated with use_sim_time, else wall',
        choices=('auto', 'simulated', 'wall'), change='start')
    joint: str = parameter(
        'stage', '', 'name of the joint of which a stream in um is the position', change='start')
    frame_id: str = parameter('', '', 'frame_id of the header', change='start')

    def check_together(self) -> None:
        """Refuse streams that do not exist, and a joint without a name."""
        for name in self.stream_names:
            if name not in STREAMS:
                raise ParameterError(
                    f'streams has {name!r}, allowed are {", ".join(STREAMS)}'
                    f'{did_you_mean(name, STREAMS)}')
        if not self.joint:
            raise ParameterError("joint is '', it must be a name")

    @property
    def stream_names(self) -> tuple[str, ...]:
        """What is offered, as a tuple."""
        return tuple(name.strip() for name in self.streams.split(','))


# Node beside the loop, which is not managed -> its parameter sets.
ONLOOKER_PARAMETERS: Final[Mapping[str, tuple[type[ParameterSet], ...]]] = {
    'stamped': (StampedParameters,),
}


# What rclpy declares for every node, beside the qos_overrides of its endpoints.
PARAMETERS_OF_RCLPY: Final = ('use_sim_time', 'start_type_description_service')
_OF_ENDPOINTS: Final = 'qos_overrides'


def is_of_rclpy(name: str) -> bool:
    """Return whether rclpy itself declares a parameter of that name."""
    return name in PARAMETERS_OF_RCLPY or name.partition('.')[0] == _OF_ENDPOINTS


def parameter_names(node: str) -> tuple[str, ...]:
    """Return the names of every parameter of a node."""
    return tuple(
        name for parameter_set in parameter_sets(node) for name in parameter_set.names())


def parameter_sets(node: str) -> tuple[type[ParameterSet], ...]:
    """Return the parameter sets of a node, managed or onlooker, or of a program in its role."""
    return {**NODE_PARAMETERS, **ONLOOKER_PARAMETERS, **PROGRAM_PARAMETERS}[node]


def check_node_parameters(node: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return all parameters of a node, defaults filled in.

    Parameters
    ----------
    node : str
        One of `NODE_PARAMETERS`, `ONLOOKER_PARAMETERS` or `PROGRAM_PARAMETERS`.
    values : mapping of str to value
        Any subset of its parameters.

    Returns
    -------
    dict of str to value
        Every parameter of the node.

    Raises
    ------
    ParameterError
        If the node has no such parameter, or refuses the value.

    """
    complete: dict[str, Any] = {}
    known: list[str] = []
    for parameter_set in parameter_sets(node):
        names = parameter_set.names()
        known += names
        own = {name: value for name, value in values.items() if name in names}
        complete.update(parameter_set.from_mapping(own).to_mapping())
    for name in values:
        if name not in known:
            raise ParameterError(
                f'unknown parameter {name!r} of {node}; it has {", ".join(sorted(known))}'
                f'{did_you_mean(name, known)}')
    return complete
