"""Tick as a pure function: from inputs to rudder commands and events."""

import math
import random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    ManualRudder,
    PauseMission,
    ReplacePlan,
    Request,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    SteerHeading,
    SteerPosition,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import Activity, Home
from firmware_py.core.accept import accept
from firmware_py.core.resume import Moment, restore, resume_of, to_bytes
from firmware_py.core.state import State, parameters_in_force
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.faults.table import Fault
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.model.kt import rk4_step
from firmware_py.plans.items import Command

FIX = PositionSample(0.0, FixType.FIX_3D, 0.5, 0.5)


class Boat:
    """A K-T boat with the tick at 10 Hz."""

    def __init__(self, parameters=None, heading_rad=0.5, noise_rad=0.0, seed=1):
        self.state = State.at_start(parameters or ParameterSet())
        self.heading_rad, self.rate_rad_s, self.shaft_rad = heading_rad, 0.0, 0.0
        self.index = 0
        self.measures, self.effect = True, 1.0  # whether the servo measures its angle; effect of the rudder
        self.compass = self.servo = True
        self.compass_ticks = self.position_ticks = self.servo_ticks = 1  # interval of samples
        self.position = None
        self.noise_rad, self.rng = noise_rad, random.Random(seed)
        self.hardware_error = 0
        self.charge = None  # of the battery
        self.events, self.outputs, self.inputs = [], [], []

    @property
    def t_s(self):
        return 0.1 * self.index

    def tick(self, *intents, skipped=0, devices=()):
        t_s = self.t_s
        heading = HeadingSample(
            t_s - 0.002, (self.heading_rad + self.rng.gauss(0.0, self.noise_rad)) % (2 * math.pi), NorthReference.TRUE
        )
        shaft_rad = self.shaft_rad if self.measures else None
        feedback = RudderFeedback(t_s - 0.05, shaft_rad, hardware_error=self.hardware_error)
        inputs = Inputs(
            Tick(self.index, t_s, 0.0001, skipped, 10.0),
            (heading,) if self.compass and self.index % self.compass_ticks == 0 else (),
            (replace(self.position, t_s=t_s),) if self.position and self.index % self.position_ticks == 0 else (),
            (feedback,) if self.servo and self.index % self.servo_ticks == 0 else (),
            devices,
            tuple(Request(t_s - 0.01, intent) for intent in intents),
            () if self.charge is None else (PowerSample(t_s, 0, 12.8, -0.3, self.charge),),
        )
        self.state, output = step(self.state, inputs)
        self.inputs.append(inputs)
        self.outputs.append(output)
        self.events += [event.text for event in output.events]
        if self.servo:
            self.shaft_rad = output.command.shaft_rad
        self.heading_rad, self.rate_rad_s = rk4_step(
            self.heading_rad, self.rate_rad_s, self.effect * self.shaft_rad, 0.1, 0.049, 4.0, 17.0, 0.0
        )
        if self.position:
            self.sail(0.1)
        self.index += 1
        return output

    def sail(self, step_s, speed_m_s=0.4):
        north_rad = step_s * speed_m_s * math.cos(self.heading_rad) / 6371008.8
        east_rad = step_s * speed_m_s * math.sin(self.heading_rad) / 6371008.8
        self.position = replace(
            self.position,
            latitude_rad=self.position.latitude_rad + north_rad,
            longitude_rad=self.position.longitude_rad + east_rad / math.cos(self.position.latitude_rad),
            speed_over_ground_m_s=speed_m_s,
            course_over_ground_rad=self.heading_rad % (2 * math.pi),
        )

    def run(self, seconds, **options):
        for _ in range(round(seconds * 10)):
            output = self.tick(**options)
        return output

    def pass_time(self, seconds):
        """Tick once a second, for conditions that last minutes; the boat hardly moves."""
        for _ in range(round(seconds)):
            self.index += 9
            output = self.tick()
        return output

    def get_under_way(self, mode=Mode.GUIDED):
        self.run(0.3)
        self.tick(Arm(armed=True), SetMode(mode))
        assert (self.state.modes.mode, self.state.modes.armed) == (mode, True)
        return self


