"""Requests to the autopilot, and its answers.

An accepted request is an input of the next tick, so that the replay of a log reproduces its effect.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.plan import Plan


class SetMode(msgspec.Struct, frozen=True, tag=True):
    """Set a control mode by its custom_mode number."""

    mode: int


class Arm(msgspec.Struct, frozen=True, tag=True):
    """Arm or disarm; `force` skips the pre-arm checks."""

    armed: bool
    force: bool = False


class SteerHeading(msgspec.Struct, frozen=True, tag=True):
    """Steer a heading, clockwise from true north.

    `relative`: relative to the present heading. `over_ground`: the angle is a course over ground. `turn` > 0 turns to
    starboard, < 0 to port, 0 the shorter way. `change_mode` enters GUIDED first.
    """

    heading_rad: float
    relative: bool = False
    over_ground: bool = False
    turn: int = 0
    change_mode: bool = False


class SteerPosition(msgspec.Struct, frozen=True, tag=True):
    """Go to a position; `change_mode` enters GUIDED first."""

    latitude_rad: float
    longitude_rad: float
    change_mode: bool = False


class ManualRudder(msgspec.Struct, frozen=True, tag=True):
    """The operator's stick: -1 full port, +1 full starboard, None = stick released."""

    deflection: float | None


class SetParameter(msgspec.Struct, frozen=True, tag=True):
    """Change a parameter of parameter_table.TABLE."""

    name: str
    value: float


class ReplacePlan(msgspec.Struct, frozen=True, tag=True):
    """Replace the plan of a kind."""

    plan: Plan


class SetMissionItem(msgspec.Struct, frozen=True, tag=True):
    """Continue with item `index` of the mission, counted from 0; `restart` also resets the jump counts."""

    index: int
    restart: bool = False


class PauseMission(msgspec.Struct, frozen=True, tag=True):
    """Pause the mission at the present position (loiter circle), or resume it."""

    paused: bool


class SetHome(msgspec.Struct, frozen=True, tag=True):
    """Set home; without a position, to the present one."""

    latitude_rad: float | None = None
    longitude_rad: float | None = None
    altitude_m: float = 0.0  # above mean sea level


class EnableFence(msgspec.Struct, frozen=True, tag=True):
    """Enable or disable the fence."""

    enabled: bool


class BenchRudder(msgspec.Struct, frozen=True, tag=True):
    """Move the rudder on the bench, while disarmed: -1 full port to +1 full starboard, for `seconds`."""

    deflection: float
    seconds: float


class Restart(msgspec.Struct, frozen=True, tag=True):
    """Centre the rudder and restart the autopilot, or end it (`shutdown`); `force`: also while armed."""

    shutdown: bool = False
    force: bool = False


class ReportBattery(msgspec.Struct, frozen=True, tag=True):
    """Battery measurements of another component of the boat.

    Positive currents charge the battery; `charge` is the state of charge, 0 to 1.
    """

    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    temperature_c: float | None = None


class ForgetParameters(msgspec.Struct, frozen=True, tag=True):
    """Delete all parameters set over a link; the values of the vehicle file apply from the next start."""


Intent = (
    SetMode
    | Arm
    | SteerHeading
    | SteerPosition
    | ManualRudder
    | SetParameter
    | ReplacePlan
    | SetMissionItem
    | PauseMission
    | SetHome
    | EnableFence
    | BenchRudder
    | Restart
    | ReportBattery
    | ForgetParameters
)


class Request(msgspec.Struct, frozen=True):
    """An intent with arrival time and sender (MAVLink system and component)."""

    t_s: float
    intent: Intent
    system: int = 0
    component: int = 0


class Verdict(IntEnum):
    """Result of a request, numbered as MAVLink's MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Answer(msgspec.Struct, frozen=True):
    """A verdict with its reason in one short line, empty if accepted."""

    verdict: Verdict
    text: str = ""
