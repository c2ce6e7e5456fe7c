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

"""``piezo identify`` on bags that this project did not write."""

import dataclasses
import os

import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from piezo_ros.bag import STREAMS, BagWriter, BlockCodec
from piezo_ros.cli.main import main
from piezo_ros.control import (
    ControllerParameters,
    TrajectoryParameters,
    simulate,
    simulate_bare,
)
from piezo_ros.model import HysteresisParameters, RigParameters
from piezo_ros.parameters.parameter_file import parameters_yaml
from piezo_ros.streams.message_type import DEFINITION, TYPE_HASH, TYPE_NAME

PERIOD_S = 1e-5
BLOCK_SAMPLES = 300
WALL_CLOCK_NS = 1_700_000_000_000_000_000
HYSTERESIS = HysteresisParameters(kappa_um_per_v=(4.0, 15.0, 1.3), saturation_v=(0.05, 0.2))
RIG = RigParameters(
    order='lumped', dac_bits=0, adc_bits=0, noise_rms_um=1e-5, **HYSTERESIS.to_mapping())
TRIANGLE = TrajectoryParameters(
    output='voltage', waveform='decreasing_triangle', harmonics=0, amplitude_v=3.0,
    frequency_hz=100.0, periods=10, sample_period_s=PERIOD_S)
STEPPED = TrajectoryParameters(
    waveform='stepped_sine', harmonics=0, amplitude_um=0.5, dwell_s=0.01, sample_period_s=PERIOD_S,
    frequencies_hz=(250.0, 400.0, 700.0, 1000.0, 1400.0, 1900.0, 2500.0, 3300.0))
# The excitation that was played, as in the parameter file of its user.
PLAYED = {
    'waveform': 'stepped_sine', 'harmonics': 0, 'amplitude_um': 0.5, 'dwell_s': 0.01,
    'frequencies_hz': list(STEPPED.frequencies_hz)}


def blocks(streams, start=0, size=BLOCK_SAMPLES):
    """Yield stream, index and samples in the order in which a run sends them, the end last."""
    longest = max(values.size for values in streams.values())
    for first in range(0, longest, size):
        for stream, values in streams.items():
            if values[first:first + size].size:
                yield stream, start + first, values[first:first + size]
    for stream, values in streams.items():
        yield stream, start + values.size, values[:0]


def record_ours(directory, streams, parameters):
    topics = {stream: f'/{stream}' for stream in streams}
    with BagWriter(directory, topics=topics) as writer:
        writer.attach_parameters(parameters_yaml('/', parameters))
        for stream, index, samples in blocks(streams):
            writer.write_block(stream, index, PERIOD_S, samples)


def record_rosbag2(directory, streams, *, start=0, extra=False, period_s=PERIOD_S):
    """Write a bag as `ros2 bag record -s mcap` does: wall-clock times, QoS, no record of ours."""
    directory.mkdir()
    qos = '- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2\n'
    counts: dict[str, int] = {}
    with (directory / f'{directory.name}_0.mcap').open('wb') as file:
        writer = Writer(file, chunk_size=20_000, compression=CompressionType.ZSTD)
        writer.start('ros2', 'libmcap 1.4.1')
        schema = writer.register_schema(TYPE_NAME, 'ros2msg', DEFINITION.encode())
        topics = [f'/{stream}' for stream in streams] + ['/battery'] * extra
        channels = {
            topic: writer.register_channel(topic, 'cdr', schema, {
                'offered_qos_profiles': qos, 'topic_type_hash': TYPE_HASH})
            for topic in topics}
        for number, (stream, index, samples) in enumerate(blocks(streams, start)):
            raw = BlockCodec(stream).encode(index, period_s, samples)
            for topic in [f'/{stream}'] + ['/battery'] * extra:
                writer.add_message(
                    channels[topic], WALL_CLOCK_NS + 70_000 * number, raw,
                    WALL_CLOCK_NS + 70_000 * number - 400, number)
                counts[topic] = counts.get(topic, 0) + 1
        writer.finish()
    (directory / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 9, 'storage_identifier': 'mcap', 'ros_distro': 'kilted',
        'duration': {'nanoseconds': 1}, 'message_count': sum(counts.values()),
        'starting_time': {'nanoseconds_since_epoch': WALL_CLOCK_NS},
        'relative_file_paths': [f'{directory.name}_0.mcap'],
        'compression_format': '', 'compression_mode': '', 'custom_data': None,
        'topics_with_message_count': [
            {'message_count': count, 'topic_metadata': {
                'name': topic, 'type': TYPE_NAME, 'serialization_format': 'cdr',
                'offered_qos_profiles': [{'history': 'keep_all', 'reliability': 'reliable'}],
                'type_description_hash': TYPE_HASH}}
            for topic, count in counts.items()]}}))


