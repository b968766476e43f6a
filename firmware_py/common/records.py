"""The frozen records that cross a boundary between two parts of the autopilot.

Conventions: SI units and radians; headings clockwise from true north unless a
reference says otherwise; positive rudder turns the boat to starboard; `t_s` is on the
monotonic clock of the process; an absent value is None, never a magic number.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.intents import Request
from firmware_py.common.vessels import VesselReport


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
    KEY = 7  # of signed frames: FAULTY when it was lost
    POWER = 8
    POWER_B = 9
    AIS = 10


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


class Tick(msgspec.Struct, frozen=True):
    """One turn of the fixed-rate loop.

    `t_s` is the deadline the tick was due at, or when the compass just before had it begin,
    and the time that every computation of the tick uses; `late_s` is how much later it began;
    `skipped` counts the deadlines that passed unserved just before it; `rate_hz` is the nominal rate.
    """

    index: int
    t_s: float
    late_s: float
    skipped: int
    rate_hz: float


class HeadingSample(msgspec.Struct, frozen=True):
    """One heading from a compass, stamped when its last byte arrived."""

    t_s: float
    heading_rad: float  # [0, 2 pi), as the device gives it, from `reference`
    reference: NorthReference
    variation_rad: float | None = None  # east positive, as added by the device; the deviation if that is magnetic
    yaw_rate_rad_s: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None
    temperature_c: float | None = None
    source: int = 0  # 0 = compass A, 1 = compass B


class PositionSample(msgspec.Struct, frozen=True):
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


class RudderFeedback(msgspec.Struct, frozen=True):
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


class PowerSample(msgspec.Struct, frozen=True):
    """What a monitor of the battery or a charger has measured, None for what it does not measure.

    `current_a` flows into the battery, all loads that the device sees taken off. `charge` is the state of
    charge, 0 to 1. `solar_w` is what the panels give: who measures that is a charger. `load_a` goes out of a charger's
    load output. `source` is 0 for the device of [power], 1 for that of [power_b], 2 for another MAVLink component.
    """

    t_s: float
    source: int = 0
    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    solar_w: float | None = None
    load_a: float | None = None
    temperature_c: float | None = None


class DeviceHealth(msgspec.Struct, frozen=True):
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


class Calibration(msgspec.Struct, frozen=True):
    """A calibration that a device makes by itself; the text says how it ended."""

    state: CalibrationState = CalibrationState.NONE
    percent: int = 0
    text: str = ""


# ------------------------------------------------------------------------- all inputs


class Inputs(msgspec.Struct, frozen=True):
    """Everything that one tick computes from."""

    tick: Tick
    headings: tuple[HeadingSample, ...] = ()
    positions: tuple[PositionSample, ...] = ()
    rudder: tuple[RudderFeedback, ...] = ()
    devices: tuple[DeviceHealth, ...] = ()
    requests: tuple[Request, ...] = ()
    power: tuple[PowerSample, ...] = ()
    vessels: tuple[VesselReport, ...] = ()


# --------------------------------------------------------------------------- outputs


class RudderCommand(msgspec.Struct, frozen=True):
    """What the servo is told: the angle of its shaft, and whether it may pull."""

    shaft_rad: float
    torque_on: bool


class RudderStatus(msgspec.Struct, frozen=True):
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


class Stored(msgspec.Struct, frozen=True):
    """The newest whole version of a name on disk, None when there is none, and what is wrong there, else empty."""

    content: bytes | None = None
    damage: str = ""


class Progress(msgspec.Struct, frozen=True):
    """Work done so far by a part that runs beside the tick; `has_work`: it has something to do.

    It is stuck when it has work and `done` has not changed for `patience_s`. `thread` is its kernel thread id.
    """

    name: str
    has_work: bool
    done: int
    patience_s: float = 15.0
    alive: bool = True
    thread: int | None = None


class Event(msgspec.Struct, frozen=True):
    """A message to the operator."""

    severity: Severity
    text: str
