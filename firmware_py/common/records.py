"""The frozen records that cross a boundary between two parts of the autopilot.

Conventions: SI units and radians; headings clockwise from true north unless a
reference says otherwise; positive rudder turns the boat to starboard; `t_s` is on the
monotonic clock of the process; an absent value is None, never a magic number.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_py.common.intents import Request
from firmware_py.common.mode_table import Mode


class NorthReference(IntEnum):
    """What a compass heading is counted from."""

    TRUE = 0
    MAGNETIC = 1


class FixType(IntEnum):
    """Quality of a position fix, numbered as MAVLink's GPS_FIX_TYPE."""

    NONE = 1
    FIX_2D = 2
    FIX_3D = 3
    DGPS = 4
    RTK_FLOAT = 5
    RTK_FIXED = 6


class DeviceRole(IntEnum):
    """Which device a health record speaks of."""

    COMPASS = 0
    POSITION = 1
    RUDDER = 2
    STORAGE = 3
    LINK = 4  # the ground stations: RUNNING while one is heard
    CLOCK = 5  # the computer's clock against the loop's: FAULTY when it has just jumped
    COMPASS_B = 6


class DeviceState(IntEnum):
    """What a driver knows of its device."""

    ABSENT = 0  # the port cannot be opened, or has vanished
    STARTING = 1  # the port is open, the device has not answered yet
    RUNNING = 2
    SILENT = 3  # the port is open, the device has stopped answering
    FAULTY = 4  # the device answers and reports an error of its own
    FULL = 5  # a storage that works and has no room


class Severity(IntEnum):
    """Severity of a message to the operator, numbered as MAVLink's MAV_SEVERITY."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


# --------------------------------------------------------------------------- inputs


@dataclass(frozen=True, slots=True)
class Tick:
    """One turn of the fixed-rate loop.

    `t_s` is the deadline the tick was due at and the time that every computation of
    the tick uses; `late_s` is how much later it began; `skipped` counts the
    deadlines that passed unserved just before it; `rate_hz` is the nominal rate.
    """

    index: int
    t_s: float
    late_s: float
    skipped: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class HeadingSample:
    """One heading from a compass, stamped when its last byte arrived."""

    t_s: float
    heading_rad: float  # [0, 2 pi), as the device gives it, from `reference`
    reference: NorthReference
    variation_rad: float | None = None  # east positive, when the device states it
    yaw_rate_rad_s: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None
    temperature_c: float | None = None
    source: int = 0  # 0 = compass A, 1 = compass B


@dataclass(frozen=True, slots=True)
class PositionSample:
    """One position fix, or the statement that there is none (`fix` NONE)."""

    t_s: float
    fix: FixType
    latitude_rad: float | None = None
    longitude_rad: float | None = None
    altitude_m: float | None = None
    speed_over_ground_m_s: float | None = None
    course_over_ground_rad: float | None = None
    satellites: int | None = None
    hdop: float | None = None
    utc_s: float | None = None  # seconds since 1970-01-01 UTC, when the device states it


@dataclass(frozen=True, slots=True)
class RudderFeedback:
    """What the rudder servo says of itself, in the frame of its own shaft.

    The latest value of each quantity; None while the servo has not given it. The
    loop converts `shaft_rad` to a rudder angle (centre, direction).
    """

    t_s: float
    shaft_rad: float | None = None
    temperature_c: float | None = None
    voltage_v: float | None = None
    current_a: float | None = None
    hardware_error: int = 0  # the device's own error bits, 0 = none
    torque_on: bool | None = None
    restarts: int = 0  # how often the servo was found to have come up anew by itself


@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """State of a device and its counters since start; given to the loop on change."""

    t_s: float
    role: DeviceRole
    state: DeviceState
    accepted: int  # good messages
    rejected: int  # checksum, range or framing errors
    text: str = ""  # one short line when there is something to say


class CalibrationState(IntEnum):
    """How far the calibration of a device is."""

    NONE = 0  # never begun, or called off
    RUNNING = 1
    DONE = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration that a device makes by itself; the text says how it ended."""

    state: CalibrationState = CalibrationState.NONE
    percent: int = 0
    text: str = ""


# ------------------------------------------------------------------------- all inputs


@dataclass(frozen=True, slots=True)
class Inputs:
    """Everything that one tick computes from."""

    tick: Tick
    headings: tuple[HeadingSample, ...] = ()
    positions: tuple[PositionSample, ...] = ()
    rudder: tuple[RudderFeedback, ...] = ()
    devices: tuple[DeviceHealth, ...] = ()
    requests: tuple[Request, ...] = ()


# --------------------------------------------------------------------------- outputs


@dataclass(frozen=True, slots=True)
class RudderCommand:
    """What the servo is told: the angle of its shaft, and whether it may pull."""

    shaft_rad: float
    torque_on: bool


@dataclass(frozen=True, slots=True)
class RudderStatus:
    """What a tick knows of the rudder, in the rudder's own frame; made once, before anything looks at the rudder.

    `command_rad` is what the servo was last told. `angle_rad` is the angle measured last, or the one
    commanded while the servo gives none (`measured` tells). `is_new`: the servo has answered since the
    last tick; `feedback_s` is when it last did, None before it has. `torque_on`, `current_a` and
    `power_w` are those of that answer, None where it does not say.
    """

    t_s: float
    command_rad: float
    angle_rad: float
    measured: bool = False
    is_new: bool = False
    feedback_s: float | None = None
    torque_on: bool | None = None
    current_a: float | None = None
    power_w: float | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """A message to the operator."""

    severity: Severity
    text: str