def error_deg(boat, goal_rad):
    return abs(math.degrees(math.remainder(boat.heading_rad - goal_rad, 2 * math.pi)))


def test_heading_goal_is_reached():
    boat = Boat(noise_rad=math.radians(0.3)).get_under_way()
    boat.tick(SteerHeading(5.9))
    boat.run(120.0)
    assert error_deg(boat, 5.9) < 0.5
    assert boat.outputs[-1].snapshot.goal_heading_rad == pytest.approx(5.9)


def test_rudder_is_centred_disarmed_and_in_hold_and_released_by_parameter():
    boat = Boat()
    boat.run(1.0)
    boat.tick(SetMode(Mode.GUIDED), SteerHeading(3.0))
    assert boat.run(2.0).command.shaft_rad == 0.0
    assert boat.outputs[-1].command.torque_on
    boat.tick(SetParameter("RUD_DISARMED", 1))
    assert not boat.run(0.1).command.torque_on
    boat.tick(Arm(armed=True))
    assert boat.run(3.0).command.shaft_rad > 0.4
    boat.tick(SetMode(Mode.HOLD))
    assert boat.run(2.0).command.shaft_rad == 0.0


@pytest.mark.parametrize("released", [0, 1])
def test_bench_command_moves_the_rudder_until_its_end_or_arming(released):
    boat = Boat(ParameterSet().replaced("RUD_DISARMED", released))
    boat.run(1.0)
    assert boat.outputs[-1].command.torque_on is not bool(released)
    boat.tick(BenchRudder(-0.5, 3.0))
    boat.run(2.5)
    assert boat.outputs[-1].snapshot.rudder_command_rad == pytest.approx(-0.5 * math.radians(30.0))
    assert boat.outputs[-1].command.torque_on
    boat.run(2.0)
    assert boat.outputs[-1].snapshot.rudder_command_rad == 0.0
    assert boat.outputs[-1].command.torque_on is not bool(released)
    boat.tick(BenchRudder(1.0, 60.0))
    boat.run(2.0)
    boat.tick(Arm(True))
    boat.run(2.0)
    assert boat.outputs[-1].snapshot.rudder_command_rad == 0.0  # HOLD


def test_snapshot_has_the_reason_of_an_arming_refusal():
    boat = Boat()
    boat.run(1.0)
    assert boat.outputs[-1].snapshot.prearm_refusal == ""
    boat.compass = False
    boat.run(3.0)
    assert boat.outputs[-1].snapshot.prearm_refusal == "no valid heading"


def test_manual_follows_the_stick_within_the_rate_limit_and_ignores_an_old_stick():
    boat = Boat().get_under_way(Mode.MANUAL)
    output = boat.tick(ManualRudder(-1.0))
    assert output.snapshot.rudder_command_rad == pytest.approx(math.radians(-3.0), rel=1e-6)
    assert boat.run(2.0).snapshot.rudder_command_rad == pytest.approx(math.radians(-30.0), rel=1e-6)
    assert boat.run(3.0).snapshot.rudder_command_rad == 0.0


def test_stick_turns_the_goal_in_steering():
    boat = Boat().get_under_way(Mode.STEERING)
    for _ in range(100):
        boat.tick(ManualRudder(0.5))
    boat.tick(ManualRudder(None))
    boat.run(60.0)
    # Within the deadband of the first minute, in which the filter expects waves.
    assert error_deg(boat, 0.5 + math.radians(10.0)) < 2.0


def test_turn_has_the_commanded_direction():
    boat = Boat(heading_rad=1.0).get_under_way()
    boat.tick(SteerHeading(1.5, turn=-1))
    boat.run(30.0)
    assert boat.heading_rad < 0.8  # during the turn to port
    boat.run(260.0)
    assert boat.heading_rad == pytest.approx(1.5 - 2 * math.pi, abs=0.02)