def record_rosbags(directory, streams):
    """Write typed messages with the library rosbags."""
    store = get_typestore(Stores.ROS2_JAZZY)
    array, layout, dimension = (store.types[f'std_msgs/msg/{name}'] for name in (
        'Float64MultiArray', 'MultiArrayLayout', 'MultiArrayDimension'))
    with RosbagsWriter(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            stream: writer.add_connection(f'/{stream}', TYPE_NAME, typestore=store)
            for stream in streams}
        for number, (stream, index, samples) in enumerate(blocks(streams)):
            message = array(
                layout=layout(
                    dim=[dimension(
                        label=f'{stream}_{STREAMS[stream]}', size=samples.size,
                        stride=samples.size)],
                    data_offset=2),
                data=np.concatenate(([index, PERIOD_S], samples)))
            writer.write(
                connections[stream], WALL_CLOCK_NS + number,
                store.serialize_cdr(message, TYPE_NAME))


RECORDERS = {'ros2 bag record': record_rosbag2, 'rosbags': record_rosbags}


@pytest.fixture(scope='module')
def bare():
    run = simulate_bare(RIG, TRIANGLE)
    return {'voltage': run.voltage_v, 'displacement': run.displacement_um}


@pytest.fixture(scope='module')
def compensated():
    run = simulate(RIG, HYSTERESIS, ControllerParameters(scheme='open_loop'), STEPPED)
    return dict(zip(STREAMS, run, strict=True))


@pytest.fixture
def played(tmp_path):
    path = tmp_path / 'played.yaml'
    path.write_text(yaml.safe_dump({'/**/trajectory': {'ros__parameters': PLAYED}}))
    return path


def identified(directory, kind, *arguments):
    """Run the command; return exit code and the identified parameters."""
    output = directory / 'model.yaml'
    if kind == 'hysteresis':
        arguments = ('--elements', '2', *arguments)
    elif kind == 'dynamics':
        arguments = ('--structure', 'liu', *arguments)  # to compare its parameters
    code = main(['identify', kind, *map(str, arguments), '-o', str(output), '--force'])
    return code, yaml.safe_load(output.read_text()) if code in (0, 3) else None


@pytest.fixture
def identify(tmp_path, capsys):
    """Run the command; return exit code, identified parameters and output."""
    def run(kind, *arguments):
        code, model = identified(tmp_path, kind, *arguments)
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, model, out + err

    return run


@pytest.fixture(scope='module')
def own_hysteresis(tmp_path_factory, bare):
    directory = tmp_path_factory.mktemp('hysteresis')
    record_ours(directory / 'ours', bare, {'trajectory': TRIANGLE.to_mapping()})
    code, model = identified(directory, 'hysteresis', directory / 'ours')
    assert code == 0
    return model


@pytest.fixture(scope='module')
def own_dynamics(tmp_path_factory, compensated):
    directory = tmp_path_factory.mktemp('dynamics')
    record_ours(directory / 'ours', compensated, {
        'trajectory': STEPPED.to_mapping(), 'plant': RIG.to_mapping()})
    code, model = identified(directory, 'dynamics', directory / 'ours')
    assert code == 0
    return model


@pytest.mark.parametrize('recorder', RECORDERS)
def test_the_hysteresis_is_that_of_our_own_bag(tmp_path, bare, own_hysteresis, identify, recorder):
    RECORDERS[recorder](tmp_path / 'bag', bare)
    assert identify('hysteresis', tmp_path / 'bag')[:2] == (0, own_hysteresis)
    found = own_hysteresis['/**/compensator']['ros__parameters']
    assert found['kappa_um_per_v'][-1] == pytest.approx(
        RIG.dc_gain * HYSTERESIS.kappa_um_per_v[-1], rel=0.02)