class MissionState(IntEnum):
    """How far the mission is, numbered as MAVLink's MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True, slots=True)
class Home:
    """Where the boat returns to, and the origin of local coordinates."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float


@dataclass(frozen=True, slots=True)
class MissionReport:
    """The mission as the operator follows it: `index` counts from 0, None without a current item.

    `reached` are the items that were reached in this very tick; `identities` are the
    checksums of mission, fence and rally points (plan.Plan.identity).
    """

    state: MissionState = MissionState.NO_MISSION
    index: int | None = None
    count: int = 0
    reached: tuple[int, ...] = ()
    identities: tuple[int, int, int] = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class Water:
    """Speed through the water and the current over the ground, with standard deviations.

    `current_sd_m_s` is that of the worse known direction. `too_strong`: the current is
    stronger than the boat, so that it cannot hold a place against it.
    """

    speed_m_s: float
    speed_sd_m_s: float
    current_north_m_s: float
    current_east_m_s: float
    current_sd_m_s: float
    too_strong: bool = False


class Activity(IntEnum):
    """What guidance has the boat do."""

    NOTHING = 0  # no goal of guidance: rudder by hand or amidships
    HEADING = 1  # a heading or a course
    LINE = 2  # along a line to a place
    STATION = 3  # a watch circle around a place
    CIRCLE = 4  # round a place


@dataclass(frozen=True, slots=True)
class Navigation:
    """Where guidance takes the boat: the place, the circle around it and how far off the line the boat is.

    `cross_track_m` is positive to starboard of the line. `fence_margin_m` is the distance to a
    breach of the fence, negative in breach, None while the fence is not heeded or not known.
    """

    activity: Activity = Activity.NOTHING
    target_latitude_rad: float | None = None
    target_longitude_rad: float | None = None
    radius_m: float | None = None
    cross_track_m: float | None = None
    arrived: bool = False
    fence_enabled: bool = False
    fence_margin_m: float | None = None


@dataclass(frozen=True, slots=True)
class HeadingEstimate:
    """What the filter gives to steer by: heading and yaw rate without the yaw of the waves, and how the boat answers.

    `bias_rad` is the rudder angle at which the boat runs straight, `speed_m_s` that through the water,
    `turning_factor` by what the boat turns better than its model says; `_sd_`: standard deviation.
    """

    heading_rad: float
    heading_sd_rad: float
    yaw_rate_rad_s: float
    bias_rad: float
    speed_m_s: float
    speed_sd_m_s: float
    turning_factor: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the wave filter knows, with standard deviations; headings are without the yaw of the waves.

    `source` is what the heading is taken from: compass A 0, compass B 1, course over ground 2, nothing 3.
    `bias_rad` is the rudder angle at which the boat runs straight, `turning_factor` by what it turns better
    than its model says. `innovation_rad` is what the last heading differed from the expected one,
    `innovation_square` the average of such differences squared, by their variance: 1 for an honest filter.
    """

    source: int
    heading_rad: float
    heading_sd_rad: float
    yaw_rate_rad_s: float
    yaw_rate_sd_rad_s: float
    bias_rad: float
    bias_sd_rad: float
    wave_period_s: float
    wave_sd_rad: float
    compass_noise_rad: float
    speed_m_s: float
    speed_sd_m_s: float
    current_north_m_s: float
    current_east_m_s: float
    turning_factor: float
    innovation_rad: float
    innovation_sd_rad: float
    innovation_square: float


@dataclass(frozen=True, slots=True)
class Energy:
    """What steering has cost since start, the rudder's travel and reversals in about the last hour, the servo's power.

    `energy_j` and `power_w` are those that the servo tells of; `resting`: its torque is released.
    """

    travel_rad: float = 0.0
    reversals: int = 0
    energy_j: float = 0.0
    travel_rad_per_h: float = 0.0
    reversals_per_h: float = 0.0
    power_w: float | None = None
    resting: bool = False


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of the boat after a tick, for the log and the link.

    `rudder_rad` is measured, `rudder_command_rad` is commanded, both in the frame of
    the rudder. `heading_ok` and `position_ok` say that the values are fresh.
    `distance_m` is None without a position goal.
    """

    t_s: float
    tick: int
    mode: Mode
    armed: bool
    heading_rad: float | None
    heading_ok: bool
    yaw_rate_rad_s: float | None
    roll_rad: float | None
    pitch_rad: float | None
    goal_heading_rad: float | None
    heading_error_rad: float | None
    bearing_rad: float | None
    distance_m: float | None
    rudder_rad: float | None
    rudder_command_rad: float
    rudder_ok: bool
    servo: RudderFeedback | None
    position: PositionSample | None
    position_ok: bool
    faults: int  # bit n is row n of faults.TABLE
    rate_hz: float
    skipped_total: int
    late_s: float
    home: Home | None = None
    mission: MissionReport = MissionReport()
    prearm_refusal: str = ""  # why arming would be refused; empty: it would be accepted
    estimate: Estimate | None = None
    water: Water | None = None
    navigation: Navigation = Navigation()
    energy: Energy | None = None


@dataclass(frozen=True, slots=True)
class Output:
    """What one tick decides."""

    command: RudderCommand
    snapshot: Snapshot
    events: tuple[Event, ...] = ()