def test_position_goal_is_approached():
    boat = Boat()
    boat.position, boat.position_ticks = FIX, 10
    boat.get_under_way()
    boat.tick(SteerPosition(0.5, 0.5001))
    output = boat.run(300.0)
    assert error_deg(boat, math.pi / 2) < 2.0
    assert output.snapshot.distance_m == pytest.approx(559.0 - 120.0, abs=20.0)
    assert output.snapshot.bearing_rad == pytest.approx(math.pi / 2, abs=0.03)
    assert abs(output.snapshot.navigation.cross_track_m) < 5.0
    assert output.snapshot.navigation.activity is Activity.LINE


def test_rudder_is_constant_then_centred_without_a_heading():
    boat = Boat().get_under_way()
    boat.tick(SteerHeading(2.5))
    boat.run(5.0)
    assert boat.outputs[-1].command.shaft_rad > 0.3
    boat.compass = False
    last_rad = boat.run(1.5).command.shaft_rad
    assert "No valid heading: rudder held, then centred" in boat.events
    assert boat.outputs[-1].snapshot.faults >> Fault.COMPASS_LOST & 1
    assert boat.run(8.0).command.shaft_rad == last_rad
    assert boat.run(4.0).command.shaft_rad == 0.0
    boat.compass = True
    boat.run(120.0)
    assert "Heading recovered" in boat.events
    assert error_deg(boat, 2.5) < 0.5


def test_shaft_angle_includes_centre_and_direction_of_the_servo():
    parameters = ParameterSet().replaced("RUD_CENTRE_DEG", 10.0).replaced("RUD_REVERSE", 1)
    boat = Boat(parameters).get_under_way(Mode.MANUAL)
    boat.tick(ManualRudder(1.0))
    output = boat.run(2.0)
    assert output.command.shaft_rad == pytest.approx(math.radians(10.0 - 30.0), rel=1e-6)
    assert output.snapshot.rudder_rad == pytest.approx(math.radians(30.0), rel=1e-3)


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


def test_delay_until_a_time_of_day_ends_without_a_receiver():
    boat = Boat(noise_rad=0.002)
    midnight_s = 20000 * 86400.0
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.5, 0.5, utc_s=midnight_s)
    until = PlanItem(Command.DELAY, frame=2, params=(-1.0, 0.0, 1.0, 0.0))
    turn = PlanItem(Command.YAW, frame=2, params=(90.0, 0.0, 0.0, 0.0))
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [until, turn])))
    boat.get_under_way(Mode.AUTO)
    boat.run(5.0)  # all fixes have the time of midnight
    boat.position = None
    boat.run(55.0)
    assert "Mission: item 2" not in boat.events
    boat.run(10.0)
    assert "Mission: item 2" in boat.events


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300, -1e300])
def test_requests_with_invalid_values_are_denied(value):
    boat = Boat().get_under_way()
    for intent in (
        SteerHeading(value),
        SteerPosition(value, value),
        ManualRudder(value),
        SetParameter("CTL_K1", value),
    ):
        state, answer = accept(boat.state, Request(boat.t_s, intent))
        assert state is boat.state
        assert answer.verdict is Verdict.DENIED


@pytest.mark.parametrize(("number", "limit"), [(0, math.pi / 2.0), (1, math.pi), (2, 1e5)])
def test_coordinates_are_accepted_up_to_their_limits(number, limit):
    state = State.at_start(ParameterSet())
    for value in (limit, -limit, 1.0000001 * limit, -1.0000001 * limit, math.nan):
        place = [0.1, 0.1, 0.0]
        place[number] = value
        for order in (SetHome(*place), *([SteerPosition(*place[:2])] if number < 2 else [])):
            _, answer = accept(state, Request(0.0, order))
            assert (answer.verdict is not Verdict.DENIED) is (abs(value) == limit)