@pytest.mark.parametrize('recorder', RECORDERS)
def test_the_dynamics_are_those_of_our_own_bag_where_the_trajectory_is_told(
    tmp_path, compensated, own_dynamics, identify, played, recorder,
):
    RECORDERS[recorder](tmp_path / 'bag', compensated)
    code, model, _ = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert (code, model) == (0, own_dynamics)
    found = own_dynamics['/**/trajectory']['ros__parameters']
    assert found['natural_frequency_1_rad_per_s'] == pytest.approx(
        RIG.natural_frequency_1_rad_per_s, rel=0.05)


def test_an_extra_topic_changes_nothing(tmp_path, bare, own_hysteresis, identify):
    record_rosbag2(tmp_path / 'bag', bare, extra=True)
    assert identify('hysteresis', tmp_path / 'bag')[:2] == (0, own_hysteresis)


def test_several_bags_are_identified_together(tmp_path, bare, own_hysteresis, identify):
    record_rosbag2(tmp_path / 'one', bare)
    record_rosbags(tmp_path / 'two', {name: -values for name, values in bare.items()})
    code, model, _ = identify('hysteresis', tmp_path / 'one', tmp_path / 'two')
    assert code == 0
    both, one = (
        each['/**/compensator']['ros__parameters']['kappa_um_per_v']
        for each in (model, own_hysteresis))
    assert both == pytest.approx(one, rel=0.05)
    assert both != one


def test_a_missing_stream_is_named(tmp_path, bare, compensated, identify, played):
    record_rosbag2(tmp_path / 'a', {'voltage': bare['voltage']})
    code, _, said = identify('hysteresis', tmp_path / 'a')
    assert code == 1
    assert "no samples of the stream 'displacement'" in said
    assert 'its topics are /voltage' in said
    record_rosbag2(tmp_path / 'b', {
        name: values for name, values in compensated.items() if name != 'command'})
    code, _, said = identify('dynamics', tmp_path / 'b', '--trajectory', played)
    assert code == 1
    assert "no samples of the stream 'command'" in said


def test_of_unequal_lengths_the_common_samples_are_used(tmp_path, bare, identify):
    short = {'voltage': bare['voltage'], 'displacement': bare['displacement'][:-2500]}
    record_rosbag2(tmp_path / 'unequal', short)
    record_rosbag2(tmp_path / 'equal', {name: values[:7501] for name, values in short.items()})
    code, model, _ = identify('hysteresis', tmp_path / 'unequal')
    assert code == 0
    assert identify('hysteresis', tmp_path / 'equal')[:2] == (0, model)


def test_a_displacement_that_is_no_number_is_left_out_of_the_hysteresis(
    tmp_path, bare, own_hysteresis, identify,
):
    gaps = {name: values.copy() for name, values in bare.items()}
    gaps['displacement'][[10, 4000, 4001, 9000]] = np.nan
    record_rosbag2(tmp_path / 'bag', gaps)
    code, model, said = identify('hysteresis', tmp_path / 'bag')
    assert code == 0
    assert 'left out of bag: 4 samples that are no numbers' in said
    found, whole = (
        each['/**/compensator']['ros__parameters']['kappa_um_per_v']
        for each in (model, own_hysteresis))
    assert found == pytest.approx(whole, rel=0.01)


def test_a_voltage_that_is_no_number_is_named(tmp_path, bare, identify):
    gaps = {name: values.copy() for name, values in bare.items()}
    gaps['voltage'][4000] = np.nan
    record_rosbag2(tmp_path / 'bag', gaps)
    code, _, said = identify('hysteresis', tmp_path / 'bag')
    assert code == 1
    assert 'voltage_v[4000] is nan, it must be finite' in said


