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

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from piezo_ros.cli.main import main
from piezo_ros.control import ControllerParameters
from piezo_ros.model import DynamicsParameters, HysteresisParameters, LinearDynamics
from piezo_ros.parameters.parameter_file import read_parameter_file

ROOT = Path(__file__).resolve().parents[2]


def dynamics(directory, **changes):
    path = directory / 'trajectory.yaml'
    values = DynamicsParameters(**changes).to_mapping()
    path.write_text(yaml.safe_dump({'/**/trajectory': {'ros__parameters': values}}))
    return path


@pytest.fixture
def model(tmp_path):
    return dynamics(tmp_path)


@pytest.fixture
def output(tmp_path):
    return tmp_path / 'controller.yaml'


@pytest.fixture
def tune(output, capsys):
    def run(*arguments, points=('--no-operating-points',)):
        code = main(['tune', *map(str, (*arguments, *points)), '-o', str(output)])
        out, err = capsys.readouterr()
        assert 'Traceback' not in err
        return code, out, err

    return run


def table(text):
    """Return title to the values of start, tuned and Table 2."""
    rows = text.partition('Table 2\n')[2].partition('active limits')[0].splitlines()
    return {line[:28].strip(): line[28:64].split() for line in rows}


def test_the_gains_stand_beside_those_of_the_paper(model, tune):
    code, out, _ = tune(model)
    assert code == 0
    assert 'sampled every 1e-05 s, measurement 1e-05 s old, W(s): (19) of the paper' in out
    rows = table(out)
    published = {name: values[2] for name, values in rows.items()}
    assert (published['kP'], published['kI']) == ('0.239', '2630')
    assert rows.keys() >= {
        'gain margin', 'phase margin', 'delay margin', 'bandwidth', 'max |S|', 'max |W T|',
        'feedback acceptable below', 'stable'}
    # The continuous loop of the paper reaches 425 Hz; the delay costs a little.
    assert float(published['feedback acceptable below']) == pytest.approx(425.0, rel=0.05)
    assert float(rows['feedback acceptable below'][1]) > float(
        published['feedback acceptable below'])
    assert float(rows['max |W T|'][1]) < 1.0
    assert rows['stable'] == ['yes'] * 3


def test_the_file_is_one_that_the_controller_loads(model, tune, output):
    code, out, _ = tune(model)
    values = read_parameter_file(output, ['controller'])['controller']
    gains = ControllerParameters.from_mapping(values)
    assert code == 0
    rows = table(out)
    assert gains.proportional_gain == pytest.approx(float(rows['kP'][1]), rel=1e-4)
    assert gains.integral_gain_per_s == pytest.approx(float(rows['kI'][1]), rel=1e-4)
    assert f'# source: {model}' in output.read_text()


def test_a_tighter_limit_on_the_sensitivity_is_kept_and_named(model, tune):
    code, out, _ = tune(model, '--max-sensitivity', 1.3)
    assert code == 0
    assert float(table(out)['max |S|'][1]) <= 1.3
    assert 'active limits: max_sensitivity' in out


def test_a_bound_of_ones_own_takes_the_place_of_the_published_one(model, tune, tmp_path):
    bound = tmp_path / 'bound.yaml'
    bound.write_text(yaml.safe_dump({
        'format_version': 1, 'kind': 'uncertainty_bound',
        'numerator': [1.5, 1.0], 'denominator': [1.0, 10.0]}))
    code, out, _ = tune(model, '--bound', bound)
    assert code == 0
    assert f'W(s): {bound}' in out
    # Below 1, else it were refused; the table rounds it.
    assert float(table(out)['max |W T|'][1]) <= 1.0
    assert 'active limits: uncertainty_limit' in out


@pytest.mark.parametrize(('content', 'complaint'), [
    ({'format_version': 1}, 'is no uncertainty_bound'),
    ({'format_version': 2, 'kind': 'uncertainty_bound'}, 'format_version is 2, only 1 is known'),
    ({'format_version': 1, 'kind': 'uncertainty_bound'}, "'numerator'")])
