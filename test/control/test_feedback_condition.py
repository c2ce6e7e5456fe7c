import pytest

from piezo_ros.control.feedback_condition import feedback_acceptable_below_hz

AMPLITUDES_UM = (0.5, 1.0, 2.0)
FREQUENCIES_HZ = (400.0, 700.0, 500.0)


@pytest.mark.parametrize(('amplitude_um', 'frequency_hz'), [
    (0.1, 400.0), (0.5, 400.0), (0.75, 550.0), (1.0, 700.0), (1.5, 600.0), (2.0, 500.0),
    (9.0, 500.0)])
def test_straight_lines_run_between_the_amplitudes_and_none_beyond(amplitude_um, frequency_hz):
    found = feedback_acceptable_below_hz(AMPLITUDES_UM, FREQUENCIES_HZ, amplitude_um)
    assert found == pytest.approx(frequency_hz)


@pytest.mark.parametrize('amplitude_um', [0.0, 1.0, 50.0])
def test_one_amplitude_alone_stands_for_all(amplitude_um):
    assert feedback_acceptable_below_hz((0.0,), (425.0,), amplitude_um) == 425.0
