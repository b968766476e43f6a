"""Record the logs of data/voyages/: minutes in which much happens, for the replay of everything that a tick computes.

.venv/bin/python tests/replay/voyages.py [NAME ...]

After an intended change of behaviour, relog.py computes them again with the same inputs. They are recorded again only
if the inputs have to change. The boat is a K-T model with a sea of its own, at 2 Hz, so that the logs are small.
"""

import gzip
import math
import random
import sys
import tempfile
from pathlib import Path

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    EnableFence,
    ForgetParameters,
    ManualRudder,
    PauseMission,
    ReplacePlan,
    ReportBattery,
    Request,
    Restart,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    SteerHeading,
    SteerPosition,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
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
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_to_text
from firmware_py.core.step import step
from firmware_py.log.recorder import LogRecorder
from firmware_py.plans.items import Command
from replay.relog import UTC_S, recompute_log
from support.plans import EARTH_M, FENCE_ITEMS, item, placed

VOYAGES = Path(__file__).parent / "data" / "voyages"
STEP_S = 0.5
ABILITY_1_S, LAG_S, NOMINAL_M_S = 0.049, 4.0, 0.4
MAX_MOVE_RAD = 0.26  # of the rudder in a step


class Boat:
    """A boat with its sea and devices; the scripts below change its fields."""

    def __init__(self, recorder_folder, seed, plans=None, **parameters):
        values = ParameterSet().replaced("LOOP_RATE_HZ", 2)
        for name, value in parameters.items():
            values = values.replaced(name, value)
        self.state = State.at_start(values, plans or Plans())
        self.recorder = LogRecorder(
            recorder_folder,
            parameters=values,
            plans=self.state.plans,
            file_bytes=1 << 26,
            max_total_bytes=1 << 28,
            utc_s=UTC_S,
            software="voyage",
            background=False,
        )
        self.rng = random.Random(seed)
        self.index = 0
        # Ship and sea.
        self.speed_m_s, self.current_m_s = 0.6, (0.05, 0.12)
        self.wave_rad, self.wave_s, self.bias_rad = math.radians(4.0), 6.0, math.radians(3.0)
        self.effect, self.delay_s = 1.0, 0.0  # of the rudder on the yaw rate; wave_s is the period of the waves
        self.heading_rad, self.rate_rad_s, self.rudder_rad = 0.3, 0.0, 0.0
        self.north_m = self.east_m = 0.0
        self.commands_rad = []
        # Devices.
        self.compasses, self.reference = [True, True], NorthReference.TRUE
        self.offsets_rad, self.frozen_rad = [0.0, math.radians(3.0)], None
        self.has_fix, self.jump_m, self.fix_kind = True, (0.0, 0.0), FixType.FIX_3D
        self.is_stuck, self.is_servo_silent = False, False
        self.servo_a, self.servo_v, self.servo_c, self.servo_error, self.restarts = 0.05, 12.2, 24.0, 0, 0
        self.torque_on = True
        self.has_power, self.charge, self.battery_v = True, 0.8, 12.9
        self.vessels = []  # functions of the time that return AIS reports
        self.origin_rad = None  # another place than that of the plans
        self.variations_rad, self.has_details = (0.01, None), True  # of the headings; their other values
        self.has_velocity = self.has_angle = True
        self.skipped = 0

    @property
    def t_s(self):
        return STEP_S * self.index

    def wave(self, amplitude, shift=0.0):
        return amplitude * math.sin(math.tau * self.t_s / self.wave_s + shift)

    def headings(self):
        for source, is_on in enumerate(self.compasses):
            noise_rad = math.radians(self.rng.gauss(0.0, 0.3))
            heading_rad = self.heading_rad + self.wave(self.wave_rad) + self.offsets_rad[source] + noise_rad
            heading_rad = math.radians(round(math.degrees(heading_rad) * 10.0) / 10.0) % math.tau
            if source == 0 and self.frozen_rad is not None:
                heading_rad = self.frozen_rad
            if is_on:
                details = (
                    self.rate_rad_s if source == 0 else None,
                    self.wave(0.1, 1.0),
                    self.wave(0.05, 2.0),
                    18.0 + source,
                )
                if not self.has_details:
                    details = (None,) * 4
                yield HeadingSample(
                    self.t_s, heading_rad, self.reference, self.variations_rad[source], *details, source
                )

    def positions(self):
        if self.index % 2 or not self.has_fix:
            return
        if self.fix_kind is FixType.NONE:
            yield PositionSample(self.t_s, FixType.NONE)
            return
        v_north, v_east = self.velocity_m_s()
        v_north += self.rng.gauss(0.0, 0.03)
        v_east += self.rng.gauss(0.0, 0.03)
        north_m = self.north_m + self.jump_m[0] + self.rng.gauss(0.0, 1.0)
        east_m = self.east_m + self.jump_m[1] + self.rng.gauss(0.0, 1.0)
        values = (2.0 + self.wave(0.3), math.hypot(v_north, v_east), math.atan2(v_east, v_north) % math.tau, 11, 0.9)
        if not self.has_velocity:
            values = (None,) * 5
        utc_s = UTC_S + self.t_s if self.has_velocity else None
        yield PositionSample(self.t_s, self.fix_kind, *self.place(north_m, east_m), *values, utc_s)

    def place(self, north_m, east_m):
        if self.origin_rad is None:
            return placed(north_m, east_m)
        latitude_rad = self.origin_rad[0] + north_m / EARTH_M
        longitude_rad = self.origin_rad[1] + east_m / (EARTH_M * math.cos(self.origin_rad[0]))
        return latitude_rad, (longitude_rad + math.pi) % math.tau - math.pi

    def velocity_m_s(self):
        return (
            self.speed_m_s * math.cos(self.heading_rad) + self.current_m_s[0],
            self.speed_m_s * math.sin(self.heading_rad) + self.current_m_s[1],
        )

    def feedback(self):
        if not self.is_servo_silent:
            shaft_rad = round(self.rudder_rad * 4096.0 / math.tau) * math.tau / 4096.0
            yield RudderFeedback(
                self.t_s,
                shaft_rad if self.has_angle else None,
                self.servo_c if self.has_angle else None,
                self.servo_v,
                self.servo_a,
                self.servo_error,
                self.torque_on,
                self.restarts,
            )

    def power(self):
        if self.has_power and self.index % 4 == 0:
            yield PowerSample(self.t_s, 0, 13.1, 1.5 + self.wave(0.5), None, 21.0 + self.wave(5.0), 0.2, 30.0)
            yield PowerSample(self.t_s, 1, self.battery_v, 0.6 - self.wave(1.0), self.charge, temperature_c=15.0)

    def health(self, role, state, text=""):
        return DeviceHealth(self.t_s, role, state, self.index, 0, text)

    def tick(self, *intents, devices=()):
        if self.index == 0:
            devices = tuple(self.health(role, DeviceState.RUNNING) for role in DeviceRole)
        inputs = Inputs(
            Tick(self.index, self.t_s, 0.0002, self.skipped, 1.0 / STEP_S),
            tuple(self.headings()),
            tuple(self.positions()),
            tuple(self.feedback()),
            tuple(devices),
            tuple(Request(self.t_s, intent, 255, 190) for intent in intents),
            tuple(self.power()),
            tuple(report for vessel in self.vessels for report in vessel(self.t_s)),
        )
        self.skipped = 0
        before = self.state
        self.state, output = step(before, inputs)
        self.recorder.offer(inputs, output, lambda: state_to_text(before))
        self.move(output.command)
        self.index += 1
        return output

    def move(self, command):
        """Advance servo, ship and sea by a step."""
        if not self.is_stuck:
            self.rudder_rad += min(max(command.shaft_rad - self.rudder_rad, -MAX_MOVE_RAD), MAX_MOVE_RAD)
        self.torque_on = command.torque_on
        self.commands_rad.append(self.rudder_rad)
        acting_rad = self.commands_rad[max(len(self.commands_rad) - 1 - round(self.delay_s / STEP_S), 0)]
        ratio = max(self.speed_m_s, 0.05) / NOMINAL_M_S
        steady_rad_s = ABILITY_1_S * ratio * (self.effect * acting_rad - self.bias_rad)
        self.rate_rad_s += STEP_S * (steady_rad_s - self.rate_rad_s) / (LAG_S / ratio)
        self.heading_rad += STEP_S * self.rate_rad_s
        v_north, v_east = self.velocity_m_s()
        self.north_m += STEP_S * v_north
        self.east_m += STEP_S * v_east

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.tick()

    def report(self, role, state, text=""):
        self.tick(devices=(self.health(role, state, text),))


