"""Table of modes, read by state machine, guidance, failsafes, parameters and link.

The state machine is modes.py; the tasks of the modes are in guidance/guidance.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag

import msgspec


class Mode(IntEnum):
    """Control modes with ArduRover's custom_mode numbers."""

    MANUAL = 0
    STEERING = 3
    HOLD = 4
    LOITER = 5
    AUTO = 10
    RTL = 11
    GUIDED = 15


class Need(IntEnum):
    """Requirement for entering a mode."""

    HEADING = 0
    POSITION = 1
    MISSION = 2
    HOME = 3


class RudderBy(IntEnum):
    """Source of rudder commands while armed."""

    NOTHING = 0  # rudder amidships
    STICK = 1
    HEADING = 2  # heading controller


class BaseMode(IntFlag):
    """Mode bits of MAVLink's base_mode."""

    NONE = 0
    AUTO = 4
    GUIDED = 8
    STABILIZE = 16
    MANUAL_INPUT = 64


class StandardMode(IntEnum):
    """Supported modes of MAV_STANDARD_MODE; most others are for aircraft only."""

    NONE = 0
    SAFE_RECOVERY = 5
    MISSION = 6


class ModeProperties(msgspec.Struct, frozen=True, kw_only=True):
    """One mode.

    `title` is its name in ground stations. `heading_goals` and `position_goals`: the goals that it accepts.
    `follows_task`: guidance follows a task; without a position the last heading is kept. `failsafe` is its value in the
    parameters FS_..._ACT (0: not available), `failsafe_effect` its description there, and `fallback` the mode that a
    failsafe enters if this one is impossible.
    """

    title: str
    needs: tuple[Need, ...] = ()
    rudder_by: RudderBy = RudderBy.HEADING
    heading_goals: bool = False
    position_goals: bool = False
    follows_task: bool = False
    base_mode: BaseMode = BaseMode.GUIDED | BaseMode.STABILIZE
    standard: StandardMode = StandardMode.NONE
    failsafe: int = 0
    failsafe_effect: str = ""
    fallback: Mode | None = None


MODES: Mapping[Mode, ModeProperties] = {
    Mode.MANUAL: ModeProperties(
        title="MANUAL",
        rudder_by=RudderBy.STICK,
        base_mode=BaseMode.MANUAL_INPUT,
    ),
    Mode.STEERING: ModeProperties(
        title="STEERING (heading hold)",
        needs=(Need.HEADING,),
        heading_goals=True,
        base_mode=BaseMode.MANUAL_INPUT | BaseMode.STABILIZE,
        failsafe=2,
        failsafe_effect="keep the heading",
        fallback=Mode.HOLD,
    ),
    Mode.HOLD: ModeProperties(
        title="HOLD (rudder amidships, no stop)",
        rudder_by=RudderBy.NOTHING,
        base_mode=BaseMode.NONE,
        failsafe=1,
        failsafe_effect="rudder amidships",
    ),
    Mode.LOITER: ModeProperties(
        title="LOITER (station keeping)",
        needs=(Need.HEADING, Need.POSITION),
        follows_task=True,
        failsafe=3,
        fallback=Mode.STEERING,
    ),
    Mode.AUTO: ModeProperties(
        title="AUTO (mission)",
        needs=(Need.HEADING, Need.POSITION, Need.MISSION),
        follows_task=True,
        base_mode=BaseMode.GUIDED | BaseMode.STABILIZE | BaseMode.AUTO,
        standard=StandardMode.MISSION,
    ),
    Mode.RTL: ModeProperties(
        title="RTL (home or rally point)",
        needs=(Need.HEADING, Need.POSITION, Need.HOME),
        follows_task=True,
        base_mode=BaseMode.GUIDED | BaseMode.STABILIZE | BaseMode.AUTO,
        standard=StandardMode.SAFE_RECOVERY,
        failsafe=4,
        fallback=Mode.LOITER,
    ),
    Mode.GUIDED: ModeProperties(
        title="GUIDED",
        needs=(Need.HEADING,),
        heading_goals=True,
        position_goals=True,
        follows_task=True,
    ),
}

# Modes of failsafes by their value in FS_..._ACT.
FAILSAFE_MODES: Mapping[int, Mode] = {
    row.failsafe: mode for mode, row in sorted(MODES.items(), key=lambda item: item[1].failsafe) if row.failsafe
}


def failsafe_ladder(mode: Mode) -> tuple[Mode, ...]:
    """Return the modes that a failsafe tries in order, beginning with `mode`."""
    fallback = MODES[mode].fallback
    return (mode,) if fallback is None else (mode, *failsafe_ladder(fallback))
