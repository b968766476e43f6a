"""Rudder monitor: slow rudders, jams, deviations, overcurrent, relief and trials."""

import math
from itertools import pairwise

import pytest

from firmware_py.common.records import RudderStatus
from firmware_py.safety.rudder_monitor import RudderMonitorSettings, RudderMonitorState, release_command, update

RELIEF_S = 10.0
TRIAL_S = 1.2


class Servo:
    """A servo with a limited rate, and its monitor at 10 Hz."""

    def __init__(self, slew_deg_s=30.0, limit_a=3.0):
        self.state, self.t_s, self.angle_deg, self.sent_deg = RudderMonitorState(), 0.0, 0.0, 0.0
        self.slew_deg_s, self.limit_a = slew_deg_s, limit_a
        self.is_blocked = self.is_released = self.is_silent = False
        self.current_a = 0.2
        self.delay_ticks, self.angles_deg = 0, [0.0]  # of the feedback

    def run(self, seconds, demand_deg):
        for _ in range(round(seconds * 10)):
            self.t_s += 0.1
            if not self.is_blocked:
                max_step_deg = 0.1 * self.slew_deg_s
                self.angle_deg += min(max(self.sent_deg - self.angle_deg, -max_step_deg), max_step_deg)
            self.angles_deg.append(self.angle_deg)
            settings = RudderMonitorSettings(self.limit_a)
            self.state = update(settings, self.state, self.status(), is_engaged=not self.is_released)
            commanded = demand_deg(self.t_s) if callable(demand_deg) else demand_deg
            self.sent_deg = math.degrees(release_command(self.state, math.radians(commanded), self.t_s))
            yield self.state

    def status(self):
        """Return the feedback; it is not new while the servo is silent."""
        angle_deg = self.angles_deg[-1 - self.delay_ticks :][0]
        return RudderStatus(
            self.t_s,
            math.radians(self.sent_deg),
            math.radians(angle_deg),
            measured=math.isfinite(angle_deg),
            is_new=not self.is_silent,
            current_a=self.current_a,
        )


@pytest.mark.parametrize("slew_deg_s", [2.0, 5.0, 30.0, 300.0])
@pytest.mark.parametrize(
    "demand_deg", [30.0, lambda t_s: 25.0 * math.sin(t_s), lambda t_s: 30.0 if t_s % 8 < 4 else -30.0]
)
def test_slow_servo_that_follows_has_no_fault(slew_deg_s, demand_deg):
    states = list(Servo(slew_deg_s).run(60.0, demand_deg))
    assert not any(state.is_jammed or state.deviating or state.overloaded for state in states)


def test_servo_that_does_not_move_is_jammed_and_retried_until_it_moves():
    servo = Servo()
    list(servo.run(3.0, 20.0))
    servo.is_blocked = True
    start_s = servo.t_s
    list(servo.run(1.4, -10.0))
    assert not servo.state.is_jammed
    list(servo.run(0.5, -10.0))
    assert servo.state.is_jammed
    driven_s = 0.0
    for _ in servo.run(30.0, -10.0):
        driven_s += 0.1 * (abs(servo.sent_deg - 20.0) > 1.0)
    assert 2 * TRIAL_S - 0.3 < driven_s < 3 * TRIAL_S
    servo.is_blocked = False
    list(servo.run(RELIEF_S + 1.0, -10.0))
    assert not servo.state.is_jammed
    assert servo.t_s - start_s < 50.0
    list(servo.run(3.0, -10.0))
    assert servo.angle_deg == pytest.approx(-10.0)


def test_end_of_a_jam_at_the_command_is_detected_by_a_small_movement():
    servo = Servo()
    list(servo.run(2.0, 20.0))
    servo.is_blocked = True
    list(servo.run(2.0, -10.0))
    assert servo.state.is_jammed
    servo.is_blocked = False
    list(servo.run(RELIEF_S + TRIAL_S, 20.0))
    assert not servo.state.is_jammed


def test_servo_that_moves_in_the_wrong_direction_deviates_and_is_not_jammed():
    servo = Servo()
    list(servo.run(1.0, 20.0))
    servo.is_blocked = True
    for _ in servo.run(4.0, 20.0):
        servo.angle_deg -= 0.3
    assert servo.state.deviating
    assert not servo.state.is_jammed


def test_overloaded_servo_is_relieved_and_recovers_after_a_trial_with_low_current():
    servo = Servo()
    servo.current_a = 4.0
    list(servo.run(1.8, 0.0))
    assert not servo.state.overloaded
    list(servo.run(0.5, 0.0))
    assert servo.state.overloaded
    servo.current_a = 0.2
    list(servo.run(RELIEF_S - 1.0, 0.0))
    assert servo.state.overloaded
    list(servo.run(TRIAL_S + 2.0, 0.0))
    assert not servo.state.overloaded
    assert servo.state.relieved_s is None


