"""Rudder angle of a tick: sensor, servo, or estimate."""

import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Inputs, RudderAngleSample, RudderFeedback, Severity, Tick
from firmware_py.core.rudder import RudderSettings, RudderState, source_events, update

PARAMETERS = ParameterSet().replaced("RUD_EST_DEG_S", math.degrees(0.5)).replaced("RUD_EST_LAG_S", 0.0)
SETTINGS = RudderSettings.of(PARAMETERS)


class Rudder:
    """State and status of a rudder at 10 Hz; `shaft_rad` None: a servo that measures no angle."""

    def __init__(self, parameters=PARAMETERS):
        self.settings = RudderSettings.of(parameters)
        self.state, self.status, self.index = RudderState(), None, 0
        self.events, self.severities = [], []

    def tick(self, shaft_rad=None, *, sensor_rad=None, command_rad=0.0, torque_on=True, servo=True):
        t_s = 0.1 * self.index
        feedback = (RudderFeedback(t_s, shaft_rad, torque_on=torque_on),) if servo else ()
        # The first sample of 9 rad is impossible, so it is ignored.
        angles = () if sensor_rad is None else (RudderAngleSample(t_s, 9.0), RudderAngleSample(t_s, sensor_rad))
        inputs = Inputs(Tick(self.index, t_s, 0.0, 0, 10.0), rudder=feedback, rudder_angles=angles)
        previous = self.state
        self.state, self.status = update(self.settings, previous, inputs)
        events = source_events(previous, self.state)
        self.events += [event.text for event in events]
        self.severities += [event.severity for event in events]
        self.state = RudderState(command_rad, *(getattr(self.state, name) for name in self.state.__struct_fields__[1:]))
        self.index += 1
        return self.status


@pytest.fixture
def rudder():
    return Rudder()


def test_angle_of_the_servo_is_measured(rudder):
    status = rudder.tick(0.2)
    assert (status.angle_rad, status.measured, status.estimated, status.is_repeated) == (0.2, True, False, False)
    assert not status.from_sensor
    assert rudder.state.slew is None
    status = rudder.tick(servo=False)
    assert (status.angle_rad, status.measured, status.is_new) == (0.2, True, False)
    assert rudder.events == []


@pytest.mark.parametrize(
    ("voltage_v", "current_a", "power_w"),
    [(12.0, -0.5, 6.0), (12.0, 0.5, 6.0), (None, 0.5, None), (12.0, None, None), (1e300, 1e300, None), (0.0, 0.0, 0.0)],
)
def test_power_of_the_servo_is_voltage_times_current(voltage_v, current_a, power_w):
    feedback = RudderFeedback(0.0, 0.1, voltage_v=voltage_v, current_a=current_a)
    _, status = update(SETTINGS, RudderState(), Inputs(Tick(0, 0.0, 0.0, 0, 10.0), rudder=(feedback,)))
    assert (status.power_w, status.current_a) == (power_w, current_a)


def test_time_of_the_last_restart_of_the_servo_is_kept():
    state = RudderState()
    for t_s, restarts, restarted_s in ((1.0, 1, 1.0), (2.0, 2, 2.0), (3.0, 2, 2.0), (4.0, 4, 4.0), (5.0, 0, 4.0)):
        feedback = RudderFeedback(t_s, 0.1, restarts=restarts)
        state, _ = update(SETTINGS, state, Inputs(Tick(0, t_s, 0.0, 0, 10.0), rudder=(feedback,)))
        assert (state.restarts, state.restarted_s) == (restarts, restarted_s)


def test_before_the_first_feedback_the_angle_is_the_command(rudder):
    rudder.tick(servo=False, command_rad=0.3)
    status = rudder.tick(servo=False)
    assert (status.angle_rad, status.measured, status.estimated, status.feedback_s) == (0.3, False, False, None)


def test_servo_without_an_angle_is_estimated(rudder):
    angles = [rudder.tick(command_rad=0.2).angle_rad for _ in range(8)]
    assert angles == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2, 0.2, 0.2, 0.2])
    status = rudder.status
    assert (status.measured, status.estimated, status.is_new) == (False, True, True)
    assert rudder.events == ["Rudder angle: estimated"]


def test_estimate_begins_at_the_last_measured_angle(rudder):
    rudder.tick(0.2)
    assert rudder.tick().angle_rad == 0.2
    assert rudder.tick().angle_rad == pytest.approx(0.15)
    status = rudder.tick(-0.1)
    assert (status.angle_rad, status.measured, status.estimated) == (-0.1, True, False)
    assert rudder.events == ["Rudder angle: estimated", "Rudder angle: measured by the servo"]