def test_item_numbers_are_checked_and_only_auto_ends_a_pause():
    boat = Boat()
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.4, 0.1)
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.YAW, frame=2)])))
    verdicts = [accept(boat.state, Request(boat.t_s, SetMissionItem(index)))[1].verdict for index in (-1, 0, 1)]
    assert verdicts == [Verdict.DENIED, Verdict.ACCEPTED, Verdict.DENIED]
    boat.get_under_way(Mode.AUTO).tick(PauseMission(paused=True))
    for mode, paused in ((Mode.HOLD, True), (Mode.AUTO, False)):
        boat.tick(SetMode(mode))
        assert (boat.state.modes.mode, boat.state.guidance.mission.paused) == (mode, paused)


@pytest.mark.parametrize(
    ("progress", "expected"),
    [
        ({"index": 1, "begun": True}, {"index": 1, "begun": True}),
        ({"index": 1, "complete": True}, {"index": 0, "complete": False}),
        ({"complete": True, "unusable": True}, {"complete": True, "unusable": True}),
    ],
)
def test_auto_restarts_a_complete_mission(progress, expected):
    boat = Boat()
    boat.position = FIX
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.YAW, frame=2)] * 2)))
    boat.get_under_way(Mode.AUTO)
    mission = MissionProgress(boat.state.plans.mission.identity, started=True)
    state = replace(boat.state, guidance=replace(boat.state.guidance, mission=replace(mission, **progress)))
    accepted, _ = accept(state, Request(boat.t_s, SetMode(Mode.AUTO)))
    assert accepted.guidance.mission == replace(mission, **expected)


@pytest.mark.parametrize("place", [(0.5, None), (None, 0.5)])
def test_home_without_coordinates_is_the_present_position(place):
    boat = Boat()
    assert accept(boat.state, Request(boat.t_s, SetHome(*place)))[1].verdict is Verdict.TEMPORARILY_REJECTED
    boat.position = PositionSample(0.0, FixType.FIX_3D, 0.4, 0.1)
    boat.run(1.0)
    home = accept(boat.state, Request(boat.t_s, SetHome(*place)))[0].home
    assert (home.latitude_rad, home.longitude_rad) == pytest.approx((0.4, 0.1), abs=1e-6)


@pytest.mark.parametrize(
    ("fence", "expected"), [((), "Fence enabled, but none is loaded: send one"), ((5003,), "Fence enabled")]
)
def test_item_that_enables_a_missing_fence_is_reported(fence, expected):
    boat = Boat()
    boat.position = FIX
    circles = [PlanItem(command, frame=0, params=(50.0, 0.0, 0.0, 0.0), x=1, y=1) for command in fence]
    boat.tick(ReplacePlan(Plan.of(PlanKind.FENCE, circles)))
    boat.tick(ReplacePlan(Plan.of(PlanKind.MISSION, [PlanItem(Command.FENCE_ENABLE, 2, params=(1.0, 0.0, 0.0, 0.0))])))
    boat.get_under_way(Mode.AUTO)
    boat.run(2.0)
    fence_texts = [text for text in boat.events if "ence " in text and "loiter" not in text]
    assert [text for text in fence_texts if "reach" not in text] == [expected]


WRONG_POSITION, RIGHT_POSITION = (0.0, 0.1), (0.5, 0.2)
HOME = (0.4, 0.1)


def fixes(place, start_s, end_s, step_s=1):
    return [(float(t_s), *place) for t_s in range(start_s, end_s, step_s)]