def plan(kind, *items):
    return Plan.of(kind, items)


# All kinds of items.
MISSION_ITEMS = (
    item(Command.WAYPOINT, 50, 0),
    item(Command.CHANGE_SPEED, None, None, 0, 0.5),
    item(Command.WAYPOINT, 50, 40, 10),
    item(Command.YAW, None, None, 180, 0, 0, 0),
    item(Command.DELAY, None, None, 15),
    item(Command.YAW_SPEED, None, None, 90, 0, 1),
    item(Command.LOITER_TURNS, 30, 60, 1, 0, 25),
    item(Command.JUMP_TAG, None, None, 7),
    item(Command.LOITER_TIME, 0, 50, 20, 0, -25),
    item(Command.SET_HOME, 5, 5, 0),
    item(Command.CONDITION_DELAY, None, None, 5),
    item(Command.CONDITION_DISTANCE, None, None, 20),
    item(Command.WAYPOINT, 0, 30, 0, 12),
    item(Command.JUMP_TO_TAG, None, None, 7, 1),
    item(Command.JUMP, None, None, 13, 1),
    item(Command.RETURN),
    item(Command.LOITER_UNLIMITED, 0, 0),
)


def sail_mission(folder):
    """All kinds of items, a pause, jumps, the fence, the loss of the ground station, rally point and home."""
    plans = Plans(
        mission=plan(PlanKind.MISSION, *MISSION_ITEMS),
        fence=plan(PlanKind.FENCE, *FENCE_ITEMS),
        rally=plan(PlanKind.RALLY, item(Command.RALLY_POINT, 40, -60)),
    )
    settings = {"FENCE_ENABLE": 1, "FS_GCS_ACT": 4, "FS_GCS_S": 20.0, "FS_RESUME": 1}
    boat = Boat(folder, 1, plans, LOIT_RADIUS=25.0, WP_RADIUS=8.0, NAV_LOOK_S=20.0, **settings)
    boat.speed_m_s = 1.3
    boat.run(5.0)
    boat.tick(SetHome(), Arm(armed=True))
    boat.tick(SetMode(Mode.AUTO))
    boat.run(100.0)
    boat.tick(PauseMission(paused=True))
    boat.run(30.0)
    boat.tick(PauseMission(paused=False))
    boat.run(330.0)
    boat.tick(SetMissionItem(8))
    boat.run(60.0)
    boat.tick(SetMissionItem(12, restart=True))
    boat.run(60.0)
    boat.tick(
        ReplacePlan(
            plan(
                PlanKind.MISSION, item(Command.WAYPOINT, 120, 0), item(Command.WAYPOINT, 120, 120), item(Command.RETURN)
            )
        ),
        SetMode(Mode.AUTO),
    )
    boat.tick(SetMode(Mode.AUTO))
    boat.run(60.0)
    boat.report(DeviceRole.LINK, DeviceState.SILENT)
    boat.run(50.0)
    boat.report(DeviceRole.LINK, DeviceState.RUNNING)
    boat.run(20.0)
    boat.tick(SteerPosition(*placed(380.0, 380.0), change_mode=True))
    boat.run(20.0)
    boat.tick(EnableFence(enabled=False))
    boat.tick(SteerHeading(math.radians(200.0), change_mode=True))
    boat.run(20.0)
    boat.north_m = -260.0  # outside
    boat.run(140.0)
    boat.tick(EnableFence(enabled=True))
    boat.run(80.0)
    boat.tick(SetMode(Mode.RTL))
    boat.run(80.0)
    return boat