def test_d8_for_the_dynamics_a_sample_that_is_no_number_is_named_and_costs_no_frequency(
    tmp_path, compensated, own_dynamics, identify, played,
):
    gaps = {name: values.copy() for name, values in compensated.items()}
    samples = gaps['displacement'].size
    places = [5, round(0.5 * samples), round(0.85 * samples)]  # the first before any window
    gaps['displacement'][places] = np.nan
    record_rosbag2(tmp_path / 'bag', gaps)
    words = "sample 5 of stream 'displacement' is nan, it must be finite; 3 of"
    code, model, said = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert code == 3
    assert words in said
    assert 'left out of bag' not in said
    assert said.count('lost of bag: ') == 2
    assert 'lost of bag: outside of all frequencies: 2 samples are lost, from sample 5' in said
    name = 'natural_frequency_2_rad_per_s'
    assert model['/**/trajectory']['ros__parameters'][name] == pytest.approx(
        own_dynamics['/**/trajectory']['ros__parameters'][name], rel=1e-3)
    code, _, said = identify(
        'dynamics', tmp_path / 'bag', '--trajectory', played, '--no-allow-loss', '--force')
    assert code == 1
    assert words in said


def test_d8_a_gap_costs_the_frequencies_that_it_touches(
    tmp_path, compensated, own_dynamics, identify, played, monkeypatch,
):
    lost = range(49 * BLOCK_SAMPLES, 55 * BLOCK_SAMPLES)

    all_blocks = blocks

    def with_gap(streams, start=0):
        for stream, index, samples in all_blocks(streams, start):
            if stream != 'displacement' or index not in lost:
                yield stream, index, samples

    monkeypatch.setitem(record_rosbag2.__globals__, 'blocks', with_gap)
    record_rosbag2(tmp_path / 'bag', compensated)
    code, model, said = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert code == 3
    assert "stream 'displacement' has 1 gap of 1800 samples, the first from index 14700" in said
    assert 1 <= said.count('left out of bag') + said.count('lost of bag') <= 4
    name = 'natural_frequency_2_rad_per_s'
    assert model['/**/trajectory']['ros__parameters'][name] == pytest.approx(
        own_dynamics['/**/trajectory']['ros__parameters'][name], rel=0.01)


def cut(directory, share):
    (file,) = directory.glob('*.mcap')
    os.truncate(file, round(share * file.stat().st_size))
    (directory / 'metadata.yaml').unlink()  # a killed recorder has not written it yet


def test_of_a_cut_file_the_whole_part_is_identified_and_the_loss_is_told(
    tmp_path, bare, own_hysteresis, identify,
):
    record_rosbag2(tmp_path / 'bag', bare)
    cut(tmp_path / 'bag', 0.8)
    code, _, said = identify('hysteresis', tmp_path / 'bag', '--no-allow-loss')
    assert code == 1
    assert 'is damaged' in said
    code, model, said = identify('hysteresis', tmp_path / 'bag')
    assert code == 3
    assert 'bag_0.mcap' in said
    part, whole = (
        each['/**/compensator']['ros__parameters']['kappa_um_per_v'][-1]
        for each in (model, own_hysteresis))
    assert part == pytest.approx(whole, rel=0.02)
    assert part != whole


def test_of_a_cut_stepped_sine_the_frequencies_that_are_lost_are_listed(
    tmp_path, compensated, identify, played,
):
    record_rosbag2(tmp_path / 'bag', compensated)
    cut(tmp_path / 'bag', 0.85)
    code, _, said = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert code == 3
    lost = [line for line in said.splitlines() if line.startswith('left out of bag: ')]
    assert 1 <= len(lost) <= 3
    assert 'Hz: the record does not hold it as a whole' in lost[-1]


def test_a_recorder_that_joined_late_misses_the_first_frequencies_only(
    tmp_path, compensated, own_dynamics, identify, played,
):
    late = 12_000  # in the middle of the first
    record_rosbag2(
        tmp_path / 'bag',
        {name: values[late:] for name, values in compensated.items()}, start=late)
    code, model, said = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert code == 0
    assert said.count('249.922 Hz: the record does not hold it as a whole') == 1
    assert said.count('left out of bag') == 1
    name = 'natural_frequency_2_rad_per_s'
    assert model['/**/trajectory']['ros__parameters'][name] == pytest.approx(
        own_dynamics['/**/trajectory']['ros__parameters'][name], rel=1e-3)