@pytest.mark.parametrize("attribute", ["is_released", "is_silent"])
def test_released_or_silent_servo_has_no_fault(attribute):
    servo = Servo()
    setattr(servo, attribute, True)
    servo.is_blocked = True
    assert not any(state.is_jammed or state.deviating for state in servo.run(20.0, 25.0))


def test_any_current_is_allowed_without_a_limit_and_nan_is_ignored():
    servo = Servo(limit_a=0.0)
    servo.current_a = 50.0
    assert not any(state.overloaded for state in servo.run(10.0, 0.0))
    servo.angle_deg = math.nan
    servo.current_a = math.nan
    servo.is_blocked = True
    servo.limit_a = 3.0
    assert not any(state.overloaded or state.is_jammed for state in servo.run(5.0, 0.0))


@pytest.mark.parametrize("delay_ticks", [0, 1, 2])
@pytest.mark.parametrize("slew_deg_s", [10.0, 30.0, 60.0])
def test_relieved_servo_stops_with_delayed_feedback(slew_deg_s, delay_ticks):
    servo = Servo(slew_deg_s)
    servo.delay_ticks = delay_ticks

    def demand_deg(t_s):
        return 25.0 * math.sin(2.0 * t_s)

    list(servo.run(3.0, demand_deg))
    servo.current_a = 4.0
    while servo.state.relieved_s is None:
        list(servo.run(0.1, demand_deg))
    list(servo.run(2.0, demand_deg))
    angles_deg = [servo.angle_deg for _ in servo.run(RELIEF_S - 3.0, demand_deg)]
    assert max(angles_deg) - min(angles_deg) < 0.01


def overloaded_servo():
    servo = Servo()
    list(servo.run(3.0, 20.0))
    servo.current_a = 5.0
    list(servo.run(1.9, 20.0))
    assert not servo.state.overloaded
    list(servo.run(0.3, 20.0))
    assert servo.state.overloaded
    return servo


def test_servo_overloaded_in_each_trial_is_relieved_between_trials():
    servo, in_trial = overloaded_servo(), []
    for _ in range(600):
        servo.current_a = 5.0 if servo.state.is_in_trial(servo.t_s) else 0.2
        list(servo.run(0.1, 20.0))
        in_trial.append(servo.state.is_in_trial(servo.t_s))
        assert servo.state.overloaded
        assert servo.state.relieved_s is not None
    trials = sum(now and not before for before, now in pairwise(in_trial))
    assert trials == pytest.approx(60.0 / (RELIEF_S + TRIAL_S), abs=1.0)
    assert sum(in_trial) * 0.1 == pytest.approx(trials * TRIAL_S, abs=1.5)


def test_command_of_a_relieved_rudder_follows_it_when_it_is_moved():
    servo = overloaded_servo()
    servo.current_a = 0.2
    servo.is_blocked = True  # only waves move it
    for _ in range(80):
        servo.angle_deg -= 0.2
        list(servo.run(0.1, 20.0))
        assert abs(servo.sent_deg - servo.angle_deg) < 1.0


def status_of(t_s, *, measured=True, is_repeated=False, angle_rad=0.0):
    return RudderStatus(t_s, 0.3, angle_rad, measured=measured, is_new=True, is_repeated=is_repeated, current_a=0.2)


def jammed_state(settings):
    state = RudderMonitorState()
    for tick in range(30):
        state = update(settings, state, status_of(0.1 * tick), is_engaged=True)
    assert state.is_jammed
    return state


def verdict_of(*steps, state=RudderMonitorState(), settings=RudderMonitorSettings(3.0)):  # noqa: B008 - frozen
    """Return whether a rudder jams and deviates, after steps of (time [s], angle [deg]) with the command 0."""
    for t_s, angle_deg in steps:
        status = RudderStatus(t_s, 0.0, math.radians(angle_deg), measured=True, is_new=True, current_a=0.2)
        state = update(settings, state, status, is_engaged=True)
    return state.is_jammed, state.deviating