def let_servo_and_battery_fail(boat):
    """Faults of servo, battery, storage, clock, key and loop, one after another."""
    boat.is_stuck = True
    boat.run(20.0)
    boat.is_stuck, boat.servo_a = False, 5.0
    boat.run(15.0)
    boat.servo_a, boat.servo_c = 0.05, 75.0
    boat.run(8.0)
    boat.servo_c, boat.servo_v = 24.0, 10.5
    boat.run(15.0)
    boat.servo_v, boat.servo_error = 12.2, 4
    boat.run(5.0)
    boat.servo_error, boat.restarts = 0, 1
    boat.run(8.0)
    boat.is_servo_silent = True
    boat.run(10.0)
    boat.is_servo_silent = False
    for charge in (0.25, 0.1, 0.8):
        boat.charge = charge
        boat.run(25.0)
    boat.has_power = False
    boat.run(30.0)
    boat.has_power = True
    boat.tick(ReportBattery(12.1, -0.7, 0.5, 11.0), SetParameter("CTL_PRICE", 2.0), SetParameter("CTL_PRICE", 99.0))
    for role in (DeviceRole.STORAGE, DeviceRole.CLOCK, DeviceRole.KEY, DeviceRole.RUDDER, DeviceRole.COMPASS):
        for state in (DeviceState.FAULTY, DeviceState.FULL, DeviceState.SILENT, DeviceState.RUNNING):
            boat.report(role, state, "test")
            boat.run(2.0)
    boat.skipped = 5
    boat.run(10.0)
    boat.tick(SetParameter("RUD_REST_S", 4.0))
    boat.run(40.0)
    boat.tick(SetParameter("CTL_MODE", 0.0), SetParameter("EST_MODE", 0.0), SteerHeading(0.5, relative=True))
    boat.run(60.0)