@pytest.mark.parametrize(
    ("positions", "set_s", "expected"),
    [
        (fixes(WRONG_POSITION, 0, 20) + fixes(RIGHT_POSITION, 20, 100), None, [WRONG_POSITION, RIGHT_POSITION]),
        (
            fixes(WRONG_POSITION, 0, 20) + fixes(RIGHT_POSITION, 20, 100),
            10.0,
            [WRONG_POSITION, HOME],
        ),  # a commanded home is not changed
        (fixes(RIGHT_POSITION, 0, 3), 0.0, [HOME]),
        # A wrong first position is corrected for half an hour.
        (
            fixes(WRONG_POSITION, 10_000, 11_700, 10) + fixes(RIGHT_POSITION, 11_700, 11_900, 10),
            None,
            [WRONG_POSITION, RIGHT_POSITION],
        ),
        (fixes(WRONG_POSITION, 10_000, 11_900, 10) + fixes(RIGHT_POSITION, 11_900, 12_100, 10), None, [WRONG_POSITION]),
        # Later errors do not change home.
        (
            fixes(RIGHT_POSITION, 0, 1900, 10) + fixes(WRONG_POSITION, 1900, 2000) + fixes(RIGHT_POSITION, 2000, 2001),
            None,
            [RIGHT_POSITION],
        ),
    ],
)
def test_home_is_the_corrected_first_position_unless_it_is_set(positions, set_s, expected):
    state, homes = State.at_start(ParameterSet().replaced("POS_JUMP_S", 60.0)), []
    for index, (t_s, *place) in enumerate(positions):
        requests = (Request(t_s, SetHome(*HOME, 0.0)),) if t_s == set_s else ()
        samples = (PositionSample(t_s, FixType.FIX_3D, *place, 3.0),)
        state, output = step(state, Inputs(Tick(index, t_s, 0.0, 0, 1.0), (), samples, (), (), requests))
        homes.append(output.snapshot.home)
    altitudes_m = {WRONG_POSITION: 3.0, RIGHT_POSITION: 3.0, HOME: 0.0}
    assert list(dict.fromkeys(homes)) == [Home(*place, altitudes_m[place]) for place in expected]


@pytest.mark.parametrize(("armed", "min_m", "max_m"), [(True, 21.0, 27.0), (False, 0.0, 3.0)])
def test_dead_reckoning_moves_the_position_only_while_armed(armed, min_m, max_m):
    boat = Boat(noise_rad=0.01)
    boat.position, boat.position_ticks = FIX, 10
    boat.get_under_way().tick(SteerHeading(0.5))
    boat.run(60.0)
    boat.tick(Arm(armed=armed))
    fix, boat.position = boat.state.position.fix, None
    boat.run(60.0)
    place = boat.state.position
    north_m = 6371008.8 * (place.latitude_rad - fix.latitude_rad)
    east_m = 6371008.8 * math.cos(0.5) * (place.longitude_rad - fix.longitude_rad)
    assert min_m <= math.hypot(north_m, east_m) <= max_m


def test_rtl_steers_to_the_corrected_home():
    boat = Boat(ParameterSet().replaced("POS_JUMP_S", 10.0), noise_rad=0.002)
    boat.position = PositionSample(0.0, FixType.FIX_3D, *WRONG_POSITION)
    output = boat.get_under_way(Mode.RTL).run(1.0)
    assert (
        output.snapshot.navigation.target_latitude_rad,
        output.snapshot.navigation.target_longitude_rad,
    ) == WRONG_POSITION
    boat.position = PositionSample(0.0, FixType.FIX_3D, *RIGHT_POSITION)
    output = boat.run(20.0)
    target = output.snapshot.navigation
    assert (target.target_latitude_rad, target.target_longitude_rad) == pytest.approx(RIGHT_POSITION, abs=1e-5)
    boat.tick(SetHome(0.50001, 0.2, 0.0))
    assert boat.run(1.0).snapshot.navigation.target_latitude_rad == 0.50001


def test_home_is_the_first_fix_until_it_is_set():
    state = State.at_start(ParameterSet())

    def tick(index, *intents, latitude_rad=None):
        nonlocal state
        t_s = 0.1 * index
        positions = () if latitude_rad is None else (PositionSample(t_s, FixType.FIX_3D, latitude_rad, 0.2, 3.0),)
        requests = tuple(Request(t_s, intent) for intent in intents)
        state, output = step(state, Inputs(Tick(index, t_s, 0.0, 0, 10.0), (), positions, (), (), requests))
        return output.snapshot.home

    assert tick(0, SetHome()) is None
    assert tick(1, latitude_rad=0.5) == Home(0.5, 0.2, 3.0)
    assert tick(2, latitude_rad=0.500001) == Home(0.5, 0.2, 3.0)
    assert tick(3, SetHome()) == Home(0.500001, 0.2, 3.0)
    assert tick(4, SetHome(0.1, -0.3, 2.0)) == Home(0.1, -0.3, 2.0)
    for invalid in (SetHome(2.0, 0.0), SetHome(0.0, math.nan), SetHome(0.0, 0.0, math.inf)):
        assert tick(5, invalid) == Home(0.1, -0.3, 2.0)