JAMMED, DEVIATING, NORMAL = (True, False), (False, True), (False, False)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("steps", "verdict"),
    [
        (((0.0, 3.1), (1.5, 3.1)), JAMMED),
        (((0.0, 3.1), (1.49, 3.1)), NORMAL),
        (((0.0, 2.9), (60.0, 2.9)), NORMAL),  # at the command
        (((0.0, 9.0), (1.0, 8.55), (1.5, 8.55)), JAMMED),  # a movement of less than 0.5 deg
        (((0.0, 9.0), (1.0, 8.45), (1.5, 8.45), (2.49, 8.45)), NORMAL),
        (((0.0, 9.0), (1.0, 9.45), (1.5, 9.45)), JAMMED),
        (((0.0, 9.0), (1.0, 9.55), (1.5, 9.55)), DEVIATING),
        (((0.0, 9.0), (1.0, 9.55), (1.49, 9.55)), NORMAL),
        (((0.0, 9.0), (1.0, -9.0), (1.5, -9.0), (2.49, -9.0)), NORMAL),  # the other side restarts the time
        (((0.0, 9.0), (1.5, 9.0), (1.6, 8.1)), JAMMED),
        (((0.0, 9.0), (1.5, 9.0), (1.6, 7.9)), NORMAL),  # free after a movement of 1 deg
        (((0.0, 9.0), (1.5, 9.0), (1.6, 10.1)), DEVIATING),
    ],
)
def test_verdict_depends_on_the_motion_towards_the_command(steps, verdict, side):
    assert verdict_of(*((t_s, side * angle_deg) for t_s, angle_deg in steps)) == verdict


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("now_s", "command_deg", "sent_deg"),
    [
        (9.9, 0.0, 9.0),
        (10.0, 0.0, 0.0),
        (10.0, 13.1, 13.1),
        (10.0, 12.9, 4.0),  # at the command, the trial is a movement of 6 deg
        (10.0, 7.1, 4.0),
        (10.0, 6.9, 6.9),
    ],
)
def test_relieved_rudder_is_tried_after_ten_seconds(now_s, command_deg, sent_deg, side):
    measured_rad, release_rad, command_rad, sent_rad = (
        side * math.radians(angle_deg) for angle_deg in (10.0, 9.0, command_deg, sent_deg)
    )
    state = RudderMonitorState(measured_rad=measured_rad, release_rad=release_rad, relieved_s=0.0)
    assert release_command(state, command_rad, now_s) == pytest.approx(sent_rad)
    assert release_command(RudderMonitorState(measured_rad=measured_rad), command_rad, now_s) == command_rad
    assert release_command(RudderMonitorState(relieved_s=0.0), command_rad, now_s) == command_rad
    without_release = RudderMonitorState(measured_rad=measured_rad, relieved_s=0.0)
    assert release_command(without_release, command_rad, 0.0) == measured_rad


@pytest.mark.parametrize(("t_s", "is_overloaded"), [(11.1, True), (11.2, False)])
def test_overload_ends_after_a_trial_of_1_2_s_with_a_low_current(t_s, is_overloaded):
    state = RudderMonitorState(overloaded=True, relieved_s=0.0)
    status = RudderStatus(t_s, 0.0, 0.0, measured=False, is_new=True, current_a=0.2)
    state = update(RudderMonitorSettings(3.0), state, status, is_engaged=True)
    assert (state.overloaded, state.relieved_s) == ((True, 0.0) if is_overloaded else (False, None))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("current_a", "seconds", "is_overloaded"), [(3.1, 2.0, True), (3.1, 1.9, False), (3.0, 9.0, False)]
)
def test_current_above_the_limit_for_2_s_is_an_overload(current_a, seconds, is_overloaded, side):
    state = RudderMonitorState()
    for t_s in (0.0, seconds):
        status = RudderStatus(t_s, 0.0, 0.0, measured=True, is_new=True, current_a=side * current_a)
        state = update(RudderMonitorSettings(3.0), state, status, is_engaged=True)
    assert state.overloaded is is_overloaded


def test_angle_that_is_not_measured_any_more_ends_the_verdicts_of_the_motion():
    settings = RudderMonitorSettings(3.0)
    state = jammed_state(settings)
    assert release_command(state, 0.3, 3.0) == 0.0
    assert update(settings, state, status_of(3.0, measured=False), is_engaged=False).is_jammed
    state = update(settings, state, status_of(3.0, measured=False), is_engaged=True)
    assert (state.is_jammed, state.deviating, state.relieved_s, state.measured_rad) == (False, False, None, None)
    assert release_command(state, 0.3, 3.0) == 0.3
    for tick in range(31, 100):
        state = update(settings, state, status_of(0.1 * tick, measured=False), is_engaged=True)
        assert (state.is_jammed, state.deviating) == (False, False)


def test_overcurrent_is_judged_without_a_measured_angle():
    settings, state = RudderMonitorSettings(0.1), RudderMonitorState()
    for tick in range(25):
        state = update(settings, state, status_of(0.1 * tick, measured=False), is_engaged=True)
    assert state.overloaded


def test_repeated_angle_of_a_slow_sensor_is_no_standstill():
    """A sensor sends 1 sample in 16 ticks; between them the angle stands still, but the rudder moves."""
    settings, state = RudderMonitorSettings(3.0), RudderMonitorState()
    for tick in range(160):
        angle_rad = 0.02 * (tick // 16)
        status = status_of(0.1 * tick, is_repeated=tick % 16 != 0, angle_rad=angle_rad)
        state = update(settings, state, status, is_engaged=True)
        assert not state.is_jammed