def sail_with_device_faults(folder):
    """Faults of compasses, receiver, servo, battery, storage, clock, key and loop, one after another."""
    boat = Boat(
        folder, 2,
        Plans(mission=plan(PlanKind.MISSION, item(Command.WAYPOINT, 900, 0), item(Command.WAYPOINT, 900, 900))),
        CMP_FROZEN_S=10.0, POS_JUMP_S=20.0, POS_RECKON_M=60.0, PWR_SAVE_PCT=30.0, PWR_KEEP_PCT=15.0, FS_BATT_ACT=1,
        BAT_LOW_VOLT=11.0, FS_VOLT_ACT=2, FS_RUD_ACT=1, FS_POS_ACT=0, RUD_TEMP_MAX=60.0, FS_RESUME=1,
    )  # fmt: skip
    boat.run(3.0)
    boat.tick(Arm(armed=True), SetMode(Mode.AUTO))
    boat.run(60.0)
    for source, seconds in ((0, 25.0), (1, 15.0)):
        boat.compasses[source] = False
        boat.run(seconds)
        boat.compasses[source] = True
        boat.run(20.0)
    for offset_rad, seconds in ((math.radians(60.0), 20.0), (0.0, 20.0)):
        boat.offsets_rad[0] = offset_rad
        boat.run(seconds)
    boat.offsets_rad[1] = math.radians(50.0)
    boat.run(75.0)
    boat.offsets_rad[1] = math.radians(3.0)
    boat.compasses = [False, False]
    boat.run(50.0)
    boat.has_fix = False
    boat.run(25.0)
    boat.compasses, boat.has_fix = [True, True], True
    boat.run(30.0)
    boat.frozen_rad = 1.0
    boat.run(25.0)
    boat.frozen_rad, boat.has_fix = None, False
    boat.run(100.0)
    boat.has_fix, boat.jump_m = True, (900.0, 300.0)
    boat.run(15.0)
    boat.jump_m = (0.0, 0.0)
    boat.run(10.0)
    boat.jump_m = (0.0, 1500.0)
    boat.run(30.0)
    for kind in (FixType.FIX_2D, FixType.NONE, FixType.RTK_FIXED):
        boat.fix_kind = kind
        boat.run(8.0)
    boat.jump_m = (0.0, 0.0)
    boat.tick(SteerHeading(math.radians(120.0), change_mode=True))
    boat.run(3.0)
    let_servo_and_battery_fail(boat)
    return boat


def passing(mmsi, kind, begin, velocity, interval_s=10.0, **options):
    """Return a function that gives the reports of a vessel on a straight course; metres and metres per second."""

    def reports(t_s):
        if t_s % interval_s:
            return
        north_m, east_m = (place + speed * t_s for place, speed in zip(begin, velocity, strict=True))
        course_rad = math.atan2(velocity[1], velocity[0]) % math.tau
        yield VesselPosition(
            t_s, mmsi, kind, *placed(north_m, east_m), math.hypot(*velocity), course_rad, course_rad, **options
        )
        yield VesselIdentity(t_s, mmsi, f"SHIP {mmsi % 100}", "CALL", 70, (90, 10, 8, 8))

    return reports