@pytest.mark.parametrize("sensor_rad", [1.6, -1.6, 1e300, math.nan])
def test_impossible_angle_of_the_sensor_is_not_measured(rudder, sensor_rad):
    assert not rudder.tick(0.2, sensor_rad=sensor_rad).from_sensor
    assert rudder.tick(0.2, sensor_rad=1.57).angle_rad == 1.57
    status = rudder.tick(0.2, sensor_rad=sensor_rad)
    assert (status.angle_rad, status.from_sensor, status.is_repeated) == (1.57, True, True)


def test_impossible_angle_of_the_servo_is_not_measured(rudder):
    assert rudder.tick(6.2).measured
    assert not rudder.tick(6.3).measured


def test_released_servo_without_an_angle_is_not_estimated(rudder):
    rudder.tick()
    rudder.tick(command_rad=0.2)
    status = rudder.tick(torque_on=False, command_rad=0.2)
    assert (status.angle_rad, status.measured, status.estimated, status.torque_on) == (0.0, False, False, False)
    rudder.tick(command_rad=0.2)
    assert rudder.tick().angle_rad == pytest.approx(0.1)


@pytest.mark.parametrize("shaft_rad", [None, 0.4])
def test_sensor_is_the_measurement_for_any_servo(rudder, shaft_rad):
    status = rudder.tick(shaft_rad, sensor_rad=-0.2)
    assert (status.angle_rad, status.measured, status.estimated, status.is_repeated) == (-0.2, True, False, False)
    assert status.from_sensor
    status = rudder.tick(shaft_rad)
    assert (status.angle_rad, status.measured, status.is_repeated) == (-0.2, True, True)
    assert rudder.state.slew is None


def test_silent_sensor_is_replaced_by_the_servo_after_the_time_out(rudder):
    rudder.tick(0.4, sensor_rad=-0.2)
    assert [rudder.tick(0.4).angle_rad for _ in range(12)] == [-0.2] * 10 + [0.4] * 2  # RUD_TIMEOUT_S is 1 s
    assert not rudder.status.is_repeated
    assert rudder.events == ["Rudder angle: measured by the servo"]
    assert rudder.severities == [Severity.WARNING]
    rudder.tick(0.4, sensor_rad=-0.2)
    assert (rudder.events[1:], rudder.severities[1:]) == (["Rudder angle: measured by the sensor"], [Severity.NOTICE])


def test_slow_sensor_is_used_for_two_and_a_half_of_its_intervals(rudder):
    """A sensor of 1 Hz whose samples are late by up to 0.1 s does not alternate with the servo."""
    ticks = [0, 10, 21, 30, 41]
    sources = [rudder.tick(0.4, sensor_rad=-0.2 if tick in ticks else None).from_sensor for tick in range(80)]
    assert sources == [True] * (41 + 28) + [False] * 11  # the longest interval is 1.1 s, 2.5 of them are 2.75 s
    assert rudder.events == ["Rudder angle: measured by the servo"]


def test_silent_sensor_is_replaced_by_the_estimate_from_its_last_angle(rudder):
    rudder.tick(sensor_rad=0.2)
    angles = [rudder.tick(command_rad=0.0).angle_rad for _ in range(13)]
    assert angles == pytest.approx([0.2] * 11 + [0.15, 0.1])
    assert rudder.status.estimated
    assert rudder.tick(sensor_rad=0.05).angle_rad == 0.05
    assert rudder.events == ["Rudder angle: estimated", "Rudder angle: measured by the sensor"]
    assert rudder.severities == [Severity.WARNING, Severity.NOTICE]


@pytest.mark.parametrize(("servo_ticks", "begin_rad"), [(0, -0.2), (1, 0.4), (15, 0.4)])
def test_estimate_begins_at_the_newer_of_servo_and_sensor(rudder, servo_ticks, begin_rad):
    rudder.tick(0.4, sensor_rad=-0.2)
    for _ in range(servo_ticks):
        rudder.tick(0.4)
    rudder.index += 50
    assert rudder.tick().angle_rad == begin_rad


def test_sensor_measures_without_feedback_of_the_servo(rudder):
    status = rudder.tick(sensor_rad=0.1, servo=False)
    assert (status.angle_rad, status.measured, status.estimated, status.feedback_s) == (0.1, True, False, None)
    assert status.from_sensor
    for _ in range(12):
        status = rudder.tick(servo=False)
    assert (status.measured, rudder.events) == (False, [])


def test_time_out_of_the_sensor_is_a_parameter():
    rudder = Rudder(PARAMETERS.replaced("RUD_TIMEOUT_S", 0.35))
    rudder.tick(0.4, sensor_rad=-0.2)
    assert [rudder.tick(0.4).angle_rad for _ in range(5)] == [-0.2] * 3 + [0.4] * 2
