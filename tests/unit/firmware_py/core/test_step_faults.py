"""Tick as a pure function: faults, time-outs, failsafes and power saving."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.intents import (
    Arm,
    Request,
    SetMode,
    SetParameter,
    SteerHeading,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Inputs,
    RudderFeedback,
    Tick,
)
from firmware_py.core.accept import accept
from firmware_py.core.resume import Moment, restore, resume_of, to_bytes
from firmware_py.core.state import State, parameters_in_force
from firmware_py.core.step import step
from firmware_py.faults.table import Fault
from firmware_py.safety.oscillation import NO_HALF
from firmware_py.safety.steering_monitor import NO_BLOCK
from support.tick_boat import FIX, Boat


def faulty(boat, role):
    return (DeviceHealth(boat.t_s, role, DeviceState.FAULTY, 0, 1, "error"),)


@pytest.mark.parametrize(
    ("provoke", "fault"),
    [
        (lambda boat: setattr(boat, "servo", False), Fault.RUDDER_SILENT),
        (lambda boat: setattr(boat, "hardware_error", 4), Fault.RUDDER_ERROR),
        (lambda boat: boat.tick(devices=faulty(boat, DeviceRole.RUDDER)), Fault.RUDDER_ERROR),
        (lambda boat: boat.tick(skipped=3), Fault.LOOP_LATE),
        (lambda boat: boat.tick(devices=faulty(boat, DeviceRole.STORAGE)), Fault.STORAGE_FAILING),
        (lambda boat: setattr(boat, "position", None), Fault.POSITION_LOST),
    ],
)
def test_each_fault_is_detected(provoke, fault):
    boat = Boat()
    boat.position = FIX
    boat.run(3.0)
    assert boat.outputs[-1].snapshot.faults == 0
    provoke(boat)
    boat.run(1.5 if fault is Fault.LOOP_LATE else 8.0)
    assert boat.outputs[-1].snapshot.faults == 1 << fault


def test_charger_errors_are_reported_at_intervals():
    boat = Boat()
    boat.run(3.0)

    def report(role, error):
        state = DeviceState.FAULTY if error else DeviceState.RUNNING
        text = f"charger reports error {error}" if error else ""
        boat.tick(devices=(DeviceHealth(boat.t_s, role, state, 9, 0, text),))
        boat.pass_time(60.0)

    for error in (17, 0, 18, 0):
        report(DeviceRole.POWER, error)
    report(DeviceRole.POWER_B, 2)
    report(DeviceRole.COMPASS, 3)  # a compass has its own faults
    reported = [text for text in boat.events if text.startswith("Power")]
    assert reported == ["Power monitor: charger reports error 17", "Power monitor: charger reports error 2"]
    boat.pass_time(400.0)
    report(DeviceRole.POWER, 19)
    assert boat.events[-1] == "Power monitor: charger reports error 19"


def test_missing_devices_are_no_fault_before_their_timeout():
    boat = Boat()
    boat.compass = boat.servo = False
    assert boat.run(2.5).snapshot.faults == 0
    assert boat.run(1.0).snapshot.faults == (1 << Fault.COMPASS_LOST) | (1 << Fault.RUDDER_SILENT)


@pytest.mark.parametrize("halted_s", [1.5, 5.0, 60.0])
def test_servo_is_not_silent_after_a_halt_of_the_process(halted_s):
    boat = Boat(ParameterSet().replaced("FS_RUD_ACT", 4)).get_under_way()
    boat.position = FIX
    boat.run(10.0)
    boat.index += round(10 * halted_s)
    boat.servo = False  # no reply during the halt
    boat.tick(skipped=round(10 * halted_s))
    boat.servo = True
    assert boat.run(3.0).snapshot.mode is Mode.GUIDED
    assert "Control loop late: deadlines skipped" in boat.events
    assert "Rudder servo not responding" not in boat.events


@pytest.mark.parametrize(("ticks", "timeout_s"), [(1, 1.0), (4, 1.0), (10, 2.5), (20, 5.0)])
@pytest.mark.parametrize("estimator", [0, 1])
def test_compass_timeout_depends_on_its_rate(ticks, timeout_s, estimator):
    boat = Boat(ParameterSet().replaced("EST_MODE", estimator), noise_rad=0.002)
    boat.compass_ticks = ticks
    boat.get_under_way()
    assert boat.run(20.0).snapshot.faults == 0
    while (boat.index - 1) % ticks:
        boat.tick()
    boat.compass = False  # the last heading was in the previous tick
    last_s = boat.t_s - 0.1 - 0.002
    while not boat.run(0.1).snapshot.faults >> Fault.COMPASS_LOST & 1:
        assert boat.t_s < last_s + 10.0
    assert boat.t_s - 0.1 - last_s == pytest.approx(timeout_s + 0.05, abs=0.06)


def test_slow_compass_may_miss_a_sample():
    boat = Boat(noise_rad=0.002)
    boat.compass_ticks = 10
    boat.get_under_way().run(60.0)
    boat.compass = False
    boat.run(1.0)
    boat.compass = True
    assert boat.run(10.0).snapshot.faults == 0
    assert "No valid heading: rudder held, then centred" not in boat.events


def test_gap_does_not_change_the_timeout():
    boat = Boat(noise_rad=0.002).get_under_way()
    boat.run(10.0)
    boat.compass = False
    boat.run(30.0)
    boat.compass = True
    boat.run(5.0)
    boat.events.clear()
    boat.compass = False
    boat.run(1.1)
    assert "No valid heading: rudder held, then centred" in boat.events


@pytest.mark.parametrize(("ticks", "timeout_s"), [(1, 5.0), (50, 12.5)])
def test_receiver_timeout_depends_on_its_rate(ticks, timeout_s):
    boat = Boat(noise_rad=0.002)
    boat.position, boat.position_ticks = FIX, ticks
    assert boat.run(60.0).snapshot.faults == 0
    assert "GPS position lost" not in boat.events
    while (boat.index - 1) % ticks:
        boat.tick()
    last_s, boat.position = boat.t_s - 0.1, None
    while boat.run(0.1).snapshot.position_ok:
        assert boat.t_s < last_s + 30.0
    assert boat.t_s - 0.1 - last_s == pytest.approx(timeout_s + 0.05, abs=0.06)


def test_servo_with_a_reply_each_second_is_not_silent():
    boat = Boat(noise_rad=0.002)
    boat.servo_ticks = 10
    boat.get_under_way()
    assert boat.run(60.0).snapshot.faults == 0
    assert "Rudder servo not responding" not in boat.events


def link_health(boat, state=DeviceState.RUNNING):
    return (DeviceHealth(boat.t_s, DeviceRole.LINK, state, 0, 0),)


@pytest.mark.parametrize("is_silent", [True, False])
@pytest.mark.parametrize("is_armed", [True, False])
@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.STEERING, Mode.HOLD, Mode.GUIDED, Mode.RTL])
def test_ground_station_failsafe_in_each_mode(mode, is_armed, is_silent):
    boat = Boat(ParameterSet().replaced("FS_GCS_ACT", 3).replaced("FS_GCS_S", 5), noise_rad=0.002)
    boat.position = FIX
    boat.run(0.3)
    boat.tick(Arm(armed=is_armed), SetMode(mode), devices=link_health(boat))
    boat.run(1.0)
    boat.tick(devices=link_health(boat, DeviceState.SILENT) if is_silent else ())
    output = boat.run(6.0)
    is_acting = is_silent and is_armed and mode is not Mode.HOLD
    assert output.snapshot.mode is (Mode.LOITER if is_acting else mode)
    assert output.snapshot.armed is is_armed
    assert ("Ground station link lost" in boat.events) is is_silent
    assert ("Failsafe: LOITER" in boat.events) is is_acting


@pytest.mark.parametrize(("mode", "after"), [(Mode.MANUAL, Mode.LOITER), (Mode.GUIDED, Mode.GUIDED)])
def test_failsafe_does_not_resume_manual(mode, after):
    parameters = ParameterSet().replaced("FS_GCS_ACT", 3).replaced("FS_GCS_S", 5).replaced("FS_RESUME", 1)
    boat = Boat(parameters, noise_rad=0.002)
    boat.position = FIX
    boat.get_under_way(mode)
    boat.tick(devices=link_health(boat, DeviceState.SILENT))
    assert boat.run(6.0).snapshot.mode is Mode.LOITER
    boat.tick(SetParameter("CTL_K1", 40.0), SetMode(99))  # neither is an accepted order that ends the failsafe
    boat.tick(devices=link_health(boat))
    assert boat.run(1.0).snapshot.mode is after
    assert ("Failsafe ended: LOITER kept, no stick input" in boat.events) is (mode is Mode.MANUAL)


def test_steering_is_monitored_while_armed_with_a_servo_that_responds():
    boat = Boat()
    boat.run(0.3)
    boat.tick(SetMode(Mode.GUIDED), SteerHeading(2.0))
    boat.run(3.0)
    assert boat.state.supervisor.oscillation.half == NO_HALF
    assert boat.state.supervisor.steering_monitor.block == NO_BLOCK
    boat.tick(Arm(armed=True))
    boat.run(3.0)
    assert boat.state.supervisor.oscillation.half.side == 1.0
    assert boat.state.supervisor.steering_monitor.block != NO_BLOCK
    boat.servo = False
    boat.run(3.0)
    assert boat.state.supervisor.steering_monitor.block == NO_BLOCK


def test_heading_that_does_not_converge_is_reported_once():
    boat = Boat().get_under_way()
    boat.tick(SteerHeading(2.0))
    for second in range(40):
        if second == 20:  # skip five minutes
            supervisor = boat.state.supervisor
            convergence = supervisor.convergence._replace(since_s=supervisor.convergence.since_s - 295.0)
            boat.state = replace(boat.state, supervisor=replace(supervisor, convergence=convergence))
        for _ in range(10):
            boat.heading_rad, boat.rate_rad_s = 0.5, 0.0
            boat.tick()
    assert boat.events.count("Rudder at limit 5 min: heading not converging") == 1


SAVING = ParameterSet().replaced("PWR_SAVE_PCT", 30.0).replaced("PWR_KEEP_PCT", 10.0)


def test_power_saving_levels_follow_the_battery_charge():
    boat = Boat(SAVING).get_under_way()
    boat.tick(SteerHeading(1.0))
    steps = []
    for charge, seconds in zip((0.8, 0.25, 0.05, 0.12, 0.2, 0.32, 0.4), (5, 35, 35, 65, 65, 65, 65), strict=True):
        boat.charge = charge
        snapshot = boat.pass_time(seconds).snapshot
        steps.append((snapshot.power_saving_level, snapshot.mode.name, parameters_in_force(boat.state)["CTL_PRICE"]))
    assert steps == [
        (0, "GUIDED", 1.0),
        (1, "GUIDED", 3.0),
        (2, "STEERING", 3.0),
        (2, "STEERING", 3.0),  # less than 5 % above the limit
        (1, "GUIDED", 3.0),
        (1, "GUIDED", 3.0),
        (0, "GUIDED", 1.0),
    ]
    reported = [text for text in boat.events if "attery" in text or "Failsafe" in text]
    assert reported == [
        "Battery low: power saving on",
        "Battery critical",
        "Failsafe: STEERING",
        "Battery no longer critical",
        "Failsafe ended: GUIDED resumed",
        "Battery no longer low: power saving off",
    ]


def test_restart_with_an_empty_battery_keeps_the_task():
    boat = Boat(SAVING.replaced("BOOT_RESUME", 2)).get_under_way()
    boat.tick(SteerHeading(1.0))
    boat.charge = 0.05
    assert boat.pass_time(40.0).snapshot.mode is Mode.STEERING
    stored = resume_of(boat.state, Moment(1.8e9))
    goal = boat.state.supervisor.interrupted.goal
    assert (stored.modes.mode, stored.modes.goal, stored.modes.armed) == (Mode.GUIDED, goal, True)


@pytest.mark.parametrize("is_restarted", [False, True])
@pytest.mark.parametrize("is_ordered", [False, True])
def test_hold_of_a_failsafe_is_still_one_after_a_restart(is_ordered, is_restarted):
    boat = Boat(SAVING.replaced("BOOT_RESUME", 2).replaced("FS_RUD_ACT", 1), noise_rad=0.002).get_under_way()
    boat.hardware_error = 1
    assert boat.run(2.0).snapshot.mode is Mode.HOLD
    boat.hardware_error = 0
    assert boat.run(3.0).snapshot.mode is Mode.HOLD
    assert "Failsafe ended: HOLD stays until a mode is set" in boat.events
    if is_ordered:
        state, _ = accept(boat.state, Request(boat.t_s, SetMode(Mode.HOLD)))
        assert not resume_of(state, Moment(1.8e9)).modes.by_failsafe  # a command is on disk before the next tick
        for other in (SetMode(99), SetParameter("CTL_K1", 40.0)):
            assert accept(boat.state, Request(boat.t_s, other))[0].modes.by_failsafe
        boat.tick(SetMode(Mode.HOLD))
    if is_restarted:
        stored = to_bytes(resume_of(boat.state, Moment(1.8e9)))
        boat.state, notes = restore(State.at_start(boat.state.parameters), stored, Moment(1.8e9))
        assert notes == ()
    boat.charge = 0.05
    assert boat.pass_time(40.0).snapshot.mode is (Mode.HOLD if is_ordered else Mode.STEERING)
    boat.charge = 0.5
    assert boat.pass_time(65.0).snapshot.mode is Mode.HOLD
    assert boat.state.modes.by_failsafe is not is_ordered


def test_missing_power_monitor_is_reported_and_power_saving_continues():
    boat = Boat(SAVING).get_under_way()
    boat.charge = 0.2
    assert boat.pass_time(35.0).snapshot.power_saving_level == 1
    boat.charge = None
    assert boat.pass_time(120.0).snapshot.power_saving_level == 1
    assert "Power monitor: no data" in boat.events


@pytest.mark.parametrize(
    ("released", "armed", "torque_on", "is_judged"),
    [
        (0, False, None, True),
        (1, False, None, False),
        (1, True, None, True),
        (1, True, True, True),
        (1, True, False, False),
    ],
)
def test_rudder_is_jammed_only_if_the_servo_has_torque(released, armed, torque_on, is_judged):
    state, texts = State.at_start(ParameterSet().replaced("RUD_DISARMED", released).replaced("BOOT_ARM", armed)), []
    for index in range(30):
        feedback = RudderFeedback(0.1 * index, 0.3, torque_on=torque_on)
        state, output = step(state, Inputs(Tick(index, 0.1 * index, 0.0, 0, 10.0), rudder=(feedback,)))
        texts += [event.text for event in output.events]
    assert state.supervisor.rudder_monitor.is_jammed is is_judged
    assert texts[0] == "Mode HOLD"
    assert "" not in texts


@pytest.mark.parametrize("effect", [0.0, -1.0])
def test_lost_or_reversed_rudder_without_a_measured_angle_is_reported_by_the_turns(effect):
    boat = Boat(noise_rad=math.radians(0.3))
    boat.measures = False
    boat.get_under_way()
    for goal_rad in (1.2, 0.5, 1.2):
        boat.tick(SteerHeading(goal_rad))
        boat.run(60.0)
    boat.effect = effect
    for goal_rad in (0.5, 1.2, 0.5, 1.2, 0.5):
        boat.tick(SteerHeading(goal_rad))
        boat.run(60.0)
    texts = "Steering lost: no response to the rudder", "Steering reversed: disarm, then change RUD_REVERSE"
    assert texts[effect < 0.0] in boat.events
    assert not [text for text in boat.events if text.startswith("Rudder jammed")]