def sail_in_traffic(folder):
    """Vessels ahead, astern and at rest, an echo of the boat, a distress beacon, a position that jumps."""
    legs = plan(
        PlanKind.MISSION,
        item(Command.WAYPOINT, 400, 0),
        item(Command.LOITER_TIME, 400, 60, 60, 0, 40),
        item(Command.RETURN),
    )
    fence = plan(PlanKind.FENCE, item(Command.INCLUDED_CIRCLE, 200, 0, 500))
    boat = Boat(
        folder, 3, Plans(mission=legs, fence=fence), AIS_ACT=1, AIS_NEAR_S=300.0, AIS_NEAR_M=150.0, AIS_STILL_M=60.0,
        LOIT_RADIUS=40.0, FENCE_ENABLE=1,
    )  # fmt: skip
    boat.speed_m_s = 1.0
    odd = passing(211000009, VesselKind.CLASS_B, (800.0, 900.0), (0.0, -2.0), 8.0)

    def echo(t_s):
        if t_s % 6.0 == 0.0:
            place = placed(boat.north_m + 2.0, boat.east_m - 3.0)
            yield VesselPosition(t_s, 211000005, VesselKind.CLASS_B, *place, 1.0, boat.heading_rad % math.tau)

    def jumping(t_s):
        for report in odd(t_s):
            is_far = isinstance(report, VesselPosition) and 60.0 < t_s < 90.0
            place = placed(9000.0, 9000.0) if is_far else None
            yield (
                report
                if place is None
                else VesselPosition(t_s, report.mmsi, report.kind, *place, report.speed_m_s, report.course_rad)
            )

    boat.vessels = [
        passing(211000001, VesselKind.CLASS_A, (1200.0, -40.0), (-5.0, 0.0), turn_rad_s=0.001, status=0),
        passing(211000002, VesselKind.CLASS_A, (-900.0, 60.0), (4.0, 0.0), 6.0),
        passing(211000003, VesselKind.BASE_STATION, (330.0, 30.0), (0.0, 0.0)),
        passing(992110004, VesselKind.MARK, (150.0, -50.0), (0.0, 0.0)),
        passing(970000001, VesselKind.CLASS_A, (300.0, 300.0), (0.1, 0.1), 60.0, status=14),
        passing(211000006, VesselKind.CLASS_B, (200.0, 700.0), (0.3, -2.5), 12.0),
        echo,
        jumping,
    ]
    boat.run(5.0)
    boat.tick(SetHome(*placed(0.0, 0.0)), Arm(armed=True), SetMode(Mode.AUTO))
    boat.run(420.0)
    boat.tick(SetMode(Mode.LOITER))
    boat.run(120.0)
    boat.tick(SteerPosition(*placed(100.0, -100.0), change_mode=True))
    boat.run(120.0)
    return boat


def sail_with_odd_steering(folder):
    """A boat that responds late and oscillates, loses its rudder, gets it back, and has it reversed."""
    boat = Boat(folder, 4, FS_STEER_ACT=3, FS_RESUME=1)
    boat.speed_m_s, boat.wave_rad, boat.bias_rad = 0.4, math.radians(1.5), 0.0
    boat.run(3.0)
    boat.tick(Arm(armed=True), SetMode(Mode.GUIDED), SteerHeading(0.0))
    boat.delay_s = 14.0
    for number in range(6):
        boat.tick(SteerHeading(math.radians(60.0 * (number % 2))))
        boat.run(75.0)
    boat.delay_s = 0.0
    boat.run(60.0)
    boat.effect = 0.0
    for number in range(4):
        boat.tick(SteerHeading(math.radians(40.0 if number % 2 else -40.0), over_ground=True))
        boat.run(50.0)
    boat.effect = 1.0
    for turn in (1, -1):
        boat.tick(SteerHeading(math.radians(90.0), turn=turn))
        boat.run(70.0)
    boat.effect = -1.0
    boat.tick(SteerHeading(math.radians(0.0)))
    boat.run(200.0)
    return boat


def sail_in_a_strong_current(folder):
    """A slow boat with a magnetic compass in a strong current: station keeping, return, stick, bench, parameters."""
    boat = Boat(
        folder, 5, CMP_DECL_AUTO=1, CMP_DEV_B=6.0, CMP_DEV_C=-4.0, CMP_DEV_D=1.0, CMP_OFFSET_DEG=2.0, CMPB_DEV_A=2.0,
        LOIT_RADIUS=40.0, RUD_CENTRE_DEG=3.0, RUD_LIMIT_DEG=25.0, RUD_DBAND_DEG=1.0, RUD_DISARMED=1, CTL_TRIM_DEG=1.0,
    )  # fmt: skip
    boat.reference, boat.speed_m_s, boat.current_m_s = NorthReference.MAGNETIC, 0.3, (-0.25, 0.3)
    boat.run(5.0)
    boat.tick(BenchRudder(0.5, 5.0))
    boat.run(8.0)
    boat.tick(SetHome(*placed(60.0, -60.0), 3.0), Arm(armed=True, force=True), SetMode(Mode.LOITER))
    boat.run(330.0)
    boat.tick(SetMode(Mode.RTL))
    boat.run(120.0)
    boat.current_m_s, boat.speed_m_s = (0.02, 0.05), 0.6
    boat.tick(SetMode(Mode.MANUAL))
    for deflection in (0.3, -1.0, 1.0, None):
        boat.tick(ManualRudder(deflection))
        boat.run(5.0)
    boat.tick(SetMode(Mode.STEERING))
    for deflection in (0.5, -0.4, 0.0):
        boat.tick(ManualRudder(deflection))
        boat.run(6.0)
    boat.run(40.0)
    boat.tick(SetMode(Mode.HOLD))
    boat.run(10.0)
    for name, value in (("CTL_MODE", 0.0), ("EST_TAU_S", 3.0), ("CMP_DECL_AUTO", 0.0), ("CMP_DECL_DEG", -6.0)):
        boat.tick(SetParameter(name, value))
    boat.tick(SetMode(Mode.LOITER))
    boat.run(160.0)
    boat.tick(ForgetParameters(), Restart(), Arm(armed=False))
    boat.run(5.0)
    boat.tick(Restart())
    boat.run(2.0)
    return boat


