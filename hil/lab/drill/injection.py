"""Injection and removal of faults, and the plans of the drills."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from hil.lab.drill.boat import DrillBoat

FENCE_M = 50.0
LOG_SPEED = 20.0  # simulation speed relative to real time

Change = Callable[[DrillBoat], object]


def do_nothing(_boat: DrillBoat) -> None:
    """Do nothing, for a condition that starts or ends by itself."""


def assign(path: str, value: object) -> Change:
    """Return a change that sets an attribute of the boat or of one of its parts, given as a dotted path."""
    *owners, name = path.split(".")

    def change(boat: DrillBoat) -> None:
        owner: object = boat
        for part in owners:
            owner = getattr(owner, part)
        setattr(owner, name, value)

    return change


def turn_by_wave(angle_rad: float, seconds: float) -> Change:
    """Return a change that turns the boat as a breaking wave does."""

    def change(boat: DrillBoat) -> None:
        steps = round(50.0 * seconds)
        for _ in range(steps):
            boat.world.add_heading(angle_rad / steps)
            boat.run(seconds / steps)

    return change


def silence_heading_sources(silent: bool) -> Change:  # noqa: FBT001 - a switch
    """Return a change that switches all sources of heading off or on."""

    def change(boat: DrillBoat) -> None:
        boat.compass.silent = silent
        boat.receiver.fix = not silent

    return change


def remove_logs(boat: DrillBoat) -> None:
    """Replace the log directory by a file; the log writer checks the disk once per second of real time."""
    boat.pacer.set_speed(LOG_SPEED)
    shutil.rmtree(boat.state / "logs", ignore_errors=True)
    (boat.state / "logs").write_text("in the way")


def kill_and_start(boat: DrillBoat) -> None:
    """Kill the autopilot, and start it again."""
    boat.kill()
    boat.start()


def end_and_start(boat: DrillBoat) -> None:
    """End the autopilot with SIGTERM, and start it again."""
    boat.end()
    boat.start()


def combined(*changes: Change) -> Change:
    """Return a change that applies all changes at once."""

    def change(boat: DrillBoat) -> None:
        for single_change in changes:
            single_change(boat)

    return change


def in_sequence(seconds: float, *changes: Change) -> Change:
    """Return a change that applies the changes with a time between them."""

    def change(boat: DrillBoat) -> None:
        for index, single_change in enumerate(changes):
            boat.run(seconds if index else 0.0)
            single_change(boat)

    return change


def write_loiter_plan(directory: Path) -> Path:
    """Write a mission that loiters at the start without end."""
    path = directory / "wait.waypoints"
    # The fourth column is the command: 16 is NAV_WAYPOINT (item 0: home), 17 NAV_LOITER_UNLIM.
    path.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n1\t0\t3\t17\t0\t0\t0\t0\t36\t121\t0\t1\n")
    return path


def mission_clear_all() -> Any:
    """Return the message that clears a mission."""
    return dialect.MAVLink_mission_clear_all_message(1, 1, dialect.MAV_MISSION_TYPE_MISSION)


def write_legs_plan(directory: Path) -> Path:
    """Write a mission with a short leg to the north and a long one to the east."""
    path = directory / "legs.waypoints"
    # Command 16 is NAV_WAYPOINT; item 0 is home.
    path.write_text(
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n"
        "1\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121\t0\t1\n2\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121.01\t0\t1\n"
    )
    return path


def write_fence_plan(directory: Path) -> Path:
    """Write a plan with a circular fence around the start."""
    path = directory / "fence.plan"
    path.write_text(
        '{"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": {"version": 2, "items": [],'
        ' "firmwareType": 3, "vehicleType": 10, "cruiseSpeed": 1, "hoverSpeed": 1,'
        ' "plannedHomePosition": [36, 121, 0]},'
        f' "geoFence": {{"version": 2, "polygons": [], "circles": [{{"version": 1, "inclusion": true, "circle":'
        f' {{"center": [36.0, 121.0], "radius": {FENCE_M}}}}}]}}, "rallyPoints": {{"version": 2, "points": []}}}}'
    )
    return path


def damage_bytes(boat: DrillBoat, fraction: float) -> None:
    """Set the fractions of compass bytes that are dropped and that are damaged."""
    boat.compass.drop = boat.compass.flip = fraction
