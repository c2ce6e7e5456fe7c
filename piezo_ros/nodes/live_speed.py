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

"""What ``piezo bench`` measures of live nodes and of the transports beside them."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from piezo_ros.experiment.benchmark import Measurement, Quantity, Ratio
from piezo_ros.experiment.errors import CampaignError
from piezo_ros.experiment.node_parameters import check_node_parameters
from piezo_ros.experiment.plan import STAGES, PlannedRun
from piezo_ros.nodes.footprint import (
    footprint,
    service_latency_ms,
    start_beside_peers_s,
)
from piezo_ros.nodes.graph_speed import graph_rate, ring_rate
from piezo_ros.nodes.other_rings import HOPS, TRANSPORTS, missing_transport

__all__ = ['LIVE', 'LIVE_RATIOS']

_COMPOSED_PERIODS: Final = 600.0
_SEPARATE_PERIODS: Final = 150.0
_BLOCK_PERIODS: Final = 60_000.0
_BLOCK_SAMPLES: Final = 1000
_BLOCK_ROUNDS: Final = 40_000
# So many that neither waits for messages to come round: with twice as many, a tenth at most is won.
_BLOCKS_IN_FLIGHT: Final = 80
# The demand leads by half of that to all of it: three quarters on the average.
_LOOKAHEAD_SAMPLES: Final = _BLOCKS_IN_FLIGHT * _BLOCK_SAMPLES * 4 // 3
_SHORT_PERIODS: Final = 1.0
_ENDLESS_PERIODS: Final = 1e6
_OTHER_RING_ROUNDS: Final = 20_000
_RING_PATIENCE_S: Final = 120.0


def _planned(**stages: Mapping[str, Any]) -> PlannedRun:
    return PlannedRun('bench', {
        stage: check_node_parameters(stage, stages.get(stage, {})) for stage in STAGES})


def _closed_loop(*, composed: bool) -> PlannedRun:
    return _planned(trajectory={
        'periods': _COMPOSED_PERIODS if composed else _SEPARATE_PERIODS})


def _ring(*, composed: bool) -> tuple[float]:
    return (ring_rate(_closed_loop(composed=composed).trajectory.samples, composed=composed),)


def _graph(*, composed: bool, record: bool) -> tuple[float]:
    return (graph_rate(_closed_loop(composed=composed), composed=composed, record=record),)


def _other_ring(transport: str) -> tuple[float]:
    """Return the rounds per second of the ring over another transport."""
    with tempfile.TemporaryDirectory(prefix='piezo_ring_') as directory:
        processes = [
            subprocess.Popen(
                [sys.executable, '-m', 'piezo_ros.nodes.other_rings', transport,
                 str(_OTHER_RING_ROUNDS), str(hop), directory],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                text=True)
            for hop in range(HOPS)]
        try:
            outputs = [process.communicate(timeout=_RING_PATIENCE_S) for process in processes]
        except subprocess.TimeoutExpired:
            raise CampaignError(
                f'the {transport} ring did not end within {_RING_PATIENCE_S:g} s') from None
        finally:
            for process in processes:
                process.kill()
    if any(process.returncode for process in processes):
        raise CampaignError(
            f'the {transport} ring failed: ' + ' '.join(error for _, error in outputs))
    return (float(outputs[0][0]),)


def _ring_blocks(*, composed: bool) -> tuple[float]:
    return (ring_rate(
        _BLOCK_ROUNDS, composed=composed, block_samples=_BLOCK_SAMPLES,
        blocks_in_flight=_BLOCKS_IN_FLIGHT),)


def _graph_blocks(*, composed: bool) -> tuple[float]:
    planned = _planned(
        controller={'scheme': 'ff', 'lookahead_samples': _LOOKAHEAD_SAMPLES},
        trajectory={'periods': _BLOCK_PERIODS, 'block_samples': _BLOCK_SAMPLES})
    return (graph_rate(planned, composed=composed, record=False),)


def _footprint() -> tuple[float, float, float]:
    return footprint(_planned(trajectory={'periods': _SHORT_PERIODS}))


def _memory_compiled() -> tuple[float]:
    stages: dict[str, dict[str, Any]] = {stage: {'compiled': True} for stage in STAGES}
    stages['trajectory']['periods'] = _SHORT_PERIODS
    return (footprint(_planned(**stages)).memory_mb,)


def _start_beside_peers() -> tuple[float]:
    return (start_beside_peers_s(_planned(trajectory={'periods': _SHORT_PERIODS})),)


def _latency(*, composed: bool) -> tuple[float, float]:
    return service_latency_ms(
        _planned(trajectory={'periods': _ENDLESS_PERIODS}), composed=composed)


def _lower(*names_and_units: tuple[str, str]) -> tuple[Quantity, ...]:
    return tuple(Quantity(name, unit, higher_is_better=False) for name, unit in names_and_units)


def _rate(group: str, name: str, measure: Callable[[], tuple[float]],
          missing: Callable[[], str] = lambda: '') -> Measurement:
    return Measurement(
        group, (Quantity(name, 'loops/s', higher_is_better=True),), measure, missing)


LIVE: Final = (
    _rate('composed', 'ring_composed', partial(_ring, composed=True)),
    _rate('composed', 'graph_composed', partial(_graph, composed=True, record=False)),
    _rate('composed', 'graph_composed_recorded', partial(_graph, composed=True, record=True)),
    _rate('separate', 'ring_separate', partial(_ring, composed=False)),
    _rate('separate', 'graph_separate', partial(_graph, composed=False, record=False)),
    _rate('separate', 'graph_separate_recorded', partial(_graph, composed=False, record=True)),
    *(_rate('separate', f'ring_{transport}', partial(_other_ring, transport),
            partial(missing_transport, transport))
      for transport in TRANSPORTS),
    *(Measurement(
        'blocks',
        (Quantity(f'{what}_blocks_{label}', 'samples/s', higher_is_better=True),),
        partial(measure, composed=composed))
      for what, measure in (('ring', _ring_blocks), ('graph', _graph_blocks))
      for label, composed in (('composed', True), ('separate', False))),
    Measurement(
        'footprint',
        _lower(('start_four', 's'), ('memory_four', 'MB'), ('idle_busiest', '% of a core')),
        _footprint),
    Measurement('footprint', _lower(('memory_four_compiled', 'MB')), _memory_compiled),
    Measurement('footprint', _lower(('start_beside_peers', 's')), _start_beside_peers),
    *(Measurement(
        'services',
        _lower((f'latency_{label}_median', 'ms'), (f'latency_{label}_95', 'ms')),
        partial(_latency, composed=composed))
      for label, composed in (('composed', True), ('separate', False))),
)
LIVE_RATIOS: Final = (
    Ratio('composed_over_ring', 'graph_composed', 'ring_composed', higher_is_better=True),
    Ratio('separate_over_ring', 'graph_separate', 'ring_separate', higher_is_better=True),
    Ratio('composed_recorded_over_unrecorded', 'graph_composed_recorded', 'graph_composed',
          higher_is_better=True),
    Ratio('separate_recorded_over_unrecorded', 'graph_separate_recorded', 'graph_separate',
          higher_is_better=True),
    Ratio('separate_over_cyclone_ring', 'graph_separate', 'ring_cyclone', higher_is_better=True),
    Ratio('separate_over_socket_ring', 'graph_separate', 'ring_socket', higher_is_better=True),
    *(Ratio(f'blocks_{label}_over_ring', f'graph_blocks_{label}', f'ring_blocks_{label}',
            higher_is_better=True)
      for label in ('composed', 'separate')),
    Ratio('start_four_over_python_start', 'start_four', 'python_start', higher_is_better=False),
)