def sail_with_sparse_devices(folder):
    """Near the date line: stated variations, fixes without velocity, a servo without angle, one compass or none."""
    boat = Boat(
        folder, 6, CMP_DECL_DEG=-6.0, CMP_TIMEOUT_S=2.0, POS_TIMEOUT_S=8.0, EST_TAU_S=2.0, COG_SPEED_MIN=0.2,
        LOIT_RADIUS=30.0, RUD_REVERSE=1, BAT_LOW_VOLT=11.0, CTL_PRICE=0.5, FS_POS_ACT=2, FS_FENCE_ACT=3,
        FENCE_ENABLE=1,
    )  # fmt: skip
    boat.speed_m_s, boat.variations_rad = 0.8, (math.radians(-8.0), None)
    boat.origin_rad = (math.radians(-50.0), math.pi - 1e-5)
    boat.compasses = [True, False]
    boat.run(6.0)
    boat.tick(Arm(armed=True), SetMode(Mode.STEERING), SteerHeading(math.radians(90.0)))
    boat.effect = -1.0  # a reversed shaft
    boat.run(60.0)
    for variation_rad in (0.0, None, math.radians(30.0)):
        boat.variations_rad = (variation_rad, 0.0)
        boat.run(15.0)
    boat.has_details = False
    boat.tick(SetHome(*boat.place(0.0, 30.0)), SetMode(Mode.RTL))
    boat.run(80.0)
    boat.has_velocity = False
    boat.run(40.0)
    boat.compasses = [False, False]
    boat.run(40.0)
    boat.compasses, boat.has_velocity = [True, True], True
    boat.has_angle = False
    boat.tick(SteerPosition(*boat.place(40.0, -60.0), change_mode=True))
    boat.run(90.0)
    boat.has_angle, boat.has_fix = True, False
    boat.run(40.0)
    boat.has_fix = True
    circle = PlanItem(
        Command.INCLUDED_CIRCLE,
        3,
        True,
        (150.0, 0.0, 0.0, 0.0),
        *(round(math.degrees(a) * 1e7) for a in boat.place(0.0, 0.0)),
    )
    boat.tick(ReplacePlan(plan(PlanKind.FENCE, circle)), SetMode(Mode.LOITER))
    boat.run(40.0)
    boat.tick(SteerHeading(math.radians(300.0), over_ground=True, change_mode=True))
    boat.run(250.0)
    boat.tick(SteerHeading(math.radians(-170.0), relative=True, turn=-1))
    boat.run(60.0)
    return boat


SCRIPTS = {
    "sparse_devices": sail_with_sparse_devices,
    "mission": sail_mission,
    "device_faults": sail_with_device_faults,
    "traffic": sail_in_traffic,
    "odd_steering": sail_with_odd_steering,
    "strong_current": sail_in_a_strong_current,
}


def record(script):
    """Return the log of a script, as recompute_log writes it."""
    with tempfile.TemporaryDirectory() as folder:
        boat = script(Path(folder))
        boat.recorder.close()
        (path,) = Path(folder).glob("*.BIN")
        return recompute_log(path.read_bytes())[0]


if __name__ == "__main__":
    VOYAGES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or SCRIPTS:
        log = record(SCRIPTS[name])
        (VOYAGES / f"{name}.BIN.gz").write_bytes(gzip.compress(log, mtime=0))
        print(name, len(log))
