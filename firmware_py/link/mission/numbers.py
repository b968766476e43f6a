"""How ground stations number the items of a plan."""

from __future__ import annotations

from firmware_py.common.plan import Plan, PlanKind
from firmware_py.link.wire.dialect import mavlink


def homes(autopilot: int, kind: PlanKind) -> int:
    """Return how many items stand before those of the plan: ArduPilot's stations expect home as item 0 of a mission."""
    return int(autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA and kind is PlanKind.MISSION)


def wire_count(plan: Plan, home_count: int) -> int:
    """Return the number of items of a plan as stations count them: an empty mission has no home either."""
    return len(plan.items) + home_count if plan.items else 0
