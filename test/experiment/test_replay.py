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

import numpy as np
import pytest
import yaml

from piezo_ros.bag import BagError, BagWriter, read
from piezo_ros.control import ControllerParameters, simulate
from piezo_ros.experiment.offline import simulate_run
from piezo_ros.experiment.plan import read_plan
from piezo_ros.experiment.run_replay import replay
from piezo_ros.model import (
    DynamicsParameters,
    HysteresisParameters,
    ParameterError,
    RigParameters,
)
from piezo_ros.parameters.parameter_file import parameters_yaml

STREAMS = ('reference_um', 'feedforward_um', 'command_um', 'voltage_v', 'displacement_um')
OTHER_HYSTERESIS = HysteresisParameters(kappa_um_per_v=(3.0, 1.3), saturation_v=(0.1,))


@pytest.fixture
def planned(write_plan):
    return read_plan(write_plan(runs=[{
        'scheme': 'fbff', 'amplitude_um': 2.5, 'frequency_hz': 700.0, 'periods': 5,
        'controller': {'measurement_delay_samples': 2}, 'plant': {'seed': 7}}])).runs[0]


@pytest.fixture
def recorded(planned, tmp_path):
    simulate_run(planned, tmp_path / 'bag')
    return read(tmp_path / 'bag')


def write_bag(path, streams, parameters, *, start=0, namespace='/'):
    prefix = namespace.rstrip('/')
    topics = {stream: f'{prefix}/{stream}' for stream in streams}
    with BagWriter(path, topics=topics) as writer:
        if parameters is not None:
            writer.attach_parameters(parameters_yaml(namespace, parameters))
        for stream, values in streams.items():
            writer.write_block(stream, start, 1e-5, values)
            writer.write_block(stream, start + len(values), 1e-5, [])
    return read(path)


def streams_of(run):
    return {stream: run.whole(stream)[1] for stream in run.streams}


def test_with_nothing_replaced_the_recorded_bits_come_out(recorded):
    result = replay(recorded)
    for stream, again in zip(recorded.streams, result.streams, strict=True):
        assert recorded.whole(stream)[1].tobytes() == again.tobytes(), stream
    assert result.is_faithful
    assert result.overridden == ()
    assert result.assumed == {}


def test_other_gains_give_what_a_run_with_them_gives(recorded, planned):
    gains = planned.controller.replaced(proportional_gain=0.1, integral_gain_per_s=1000.0)
    result = replay(recorded, controller=gains)
    expected = simulate(planned.plant, planned.compensator, gains, planned.trajectory)
    for name in STREAMS:
        np.testing.assert_array_equal(getattr(result.streams, name), getattr(expected, name))
    assert result.overridden == ('controller',)
    assert result.is_faithful  # the bag's own loop is checked beside it
    assert not np.array_equal(result.streams.voltage_v, recorded.voltage_v)


def test_a_mapping_leaves_what_it_does_not_name_as_recorded(recorded, planned):
    tuned = {'proportional_gain': 0.1, 'integral_gain_per_s': 1000.0}
    result = replay(recorded, controller=tuned, plant={'slew_limit_v_per_s': 0.0})
    assert result.controller == planned.controller.replaced(**tuned)
    assert result.controller.measurement_delay_samples == 2  # the default is 1
    assert result.plant == planned.plant.replaced(slew_limit_v_per_s=0.0)
    assert result.overridden == ('controller', 'plant')


@pytest.mark.parametrize('scheme', ['fb', 'ff', 'open_loop'])
def test_another_scheme_gives_what_a_run_with_it_gives(recorded, planned, scheme):
    result = replay(recorded, scheme=scheme)
    expected = simulate(
        planned.plant, planned.compensator, planned.controller.replaced(scheme=scheme),
        planned.trajectory)
    np.testing.assert_array_equal(result.streams.displacement_um, expected.displacement_um)
    assert result.controller.scheme == scheme
    assert result.controller.measurement_delay_samples == 2
    assert result.overridden == ('scheme',)