def test_boot_arm_and_boot_mode_set_the_initial_state():
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", 15)
    boat = Boat(parameters, heading_rad=2.0)
    boat.compass = False
    boat.run(1.0)
    boat.compass = True
    boat.run(60.0)
    assert error_deg(boat, 2.0) < 0.3
    assert boat.outputs[-1].snapshot.armed


def test_same_inputs_give_the_same_rudder_from_any_checkpoint():
    boat = Boat(noise_rad=0.01, seed=7).get_under_way()
    boat.tick(SteerHeading(4.0), SetParameter("CTL_K1", 35.7))
    boat.run(30.0)
    state = State.at_start(ParameterSet())
    for inputs, output in zip(boat.inputs, boat.outputs, strict=True):
        if inputs.tick.index % 50 == 0:
            state, _ = state_from_text(state_to_text(state))
        state, repeated_output = step(state, inputs)
        assert repeated_output == output
    assert state_to_text(state) == state_to_text(boat.state)


EXTREME_FLOATS = st.floats() | st.sampled_from([0.0, -0.0, 1e300, -1e300, math.nan, math.inf])


def test_invalid_position_does_not_move_the_rudder():
    boat = Boat()
    boat.position = FIX
    boat.get_under_way()
    boat.tick(SteerPosition(0.5 + 0.001 * math.cos(0.5), 0.5 + 0.001 * math.tan(0.5)))
    boat.run(60.0)
    boat.position = PositionSample(0.0, FixType.FIX_3D, math.nan, math.inf)
    assert abs(boat.run(4.0).command.shaft_rad) < 0.1


@example([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 4.7e13), (0.0, 0.0, 0.0)], True)
@given(st.lists(st.tuples(EXTREME_FLOATS, EXTREME_FLOATS, EXTREME_FLOATS), min_size=1, max_size=30), st.booleans())
def test_any_device_input_gives_a_command_within_the_limits(rows, has_angle):
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", 15)
    state = State.at_start(parameters)
    previous_rad = 0.0
    for index, (heading_rad, position_rad, shaft_rad) in enumerate(rows):
        t_s = 0.1 * index
        state, output = step(
            state,
            Inputs(
                Tick(index, t_s, 0.0, 0, 10.0),
                (HeadingSample(t_s, heading_rad, NorthReference.TRUE),),
                (PositionSample(t_s, FixType.FIX_2D, position_rad, position_rad, None, position_rad, position_rad),),
                (RudderFeedback(t_s, shaft_rad if has_angle else None),),
            ),
        )
        command_rad = output.snapshot.rudder_command_rad
        assert abs(command_rad) <= math.radians(30.0) + 1e-9
        assert abs(command_rad - previous_rad) <= math.radians(3.0) + 1e-9
        previous_rad = command_rad


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


def test_read_only_parameter_is_refused():
    state, answer = accept(State.at_start(ParameterSet()), Request(0.0, SetParameter("STAT_BOOTCNT", 5.0)))
    assert (answer.verdict, answer.text) == (Verdict.DENIED, "STAT_BOOTCNT is read-only")
    assert state.parameters == ParameterSet()


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


def test_rudder_without_a_measured_angle_is_estimated():
    boat = Boat()
    boat.measures = False
    boat.get_under_way()
    boat.tick(SteerHeading(1.5))
    snapshot = boat.run(1.0).snapshot
    assert snapshot.rudder_rad is None
    assert 0.1 < snapshot.rudder_estimate_rad < snapshot.rudder_command_rad
    boat.run(120.0)
    assert error_deg(boat, 1.5) < 1.0
    assert boat.events.count("Rudder angle: estimated") == 1
    assert state_from_text(state_to_text(boat.state))[0].rudder == boat.state.rudder


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
