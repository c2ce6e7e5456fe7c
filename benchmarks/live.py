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

"""The measurements that need ROS 2: live nodes and the transports beside them."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from benchmarks.footprint import footprint, service_latency_ms, start_beside_peers_s
from benchmarks.measurement import Measurement, Quantity, Ratio, higher, lower
from benchmarks.other_rings import TRANSPORTS, missing_transport
from benchmarks.rates import graph_rate, other_ring_rate, ring_rate
from piezo_ros.parameters.node_parameters import LOOP_NODES, check_node_parameters
from piezo_ros.parameters.run_and_result import PlannedRun

__all__ = ['LIVE', 'LIVE_RATIOS']

_COMPOSED_PERIODS: Final = 600.0
_SEPARATE_PERIODS: Final = 150.0
_BLOCK_PERIODS: Final = 60_000.0
_BLOCK_SAMPLES: Final = 1000
_BLOCK_ROUNDS: Final = 40_000
# Enough that neither the ring nor the graph waits for messages. With 80 the ring is as quick, but
# the graph leaves a quarter of two cores idle, as a new demand comes when half of the last one is
# used up.
_BLOCKS_IN_FLIGHT: Final = 320
# The demand leads by half of the look-ahead to all of it: by three quarters on average.
_LOOKAHEAD_SAMPLES: Final = _BLOCKS_IN_FLIGHT * _BLOCK_SAMPLES * 4 // 3
_SHORT_PERIODS: Final = 1.0
_ENDLESS_PERIODS: Final = 1e6
_OTHER_RING_ROUNDS: Final = 20_000
_LAYOUTS: Final = (('composed', True), ('separate', False))


def _planned(**nodes: Mapping[str, Any]) -> PlannedRun:
    return PlannedRun('bench', {
        node: check_node_parameters(node, nodes.get(node, {})) for node in LOOP_NODES})


def _closed_loop(*, composed: bool) -> PlannedRun:
    return _planned(trajectory={
        'periods': _COMPOSED_PERIODS if composed else _SEPARATE_PERIODS})


def _ring(*, composed: bool) -> tuple[float]:
    return (ring_rate(_closed_loop(composed=composed).trajectory.samples, composed=composed),)


def _graph(*, composed: bool, record: bool) -> tuple[float]:
    return (graph_rate(_closed_loop(composed=composed), composed=composed, record=record),)


def _other_ring(transport: str) -> tuple[float]:
    return (other_ring_rate(transport, _OTHER_RING_ROUNDS),)


def _ring_blocks(*, composed: bool) -> tuple[float]:
    return (ring_rate(
        _BLOCK_ROUNDS, composed=composed, block_samples=_BLOCK_SAMPLES,
        blocks_in_flight=_BLOCKS_IN_FLIGHT),)


def _graph_blocks(*, composed: bool) -> tuple[float]:
    planned = _planned(
        controller={'scheme': 'ff', 'lookahead_samples': _LOOKAHEAD_SAMPLES},
        trajectory={'periods': _BLOCK_PERIODS, 'block_samples': _BLOCK_SAMPLES})
    return (graph_rate(planned, composed=composed, record=False),)


def _footprint() -> tuple[float, float, float, float]:
    cost = footprint(_planned(trajectory={'periods': _SHORT_PERIODS}))
    return cost.start_s, cost.rss_mb, cost.pss_mb, cost.idle_percent


def _memory_compiled() -> tuple[float, float]:
    nodes: dict[str, dict[str, Any]] = {node: {'compiled': True} for node in LOOP_NODES}
    nodes['trajectory']['periods'] = _SHORT_PERIODS
    cost = footprint(_planned(**nodes))
    return cost.rss_mb, cost.pss_mb


def _start_beside_peers() -> tuple[float]:
    return (start_beside_peers_s(_planned(trajectory={'periods': _SHORT_PERIODS})),)


def _latency(*, composed: bool) -> tuple[float, float]:
    return service_latency_ms(
        _planned(trajectory={'periods': _ENDLESS_PERIODS}), composed=composed)


def _one(
    group: str, quantity: Quantity, measure: Callable[[], tuple[float]],
    missing: Callable[[], str] = lambda: '',
) -> Measurement:
    return Measurement(group, (quantity,), measure, missing)


LIVE: Final = (
    _one('composed', higher('ring_composed', 'loops/s'), partial(_ring, composed=True)),
    _one('composed', higher('graph_composed', 'loops/s'),
         partial(_graph, composed=True, record=False)),
    _one('composed', higher('graph_composed_recorded', 'loops/s'),
         partial(_graph, composed=True, record=True)),
    _one('separate', higher('ring_separate', 'loops/s'), partial(_ring, composed=False)),
    _one('separate', higher('graph_separate', 'loops/s'),
         partial(_graph, composed=False, record=False)),
    _one('separate', higher('graph_separate_recorded', 'loops/s'),
         partial(_graph, composed=False, record=True)),
    *(_one('separate', higher(f'ring_{transport}', 'loops/s'), partial(_other_ring, transport),
           partial(missing_transport, transport))
      for transport in TRANSPORTS),
    *(_one('blocks', higher(f'{what}_blocks_{layout}', 'samples/s'),
           partial(measure, composed=composed))
      for what, measure in (('ring', _ring_blocks), ('graph', _graph_blocks))
      for layout, composed in _LAYOUTS),
    Measurement(
        'footprint',
        (lower('start_four', 's'), lower('memory_four', 'MB'), lower('memory_four_pss', 'MB'),
         lower('idle_busiest', '% of a core')),
        _footprint),
    Measurement(
        'footprint',
        (lower('memory_four_compiled', 'MB'), lower('memory_four_compiled_pss', 'MB')),
        _memory_compiled),
    _one('footprint', lower('start_beside_peers', 's'), _start_beside_peers),
    *(Measurement(
        'services',
        (lower(f'latency_{layout}_median', 'ms'), lower(f'latency_{layout}_95', 'ms')),
        partial(_latency, composed=composed))
      for layout, composed in _LAYOUTS),
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
    *(Ratio(f'blocks_{layout}_over_ring', f'graph_blocks_{layout}', f'ring_blocks_{layout}',
            higher_is_better=True)
      for layout, _ in _LAYOUTS),
    Ratio('start_four_over_python_start', 'start_four', 'python_start', higher_is_better=False),
)
