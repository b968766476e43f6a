"""Frozen records exchanged between the parts of the autopilot.

Conventions: SI units and radians; headings clockwise from true north unless a reference says otherwise; positive rudder
turns the boat to starboard; `t_s` is on the monotonic clock of the process; an absent value is None.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.intents import Request
from firmware_py.common.vessels import VesselReport


class NorthReference(IntEnum):
    """Reference of a compass heading."""

    TRUE = 0
    MAGNETIC = 1
    RELATIVE = 2  # none: the angle turned since an unknown direction, which drifts; used as yaw rate only


class FixType(IntEnum):
    """Quality of a position fix, numbered as MAVLink's GPS_FIX_TYPE."""

    NONE = 1
    FIX_2D = 2
    FIX_3D = 3
    DGPS = 4
    RTK_FLOAT = 5
    RTK_FIXED = 6


class DeviceRole(IntEnum):
    """Device of a health record."""

    COMPASS = 0
    POSITION = 1
    RUDDER = 2
    STORAGE = 3
    LINK = 4  # ground stations: RUNNING while one is connected
    CLOCK = 5  # the computer's clock: FAULTY after a jump against the loop's clock
    COMPASS_B = 6
    KEY = 7  # of signed frames: FAULTY if it was lost
    POWER = 8
    POWER_B = 9
    AIS = 10
    RUDDER_ANGLE = 11
    WIND = 12
    DEPTH = 13


class DeviceState(IntEnum):
    """State of a device, as known by its driver."""

    ABSENT = 0  # the port cannot be opened, or has disappeared
    STARTING = 1  # the port is open, the device has not responded yet or is being configured
    RUNNING = 2
    SILENT = 3  # the port is open, the device has stopped responding
    FAULTY = 4  # the device reports an error or cannot be used
    FULL = 5  # storage without free space
    FAILED = 6  # the driver of an installed package has raised an exception; it starts again


