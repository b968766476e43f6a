"""What may be asked of the autopilot, by whom, and how it is answered.

An accepted request is an input of the next tick, so that a log recomputes what came of it.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.plan import Plan


class SetMode(msgspec.Struct, frozen=True, tag=True):
    """Ask for a control mode by its custom_mode number."""

    mode: int


class Arm(msgspec.Struct, frozen=True, tag=True):
    """Ask to arm or disarm; `force` skips the pre-arm checks."""

    armed: bool
    force: bool = False


class SteerHeading(msgspec.Struct, frozen=True, tag=True):
    """Ask for a heading, clockwise from true north.

    `relative`: counted from the heading that the boat has, whatever its goal. `over_ground`: the angle is a course
    over ground. `turn` > 0 asks to turn to
    starboard, < 0 to port, 0 the shorter way. `change_mode` enters GUIDED first.
    """

    heading_rad: float
    relative: bool = False
    over_ground: bool = False
    turn: int = 0
    change_mode: bool = False


class SteerPosition(msgspec.Struct, frozen=True, tag=True):
    """Ask to go to a position; `change_mode` enters GUIDED first."""

    latitude_rad: float
    longitude_rad: float
    change_mode: bool = False


class ManualRudder(msgspec.Struct, frozen=True, tag=True):
    """The operator's stick: -1 full port, +1 full starboard, None = stick released."""

    deflection: float | None


class SetParameter(msgspec.Struct, frozen=True, tag=True):
    """Change a parameter of params.TABLE."""

    name: str
    value: float


class ReplacePlan(msgspec.Struct, frozen=True, tag=True):
    """Put a whole plan in force, in place of the one of its kind."""

    plan: Plan


class SetMissionItem(msgspec.Struct, frozen=True, tag=True):
    """Go on with another item of the mission; `restart` also forgets jumps made and a completed mission."""

    index: int
    restart: bool = False


class PauseMission(msgspec.Struct, frozen=True, tag=True):
    """Halt the mission where the boat is (a watch circle), or go on with it."""

    paused: bool


class SetHome(msgspec.Struct, frozen=True, tag=True):
    """Set home; without a position, to where the boat is."""

    latitude_rad: float | None = None
    longitude_rad: float | None = None
    altitude_m: float = 0.0


class EnableFence(msgspec.Struct, frozen=True, tag=True):
    """Heed the fence or not."""

    enabled: bool


class BenchRudder(msgspec.Struct, frozen=True, tag=True):
    """Move the rudder on the bench, while disarmed: -1 full port to +1 full starboard, for a while."""

    deflection: float
    seconds: float


class Restart(msgspec.Struct, frozen=True, tag=True):
    """Make the rudder safe and start the autopilot anew, or (`shutdown`) end it; `force` does so while armed, too."""

    shutdown: bool = False
    force: bool = False


class ReportBattery(msgspec.Struct, frozen=True, tag=True):
    """What another component of the boat has measured of the battery; a current into it is positive."""

    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    temperature_c: float | None = None


class ForgetParameters(msgspec.Struct, frozen=True, tag=True):
    """Forget, from the next start on, every parameter that was set over a link: the vehicle file's values come back."""


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
    """An intent, when it arrived and who sent it (MAVLink system and component)."""

    t_s: float
    intent: Intent
    system: int = 0
    component: int = 0


class Verdict(IntEnum):
    """The answer to a request, numbered as MAVLink's MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Answer(msgspec.Struct, frozen=True):
    """A verdict and, unless accepted, its reason in one short line."""

    verdict: Verdict
    text: str = ""