def test_another_compensator_and_another_plant_take_their_place(recorded, planned):
    slow = planned.plant.replaced(slew_limit_v_per_s=5000.0)
    result = replay(recorded, compensator=OTHER_HYSTERESIS, plant=slow)
    expected = simulate(slow, OTHER_HYSTERESIS, planned.controller, planned.trajectory)
    np.testing.assert_array_equal(result.streams.voltage_v, expected.voltage_v)
    np.testing.assert_array_equal(result.streams.displacement_um, expected.displacement_um)
    assert result.overridden == ('compensator', 'plant')


def test_a_rig_that_behaved_otherwise_is_not_faithful(recorded, planned, tmp_path):
    streams = streams_of(recorded)
    streams['displacement'] = streams['displacement'].copy()
    streams['displacement'][400] = np.nextafter(streams['displacement'][400], 1.0)
    result = replay(write_bag(tmp_path / 'other', streams, planned.parameters))
    assert not result.is_faithful
    assert result.same_samples['displacement'] == 400
    assert result.same_samples['voltage'] == streams['voltage'].size


def test_a_cut_off_run_is_replayed_as_far_as_it_goes(recorded, planned, tmp_path):
    streams = {stream: values[:300] for stream, values in streams_of(recorded).items()}
    result = replay(write_bag(tmp_path / 'short', streams, planned.parameters))
    assert result.streams.voltage_v.size == 300
    assert result.is_faithful


def test_the_nodes_are_those_of_the_namespace_of_the_run(recorded, planned, tmp_path):
    run = write_bag(
        tmp_path / 'left', streams_of(recorded), planned.parameters, namespace='/left')
    assert replay(run).is_faithful
    run.parameters.update({
        f'/right/{node}': values for node, values in list(run.parameters.items())})
    for name in [name for name in run.parameters if name.startswith('/left/')]:
        del run.parameters[name]
    with pytest.raises(BagError, match='tells nothing of the controller in the namespace /left'):
        replay(run)


def test_a_missing_feedforward_is_made_from_the_trajectory(recorded, planned, tmp_path):
    streams = streams_of(recorded)
    del streams['feedforward']
    run = write_bag(tmp_path / 'without', streams, planned.parameters)
    assert replay(run).is_faithful
    del run.parameters['/trajectory']
    with pytest.raises(BagError, match='no stream feedforward, which the scheme needs'):
        replay(run)
    assert replay(run, scheme='fb').streams.feedforward_um.tolist() == [0.0] * recorded.samples


def test_a_foreign_bag_needs_every_node(recorded, planned, tmp_path):
    run = write_bag(tmp_path / 'foreign', streams_of(recorded), None)
    with pytest.raises(BagError, match=r'nothing of the controller .* \(nodes with parameters: no'):
        replay(run)
    with pytest.raises(BagError, match='nothing of the compensator'):
        replay(run, controller=ControllerParameters())
    with pytest.raises(BagError, match='nothing of the plant'):
        replay(run, controller=ControllerParameters(), compensator=HysteresisParameters())
    result = replay(
        run, controller=planned.controller, compensator=planned.compensator, plant=planned.plant)
    np.testing.assert_array_equal(
        result.streams.displacement_um, recorded.whole('displacement')[1])
    # Nothing is known of what was recorded, so nothing is claimed.
    assert not result.is_faithful
    assert result.same_samples == {}