def test_a_bound_of_another_kind_is_refused(model, tune, tmp_path, output, content, complaint):
    bound = tmp_path / 'bound.yaml'
    bound.write_text(yaml.safe_dump(content))
    code, _, err = tune(model, '--bound', bound)
    assert code == 2
    assert complaint in err
    assert not output.exists()


def test_of_a_loop_that_the_published_gains_make_unstable_no_margin_is_shown(tmp_path, tune):
    slow = dynamics(
        tmp_path, natural_frequency_2_rad_per_s=1885.0, damping_ratio_2=0.05,
        natural_frequency_1_rad_per_s=5027.0, time_constant_s=3.2e-4, zero_b1_rad_per_s=-6000.0,
        zero_b2_rad2_per_s2=1.44e8, gain_k_rad3_per_s3=1.99e9)
    code, out, _ = tune(slow, '--sample-period-s', 1e-4)
    assert code == 0
    rows = table(out)
    assert rows['stable'] == ['yes', 'yes', 'no']
    for name in ('gain margin', 'bandwidth', 'max |S|'):
        assert rows[name][2] == '–'
        assert float(rows[name][1]) > 0.0
    assert float(rows['kI'][1]) < 500.0


def test_gains_are_not_overwritten_unasked(model, tune, output):
    output.write_text('years of work')
    code, _, err = tune(model)
    assert code == 2
    assert f'{output} exists; --force replaces it' in err
    assert output.read_text() == 'years of work'
    assert tune(model, '--force')[0] == 0
    assert 'proportional_gain' in output.read_text()


def test_limits_that_cannot_be_met_fail_in_words(model, tune, output):
    code, _, err = tune(model, '--uncertainty-limit', 0.01)
    assert code == 1
    assert err.startswith('piezo: ')
    assert 'no gains, however small, are within the limits' in err
    assert not output.exists()


@pytest.mark.parametrize(('text', 'complaint'), [
    ('/**/plant: {ros__parameters: {}}', 'has no section for trajectory'),
    ('/**/trajectory: {ros__parameters: {damping_ratio_1: -1.0}}', 'damping_ratio_1 is -1.0'),
    ('a: [', 'is no YAML')])
def test_a_model_that_is_none_fails_in_words(tmp_path, tune, text, complaint):
    path = tmp_path / 'other.yaml'
    path.write_text(text)
    code, _, err = tune(path)
    assert code == 2
    assert err.startswith(f'piezo: {path}')
    assert complaint in err


def test_the_scan_of_the_model_may_be_what_is_tuned_for(tmp_path, tune):
    path = dynamics(tmp_path)
    values = yaml.safe_load(path.read_text())
    values['/**/trajectory']['ros__parameters'].update(waveform='sine', frequency_hz=100.0)
    path.write_text(yaml.safe_dump(values))
    assert tune(path, '--objective', 'itae_scan')[0] == 0
    assert '15 periods of sine, 1 um, 100 Hz' in (tmp_path / 'controller.yaml').read_text()


POINTS = (
    '--amplitudes-um', 1.0, 2.5, '--frequencies-hz', 300, 500, 800, '--harmonics', 9,
    '--plant', ROOT / 'config' / 'rig.yaml')