def test_without_its_trajectory_the_frequencies_of_a_foreign_bag_are_found_in_its_record(
    tmp_path, compensated, own_dynamics, identify,
):
    record_rosbag2(tmp_path / 'bag', compensated)
    code, model, said = identify('dynamics', tmp_path / 'bag')
    assert code == 0
    assert 'bag: excitation by the record itself: stepped, 8 frequencies' in said
    for name in ('natural_frequency_1_rad_per_s', 'natural_frequency_2_rad_per_s'):
        assert model['/**/trajectory']['ros__parameters'][name] == pytest.approx(
            own_dynamics['/**/trajectory']['ros__parameters'][name], rel=0.02)


@pytest.mark.parametrize(('change', 'exit_code', 'complaint'), [
    ({'waveform': 'triangle'}, 1, "waveform is 'triangle', allowed are stepped_sine, multisine"),
    ({'sample_period_s': 2e-5}, 1, 'has the sample period 1e-05 s, its trajectory 2e-05 s'),
    ({'frequencies_hz': [333.0, 555.0, 777.0, 888.0, 1111.0]}, 1, 'the input does not contain'),
    ({'dwell': 0.01}, 2, "unknown parameter 'dwell' of trajectory"),
])
def test_another_trajectory_than_the_one_played_is_refused(
    tmp_path, compensated, identify, played, change, exit_code, complaint,
):
    record_rosbag2(tmp_path / 'bag', compensated)
    played.write_text(yaml.safe_dump(
        {'/**/trajectory': {'ros__parameters': {**PLAYED, **change}}}))
    code, _, said = identify('dynamics', tmp_path / 'bag', '--trajectory', played)
    assert code == exit_code
    assert complaint in said


def test_points_at_which_the_amplifier_slews_are_left_out_once_its_limit_is_told(
    tmp_path, compensated, identify, played,
):
    record_rosbag2(tmp_path / 'bag', compensated)
    step_v = np.abs(np.diff(compensated['voltage'])).max()
    code, _, said = identify(
        'dynamics', tmp_path / 'bag', '--trajectory', played,
        '--slew-limit-v-per-s', 0.9 * step_v / PERIOD_S)
    assert code == 0
    assert [line.split(':')[1].strip() for line in said.splitlines() if 'slews' in line] == [
        '3300 Hz']


def test_one_trajectory_tells_of_a_whole_grid_of_foreign_bags(
    tmp_path, compensated, own_dynamics, identify, played,
):
    model = tmp_path / 'dynamics.yaml'
    model.write_text(yaml.safe_dump(own_dynamics))
    for number, offset_um in enumerate((-0.5, 0.5)):
        run = simulate(
            dataclasses.replace(RIG, gain_mismatch=0.02 + 0.01 * number), HYSTERESIS,
            ControllerParameters(scheme='open_loop'), STEPPED.replaced(offset_um=offset_um))
        record_rosbag2(tmp_path / f'grid_{number}', dict(zip(STREAMS, run, strict=True)))
    bags = (tmp_path / 'grid_0', tmp_path / 'grid_1')
    code, bound, said = identify(
        'uncertainty', *bags, '--model', model, '--trajectory', played)
    assert code == 0
    assert 'above every one of 16 points' in said
    numerator, denominator = bound['numerator'], bound['denominator']
    assert 0.0295 <= numerator[-1] / denominator[-1] <= 0.06
    assert identify(
        'uncertainty', *bags, '--model', model, '--trajectory', played, '--trajectory', played,
    )[0] == 0
    code, _, said = identify(
        'uncertainty', *bags, '--model', model, *('--trajectory', played) * 3)
    assert code == 2
    assert '--trajectory is given 3 times for 2 bags' in said


def test_bags_of_different_sample_periods_are_not_mixed(tmp_path, bare, identify):
    record_rosbag2(tmp_path / 'one', bare)
    record_rosbag2(tmp_path / 'two', bare, period_s=2e-5)
    code, _, said = identify('hysteresis', tmp_path / 'one', tmp_path / 'two')
    assert code == 1
    assert 'has the sample period 2e-05 s' in said