def test_d10_a_rig_known_by_its_data_sheet_alone_is_refused_by_name(recorded, planned, tmp_path):
    """The defaults of what is not told are the hysteresis and the dynamics of another stage."""
    run = write_bag(tmp_path / 'foreign', streams_of(recorded), {
        node: values for node, values in planned.parameters.items() if node != 'plant'})
    sheet = {'travel_um': 100.0, 'operating_point_um': 50.0, 'slew_limit_v_per_s': 1500.0}
    with pytest.raises(BagError, match='the hysteresis of the rig is not known.* kappa_um_per_v'):
        replay(run, plant=sheet)
    with pytest.raises(BagError, match='the dynamics of the rig is not known.* gain_k_rad3_per_s'):
        replay(run, plant=sheet, hysteresis=OTHER_HYSTERESIS)
    part = {**sheet, **OTHER_HYSTERESIS.to_mapping(), 'damping_ratio_1': 0.5}
    with pytest.raises(BagError, match='tells gain_k_rad3_per_s3.*natural_frequency_2_rad_per_s'):
        replay(run, plant=part)
    dynamics = DynamicsParameters(
        dynamics='sections', pole_rates_rad_per_s=(2e3,), delay_s=1e-4)
    result = replay(run, plant=sheet, hysteresis=OTHER_HYSTERESIS, dynamics=dynamics)
    assert result.origins == {'hysteresis': 'model', 'dynamics': 'model'}
    assert result.plant.kappa_um_per_v == OTHER_HYSTERESIS.kappa_um_per_v
    assert result.plant.pole_rates_rad_per_s == (2e3,)
    assert result.plant.slew_limit_v_per_s == 1500.0
    own = {**sheet, **OTHER_HYSTERESIS.to_mapping(), **dynamics.to_mapping()}
    assert replay(run, plant=own).origins == {'hysteresis': 'plant', 'dynamics': 'plant'}
    assert replay(recorded).origins == {'hysteresis': 'bag', 'dynamics': 'bag'}


def test_d10_no_other_node_is_filled_with_another_stage_either(recorded, planned, tmp_path):
    run = write_bag(tmp_path / 'foreign', streams_of(recorded), None)
    given = {'plant': planned.plant, 'compensator': planned.compensator,
             'controller': planned.controller}
    for node, told, missing in (
        ('compensator', {'saturation_v': planned.compensator.saturation_v}, 'kappa_um_per_v'),
        ('controller', {'scheme': 'fb', 'integral_gain_per_s': 1.0}, 'proportional_gain'),
    ):
        with pytest.raises(BagError, match=f'the {node} that is given tells {missing}'):
            replay(run, **{**given, node: told})


def test_a_real_stage_needs_a_plant_only(recorded, planned, tmp_path):
    parameters = {**planned.parameters, 'plant': {'card': 'Dev1', 'channel': 3}}
    run = write_bag(tmp_path / 'real', streams_of(recorded), parameters)
    with pytest.raises(BagError, match='nothing of the plant'):
        replay(run)
    assert replay(run, plant=RigParameters()).overridden == ('plant',)


def test_parameters_that_the_bag_lacks_are_named(recorded, planned, tmp_path):
    controller = dict(planned.parameters['controller'])
    del controller['anti_windup']
    run = write_bag(
        tmp_path / 'older', streams_of(recorded),
        {**planned.parameters, 'controller': controller})
    assert replay(run).assumed == {'controller': ('anti_windup',)}
    assert replay(run, controller=ControllerParameters()).assumed == {}


def test_a_run_that_begins_later_is_refused(recorded, planned, tmp_path):
    run = write_bag(
        tmp_path / 'late', streams_of(recorded), planned.parameters, start=1000)
    with pytest.raises(BagError, match="begins at sample 1000 of the stream 'reference'"):
        replay(run)


def test_a_run_without_reference_is_refused(recorded, planned, tmp_path):
    streams = {name: streams_of(recorded)[name] for name in ('voltage', 'displacement')}
    with pytest.raises(BagError, match="no samples of the stream 'reference'"):
        replay(write_bag(tmp_path / 'bare', streams, planned.parameters))


def test_a_value_out_of_range_is_told_with_bag_and_node(recorded):
    recorded.parameters['/controller']['proportional_gain'] = -1.0
    with pytest.raises(ParameterError, match='bag: controller: proportional_gain is -1'):
        replay(recorded)


def test_a_scheme_that_does_not_exist_is_refused(recorded):
    with pytest.raises(ParameterError, match="scheme is 'pid'"):
        replay(recorded, scheme='pid')


def test_the_parameters_of_the_bag_are_read_as_yaml_writes_them(recorded):
    # What numpy or a list makes of numbers must not change a bit on the way through the bag.
    text = yaml.safe_dump(recorded.parameters)
    assert yaml.safe_load(text) == recorded.parameters