def test_each_operating_point_is_given_a_scheme_and_auto_takes_the_same(model, tune, output):
    code, out, _ = tune(model, points=POINTS)
    assert code == 0
    assert 'triangle, hysteresis: Table 1 of the paper, amplifier: ' in out
    lines = out.partition('(! amplifier at its limits)\n')[2].splitlines()
    assert lines[0].split() == ['300', 'Hz', '500', 'Hz', '800', 'Hz', 'fbff', 'below']
    values = read_parameter_file(output, ['controller'])['controller']
    assert values['feedback_acceptable_amplitude_um'] == [1.0, 2.5]
    schemes = set()
    for line, acceptable_hz in zip(
            lines[1:3], values['feedback_acceptable_frequency_hz'], strict=True):
        words = line.split()
        assert float(words[-2]) == pytest.approx(acceptable_hz, rel=1e-3)
        for frequency_hz, scheme, m in zip(
                (300.0, 500.0, 800.0), words[2:11:3], words[3:11:3], strict=True):
            auto = ControllerParameters.from_mapping({
                **values, 'scheme': 'auto', 'scan_amplitude_um': float(words[0]),
                'scan_frequency_hz': frequency_hz})
            assert (auto.concrete_scheme, m) == (scheme, '9')
            schemes.add(scheme)
    assert schemes == {'ff', 'fbff'}
    # At 2.5 um and 800 Hz the amplifier does not follow nine harmonics.
    assert lines[2].split()[10].endswith('!')


def test_without_operating_points_auto_has_the_frequency_of_the_loop(model, tune, output):
    _, out, _ = tune(model)
    values = read_parameter_file(output, ['controller'])['controller']
    assert values['feedback_acceptable_amplitude_um'] == [0.0]
    assert values['feedback_acceptable_frequency_hz'] == [pytest.approx(
        float(table(out)['feedback acceptable below'][1]), rel=1e-4)]
    assert 'scheme to use' not in out


def test_an_uncertainty_that_is_not_known_may_be_left_out(model, tune):
    code, out, _ = tune(model, '--bound', 'none')
    assert code == 0
    assert 'W(s): none' in out
    assert table(out)['max |W T|'] == ['–'] * 3


@pytest.mark.parametrize(('options', 'complaint'), [
    (('--amplitudes-um', 7), r'--amplitudes-um has 7, allowed is above 0 … 6 um'),
    (('--plant', 'no.yaml'), 'no.yaml')])
def test_operating_points_that_cannot_be_are_refused(model, tune, output, options, complaint):
    code, _, err = tune(model, points=options)
    assert code == 2
    assert complaint in err
    assert not output.exists()


def add_facts(path, section, **facts):
    content = yaml.safe_load(path.read_text())
    content[f'/**/{section}'] = {'ros__parameters': facts}
    path.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize('period_s', [
    5e-4, pytest.param(2e-4, marks=pytest.mark.slow), pytest.param(5e-3, marks=pytest.mark.slow)])
def test_d2_a_stage_of_any_sampling_is_tuned_by_the_file_that_identification_wrote(
        tmp_path, tune, output, period_s):
    # The same stage, slower with its sampling.
    slower = period_s / 2e-5
    path = dynamics(
        tmp_path, natural_frequency_1_rad_per_s=15290.0 / slower, damping_ratio_1=0.6,
        natural_frequency_2_rad_per_s=45730.0 / slower, damping_ratio_2=0.1,
        time_constant_s=1.6e-4 * slower, zero_b1_rad_per_s=-34700.0 / slower,
        zero_b2_rad2_per_s2=1.193e9 / slower**2, gain_k_rad3_per_s3=2.531e12 / slower**3)
    code, out, err = tune(
        path, '--sample-period-s', period_s, '--bound', 'none', '--plant',
        ROOT / 'config' / 'examples' / 'slow_stage' / 'rig.yaml', '--amplitudes-um', 5.0,
        '--objective', 'itae_step', '--report', tmp_path / 'page', points=('--harmonics', 'auto'))
    assert (code, err) == (0, '')
    assert out.count(' Hz') > 7
    assert {'nyquist.svg', 'schemes.svg', 'step.svg'} <= {
        path.name for path in (tmp_path / 'page' / 'figures').iterdir()}
    assert 'proportional_gain' in output.read_text()


