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

"""The onlooker with stamped messages, seen by a foreign typed reader, and the loop beside it."""

import signal
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray

from piezo_ros.bag import STREAMS, MalformedBlockError, read
from piezo_ros.control import ControllerParameters, TrajectoryParameters, simulate
from piezo_ros.experiment.offline import simulated_streams
from piezo_ros.experiment.plan import read_plan
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.nodes.stamped_parts.stamped_messages import (
    Sample,
    joint_state_fields,
    newest_sample,
    time_of,
)
from piezo_ros.parameters.node_parameters import StampedParameters

EXAMPLE = Path(__file__).parents[2] / 'docs' / 'examples' / 'ros2_control'
PERIOD_S = 1e-5
PERIODS = 3.0
LONG = 3000.0
LOOP_NODES = ('compensator', 'controller', 'plant', 'trajectory')
SLOW = 0.01  # simulated seconds in one of the wall: 1000 samples a second


@pytest.fixture(scope='module')
def expected():
    samples = simulate(
        RigParameters(), HysteresisParameters(), ControllerParameters(),
        TrajectoryParameters(periods=PERIODS))
    return dict(zip(STREAMS, samples, strict=True))


@pytest.fixture
def listen(peer):
    """Collect what is offered, by stream."""
    def to(*streams):
        messages = {stream: [] for stream in streams}
        for stream, received in messages.items():
            # A volatile reader that is discovered after the run would never see its samples.
            peer.node.create_subscription(
                JointState, f'stamped/{stream}', received.append, QoSProfile(
                    depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        return messages
    return to


def nanoseconds(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def index_of(message):
    """Return k of a stamp that is k·Ts; another one is refused."""
    index = round(nanoseconds(message) / (PERIOD_S * 1e9))
    assert nanoseconds(message) == index * 10_000
    return index


def value_of(stream, message):
    """Return the number, in metres or volts; nothing else is in the message."""
    unit = STREAMS[stream]
    if unit == 'um':
        assert message.name == ['stage']
        assert not message.velocity
        assert not message.effort
        (metres,) = message.position
        return metres
    assert message.name == [f'stage_{stream}_{unit}']
    assert not message.position
    assert not message.velocity
    (volts,) = message.effort
    return volts


def check(stream, messages, samples):
    """Compare every message with the sample of its stamp."""
    indices = [index_of(message) for message in messages]
    assert np.all(np.diff(indices) > 0)
    values = [value_of(stream, message) for message in messages]
    scale = 1e6 if STREAMS[stream] == 'um' else 1.0
    np.testing.assert_array_equal(values, samples[indices] / scale)
    return indices


# -- numbers, without processes -------------------------------------------------------------------


@pytest.mark.parametrize(('index', 'period_s', 'time'), [
    (0, 1e-5, (0, 0)),
    (1, 1e-5, (0, 10_000)),
    (123_457, 1e-5, (1, 234_570_000)),
    (3, 1 / 3, (1, 0)),
    (2**31 - 1, 1.0, (2**31 - 1, 0)),
    (10**11 + 1, 1e-5, (1_000_000, 10_000)),
])
def test_the_stamp_of_a_sample_is_its_index_times_the_period(index, period_s, time):
    assert time_of(Sample(index, period_s, 0.5)) == time


def test_a_time_that_no_stamp_can_hold_is_refused_with_its_sample():
    with pytest.raises(ValueError, match='sample 2147483648 with a period of 1.0 s .* at most'):
        time_of(Sample(2**31, 1.0, 0.5))


@pytest.mark.parametrize('stream', STREAMS)
def test_a_length_is_a_position_in_metres_and_a_voltage_is_none(stream):
    fields = joint_state_fields(stream, 2.5, 'x')
    if stream == 'voltage':
        assert fields == {'name': ['x_voltage_v'], 'effort': [2.5]}
    else:
        assert fields == {'name': ['x'], 'position': [2.5e-6]}


def test_of_a_block_the_last_sample_counts(block):
    message = block('voltage', 7, [1.0, 2.0, -3.0])
    assert newest_sample('voltage', message) == Sample(9, PERIOD_S, -3.0)
    assert newest_sample('voltage', block('voltage', 10, [])) is None


@pytest.mark.parametrize('spoil', [
    lambda message: message.layout.dim.clear(),
    lambda message: setattr(message.layout.dim[0], 'label', 'voltage_um'),
    lambda message: setattr(message.layout, 'data_offset', 0),
    lambda message: setattr(message, 'data', [0.5, PERIOD_S, 1.0]),
    lambda message: setattr(message, 'data', [0.0, PERIOD_S, float('nan')]),
])
def test_what_is_no_block_of_the_stream_is_refused(block, spoil):
    message = block('voltage', 0, [1.0])
    spoil(message)
    with pytest.raises(MalformedBlockError, match='voltage'):
        newest_sample('voltage', message)


def test_the_example_of_ros2_control_reads_what_is_offered():
    robot = ElementTree.parse(EXAMPLE / 'stage.urdf').getroot()
    (joint,) = robot.findall('ros2_control/joint')
    assert joint.get('name') == robot.find('joint').get('name') == StampedParameters().joint
    assert [(each.tag, each.get('name')) for each in joint] == [('state_interface', 'position')]
    parameters = {each.get('name'): each.text for each in robot.iter('param')}
    assert parameters['joint_states_topic'] == '/stamped/displacement'
    rig = RigParameters()
    limit = robot.find('joint/limit')
    assert float(limit.get('upper')) == (rig.travel_um - rig.operating_point_um) / 1e6
    assert float(limit.get('lower')) == (rig.operating_point_um - rig.travel_um) / 1e6
    managed = yaml.safe_load((EXAMPLE / 'controllers.yaml').read_text())
    assert 'joint_state_broadcaster' in managed['controller_manager']['ros__parameters']


# -- processes ------------------------------------------------------------------------------------


def test_every_message_has_the_stamp_the_unit_and_the_value_of_its_sample(
        rig, peer, listen, expected):
    rig.measure()
    stamped = rig.node('stamped', stamp='simulated', frame_id='base', rate_hz=200.0)
    stamped.wait_for('the stamps are simulated time')
    messages = listen(*STREAMS)
    loop = rig.node(
        'loop', compiled='false', periods=PERIODS, realtime_factor=SLOW, monitor_rate_hz=100.0,
        lookahead_samples=20,  # else the reference is all sent before it is looked at
        autostart='false', handshake_timeout_s=60.0, linger_s=-1.0)
    last = {stream: samples.size - 1 for stream, samples in expected.items()}
    assert last['displacement'] == last['reference'] + 1

    def change_state(transition):
        for node in LOOP_NODES:
            assert peer.change_state(node, transition), peer.status(node)

    def run():
        change_state('activate')
        # What best effort loses on the way to it, that of the end too, is shown again.
        peer.wait(
            lambda: all(received and index_of(received[-1]) == last[stream]
                        for stream, received in messages.items()), 'the last sample of each stream')

    change_state('configure')
    # Discovery is not part of a run: what is shown of the first one began with the readers.
    run()
    change_state('deactivate')
    for received in messages.values():
        received.clear()
    run()
    for stream, received in messages.items():
        assert len(check(stream, received, expected[stream])) > 3
        assert {message.header.frame_id for message in received} == {'base'}
    loop.send(signal.SIGINT)
    assert loop.wait() == 0
    stamped.send(signal.SIGINT)
    assert stamped.wait() == 0
    for word in ('WARN', 'ERROR', 'Traceback'):
        assert word not in stamped.output


@pytest.mark.slow
def test_who_starts_late_sees_the_rest_and_the_next_run_too(rig, peer, listen):
    began_ns = time.time_ns()
    messages = listen('displacement', 'voltage')
    displacement = messages['displacement']
    numbers = []
    peer.node.create_subscription(
        Float64, 'monitor/displacement', lambda message: numbers.append(message.data),
        qos_profile_sensor_data)
    stamped = None
    for run in (1, 2):
        loop = rig.node('loop', compiled='false', periods=LONG, realtime_factor=SLOW)
        peer.wait(lambda: peer.status('plant').get('index', 0) > 100, 'samples')
        if stamped is None:
            assert not displacement
            stamped = rig.node('stamped')
        peer.wait(lambda: all(len(each) > 5 for each in messages.values()), f'run {run}')
        peer.wait(
            lambda: len({number / 1e6 for number in numbers}.intersection(
                value_of('displacement', message) for message in displacement)) > 2,
            'what the monitor shows too')
        loop.send(signal.SIGINT)
        assert loop.wait() == 0
        peer.forget('plant')
        stamps = [nanoseconds(message) for message in displacement]
        assert np.all(np.diff(stamps) > 0)
        assert began_ns < stamps[0]
        assert stamps[-1] < time.time_ns()
        for each in (numbers, *messages.values()):
            each.clear()
    stamped.send(signal.SIGTERM)
    assert stamped.wait() == 0
    for word in ('WARN', 'ERROR', 'Traceback'):
        assert word not in stamped.output


def test_it_is_no_reader_of_any_stream(rig, peer):
    rig.node('stamped').wait_for('offers')
    peer.wait(
        lambda: all(
            peer.node.count_subscribers(f'{rig.namespace}/newest/{stream}') == 1
            for stream in STREAMS), 'what it reads')
    assert [peer.node.count_subscribers(f'{rig.namespace}/{stream}') for stream in STREAMS] == [
        0] * len(STREAMS)


@pytest.mark.slow  # The values of every stream, above, are those of a loop alone.
def test_a_recorded_run_is_the_same_beside_it(rig, peer, listen, write_plan):
    stamped = rig.node('stamped', use_sim_time='true')
    stamped.wait_for('the stamps are simulated time')
    messages = listen('displacement')['displacement']
    plan = write_plan('fbff', periods=PERIODS)
    command = rig.piezo('run', plan, '-o', rig.directory / 'out', '--composed')
    peer.wait(lambda: command.exit_code is not None, 'the run')
    assert command.exit_code == 0, command.output
    run = read(rig.bag)
    (planned,) = read_plan(plan).runs
    samples = simulated_streams(planned)
    assert samples.keys() == STREAMS.keys()
    for stream in STREAMS:
        np.testing.assert_array_equal(run.whole(stream)[1], samples[stream])
    assert messages
    check('displacement', messages, run.whole('displacement')[1])
    assert stamped.exit_code is None


@pytest.mark.slow
def test_a_foreign_node_shows_its_newest_sample_itself(rig, peer, listen, block):
    messages = listen('displacement', 'voltage')
    displacement = messages['displacement']
    stamped = rig.node('stamped', streams='displacement,voltage', use_sim_time='true')
    peer.writer('voltage')
    stamped.wait_for(
        f'{rig.namespace}/voltage has a writer, but {rig.namespace}/newest/voltage has none')
    writer = peer.node.create_publisher(
        Float64MultiArray, 'newest/displacement', qos_profile_sensor_data)
    peer.wait(lambda: writer.get_subscription_count() == 1, 'its subscription')
    for message, shown in [
        (block('displacement', 0, [1.0, 2.0, 3.0]), (2, 3e-6)),
        (block('displacement', 4, [float('nan')]), None),
        (block('displacement', 3, []), None),
        (block('displacement', 3, [4.0]), (3, 4e-6)),
        (block('displacement', 2**53 - 1, [1.0], period_s=1e3), None),
        (block('displacement', 0, [5.0]), (0, 5e-6)),  # another run
    ]:
        def seen(shown=shown):
            return displacement and shown == (
                index_of(displacement[-1]), value_of('displacement', displacement[-1]))

        writer.publish(message)
        if shown:
            peer.wait(seen, f'{shown}')
        else:
            time.sleep(0.2)  # for it to be looked at alone
    assert len(displacement) == 3
    assert not messages['voltage']
    assert f'refused a message on {rig.namespace}/newest/displacement: sample 4' in stamped.output
    stamped.send(signal.SIGINT)
    assert stamped.wait() == 0


@pytest.mark.parametrize(('parameters', 'words'), [
    ({'streams': 'displacement,speed'}, "streams has 'speed', allowed are " + ', '.join(STREAMS)),
    ({'stamp': 'sim'}, "stamp is 'sim', allowed are auto, simulated, wall"),
    ({'rate_hz': 0.0}, 'rate_hz'),
    ({'joint': "''"}, "joint is '', it must be a name"),
    ({'qos_overrides.{namespace}/stamped/voltage.publisher.history': 'nonsense'}, 'nonsense'),
])
def test_parameters_that_cannot_be_are_refused_in_a_line(rig, parameters, words):
    stamped = rig.node('stamped', **{
        name.format(namespace=rig.namespace): value for name, value in parameters.items()})
    assert stamped.wait() == 1
    assert words in stamped.output
    assert 'stamped cannot start' in stamped.output
    assert 'Traceback' not in stamped.output


def test_its_help_lists_its_parameters(rig):
    process = rig.start_process('stamped', '--help')
    assert process.wait() == 0
    assert 'rate_hz (default 25.0 Hz)' in process.output
    assert 'managed' not in process.output


def test_without_the_message_package_it_says_what_to_install(rig, tmp_path):
    hidden = tmp_path / 'sensor_msgs'
    hidden.mkdir()
    (hidden / '__init__.py').write_text('raise ImportError("hidden by the test")')
    rig.environment['PYTHONPATH'] = f'{tmp_path}:{rig.environment["PYTHONPATH"]}'
    stamped = rig.node('stamped')
    assert stamped.wait() == 1
    assert 'sensor_msgs (hidden by the test)' in stamped.output
    assert 'sensor-msgs' in stamped.output
    assert 'Traceback' not in stamped.output