class Severity(IntEnum):
    """Severity of a message to the operator, numbered as MAVLink's MAV_SEVERITY."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


# --------------------------------------------------------------------------- inputs


class Tick(msgspec.Struct, frozen=True):
    """One tick of the fixed-rate loop.

    `t_s` is the deadline of the tick, or the time of the compass sample shortly before it that started the tick. All
    computations use this time. `late_s` is the delay of the actual start, `skipped` the number of deadlines missed just
    before, `rate_hz` the nominal rate.
    """

    index: int
    t_s: float
    late_s: float
    skipped: int
    rate_hz: float


class HeadingSample(msgspec.Struct, frozen=True):
    """A heading from a compass, with the time at which its last byte arrived.

    The yaw rate is positive to starboard, roll with the starboard side down, pitch with the bow up.
    """

    t_s: float
    heading_rad: float  # [0, 2 pi), relative to `reference`
    reference: NorthReference
    variation_rad: float | None = None  # east positive, as added by the device; the deviation if that is magnetic
    yaw_rate_rad_s: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None
    temperature_c: float | None = None
    source: int = 0  # 0 = compass A, 1 = compass B


class PositionSample(msgspec.Struct, frozen=True):
    """A position fix, or the report that there is none (`fix` NONE)."""

    t_s: float
    fix: FixType
    latitude_rad: float | None = None
    longitude_rad: float | None = None
    altitude_m: float | None = None  # above mean sea level
    speed_over_ground_m_s: float | None = None
    course_over_ground_rad: float | None = None
    satellites: int | None = None
    hdop: float | None = None
    utc_s: float | None = None  # seconds since 1970-01-01 UTC, if the device sends it


class RudderFeedback(msgspec.Struct, frozen=True):
    """Feedback of the rudder servo, in the frame of its shaft: the latest value of each quantity, None if unknown."""

    t_s: float
    shaft_rad: float | None = None
    temperature_c: float | None = None
    voltage_v: float | None = None
    current_a: float | None = None
    hardware_error: int = 0  # error bits of the device, 0 = none
    torque_on: bool | None = None
    restarts: int = 0  # number of detected restarts of the servo


class RudderAngleSample(msgspec.Struct, frozen=True):
    """Calibrated angle of a sensor at the rudder blade; a positive angle turns the boat to starboard."""

    t_s: float
    rudder_rad: float


class PowerSample(msgspec.Struct, frozen=True):
    """Measurements of a battery monitor or a charger, None for values that it does not measure.

    `current_a` is the net current into the battery. `charge` is the state of charge, 0 to 1. `solar_w` is the power of
    the panels (chargers only), `load_a` the current of the load output. `source` is 0 for the device of [power], 1 for
    [power_b], 2 for another MAVLink component.
    """

    t_s: float
    source: int = 0
    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    solar_w: float | None = None
    load_a: float | None = None
    temperature_c: float | None = None


class WindReference(IntEnum):
    """Reference of a wind angle, numbered as in PGN 130306 of NMEA 2000.

    The angle is that from which the wind comes, from true or magnetic north (`NORTH`, `MAGNETIC`), or from the bow: of
    the apparent wind, which contains the motion of the boat, of the wind over the ground (`BOW`), or of the wind over
    the water (`BOW_WATER`).
    """

    NORTH = 0
    MAGNETIC = 1
    APPARENT = 2
    BOW = 3
    BOW_WATER = 4


class WindSample(msgspec.Struct, frozen=True):
    """A wind measurement: speed, and angle in [0, 2 pi) from which the wind comes, clockwise from its reference."""

    t_s: float
    wind_m_s: float
    angle_rad: float
    reference: WindReference


class DepthSample(msgspec.Struct, frozen=True):
    """A water depth below the surface; `transducer_m` is the depth of the transducer below the surface."""

    t_s: float
    depth_m: float
    transducer_m: float = 0.0


class DeviceHealth(msgspec.Struct, frozen=True):
    """State of a device and its counters since the start; reported on change."""

    t_s: float
    role: DeviceRole
    state: DeviceState
    accepted: int  # good messages
    rejected: int  # checksum, range or framing errors
    text: str = ""  # one short line, or empty


class CalibrationState(IntEnum):
    """State of a calibration."""

    NONE = 0  # never started, or cancelled
    RUNNING = 1
    DONE = 2
    FAILED = 3


class Calibration(msgspec.Struct, frozen=True):
    """A calibration by the device itself; the text is its result."""

    state: CalibrationState = CalibrationState.NONE
    percent: int = 0
    text: str = ""


# ------------------------------------------------------------------------- all inputs


class Inputs(msgspec.Struct, frozen=True):
    """All inputs of a tick."""

    tick: Tick
    headings: tuple[HeadingSample, ...] = ()
    positions: tuple[PositionSample, ...] = ()
    rudder: tuple[RudderFeedback, ...] = ()
    devices: tuple[DeviceHealth, ...] = ()
    requests: tuple[Request, ...] = ()
    power: tuple[PowerSample, ...] = ()
    vessels: tuple[VesselReport, ...] = ()
    rudder_angles: tuple[RudderAngleSample, ...] = ()
    wind: tuple[WindSample, ...] = ()
    depth: tuple[DepthSample, ...] = ()


# --------------------------------------------------------------------------- outputs


class RudderCommand(msgspec.Struct, frozen=True):
    """Command to the servo: shaft angle, and whether it applies torque."""

    shaft_rad: float
    torque_on: bool


class RudderStatus(msgspec.Struct, frozen=True):
    """Rudder status of a tick, in the frame of the rudder.

    `command_rad` is the last command. `angle_rad` is the last measured angle (`measured`), otherwise the estimate of
    the slew model (`estimated`; not if the servo is released, because the angle is then unknown), before the first
    feedback the command. `is_new`: there was feedback since the last tick. `is_repeated`: the angle is that of a sensor
    (`from_sensor`) without a new sample. `feedback_s` is the time of the last feedback, None before the first.
    `torque_on`, `current_a` and `power_w` belong to that feedback, None if unknown.
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
    is_repeated: bool = False
    estimated: bool = False
    from_sensor: bool = False


class Stored(msgspec.Struct, frozen=True):
    """Content of the newest valid slot of a file, None if there is none, and its damage, empty if there is none."""

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