def test_d2_the_period_is_that_of_the_record_where_the_model_tells_it(model, tune):
    add_facts(model, 'identified_dynamics', sample_period_s=2e-5, verdict='good')
    assert 'sampled every 2e-05 s' in tune(model)[1]


@pytest.mark.parametrize('section', [
    'identified_dynamics', pytest.param('identified_hysteresis', marks=pytest.mark.slow)])
def test_a_model_that_is_not_to_be_trusted_is_tuned_only_when_told_to(
        model, tune, output, section):
    add_facts(model, section, verdict='do not trust, because of 3 points')
    code, _, err = tune(model)
    assert code == 4
    assert f'{model}: do not trust, because of 3 points; --accept-poor' in err
    assert not output.exists()
    assert tune(model, '--accept-poor')[0] == 0


def test_d5_the_limit_holds_on_the_measured_points_too(model, tune, monkeypatch):
    """The stage has a resonance at 2 kHz that the model lacks."""
    from piezo_ros.identification.response import response_csv
    frequency_hz = np.geomspace(50.0, 8000.0, 60)
    truth = LinearDynamics().sampled_response(frequency_hz, 1e-5) * (
        1.0 + 1.0 / (1.0 - (frequency_hz / 2000.0)**2 + 0.1j * frequency_hz / 2000.0)
        * (frequency_hz / 2000.0)**2)
    points = SimpleNamespace(
        frequency_hz=frequency_hz, response=truth, standard_error=np.zeros(60),
        sample_period_s=1e-5)
    monkeypatch.setattr(response_csv, 'read_response', lambda path: points, raising=False)
    _, alone, _ = tune(model, '--max-sensitivity', 1.6)
    assert 'measured points not known' in alone
    add_facts(model, 'identified_dynamics', points_file='trajectory.csv', model_error=0.02)
    code, out, _ = tune(model, '--max-sensitivity', 1.6, '--force')
    assert code == 0
    gains = [float(table(out)[name][1]) for name in ('kP', 'kI')]
    z = np.exp(2j * np.pi * frequency_hz * 1e-5)
    law = gains[0] + gains[1] * 1e-5 / (1.0 - 1.0 / z)
    largest = np.abs(1.0 / (1.0 + law * truth / z)).max()
    assert largest <= 1.6
    assert f'60 measured points {largest:.3g}'[:-1] in out
    assert 'band of the model 1.' in out
    # The gains of the model alone would be far from it.
    gains = [float(table(alone)[name][1]) for name in ('kP', 'kI')]
    law = gains[0] + gains[1] * 1e-5 / (1.0 - 1.0 / z)
    assert np.abs(1.0 / (1.0 + law * truth / z)).max() > 1.7


def test_d9_what_is_not_known_is_no_certainty(model, tune, tmp_path):
    points = ('--amplitudes-um', 1.0, '--frequencies-hz', 300, '--harmonics', 9)
    _, out, _ = tune(model, '--bound', 'none', points=points)
    assert re.search(r'1 um +\d+\.\d\d…\?', out)
    assert 'W(s) not known, error of the dynamics not known' in out
    compensator = tmp_path / 'compensator.yaml'
    compensator.write_text(yaml.safe_dump({'/**/compensator': {
        'ros__parameters': HysteresisParameters().to_mapping()}}))
    add_facts(compensator, 'identified_hysteresis', residual_rms_um=0.04, verdict='good',
              amplitude_levels_v=[1.0, 4.0], amplitude_residual_percent=[1.0, 1.0])
    add_facts(model, 'identified_dynamics', model_error=0.01, usable_to_hz=8000.0)
    _, out, _ = tune(
        model, '--bound', 'none', '--compensator', compensator, '--force', points=points)
    low, high = re.search(r'1 um +(\d+\.\d\d)…(\d+\.\d\d)', out).groups()
    assert float(low) < float(high)
    assert 'hysteresis residual 40 nm' in out
    assert 'error of the dynamics 1 % up to 8000 Hz' in out
