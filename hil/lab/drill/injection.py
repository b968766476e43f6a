"""Injection and removal of faults, and the plans of the drills."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from hil.lab.drill.boat import DrillBoat

FENCE_M = 50.0
LOG_SPEED = 20.0  # relative to real time

Change = Callable[[DrillBoat], object]


def nothing(_boat: DrillBoat) -> None:
    """Do nothing: the condition starts or ends by itself."""


def put(path: str, value: object) -> Change:
    """Set an attribute of the boat or of one of its parts."""
    *owners, name = path.split(".")

    def change(boat: DrillBoat) -> None:
        owner: object = boat
        for one in owners:
            owner = getattr(owner, one)
        setattr(owner, name, value)

    return change


def turned_by_wave(turned_rad: float, seconds: float) -> Change:
    """Turn the boat as a breaking wave does."""

    def change(boat: DrillBoat) -> None:
        steps = round(50.0 * seconds)
        for _ in range(steps):
            boat.world.add_heading(turned_rad / steps)
            boat.run(seconds / steps)

    return change


def compass_and_receiver(silent: bool) -> Change:  # noqa: FBT001 - one switch
    """Switch off all sources of heading."""

    def change(boat: DrillBoat) -> None:
        boat.compass.silent = silent
        boat.receiver.fix = not silent

    return change


def logs_gone(boat: DrillBoat) -> None:
    """Replace the log directory by a file; the log writer checks the disk once per second of real time."""
    boat.pacer.set_speed(LOG_SPEED)
    shutil.rmtree(boat.state / "logs", ignore_errors=True)
    (boat.state / "logs").write_text("in the way")


def killed(boat: DrillBoat) -> None:
    """Kill the autopilot, and start it again."""
    boat.kill()
    boat.start()


def ended(boat: DrillBoat) -> None:
    """End the autopilot with SIGTERM, and start it again."""
    boat.end()
    boat.start()


def together(*changes: Change) -> Change:
    """Combine changes."""

    def change(boat: DrillBoat) -> None:
        for one in changes:
            one(boat)

    return change


def one_after_the_other(seconds: float, *changes: Change) -> Change:
    """Combine changes with a time between them."""

    def change(boat: DrillBoat) -> None:
        for place, one in enumerate(changes):
            boat.run(seconds if place else 0.0)
            one(boat)

    return change


def waiting(directory: Path) -> Path:
    """Write a mission that loiters at the start without end."""
    path = directory / "wait.waypoints"
    path.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n1\t0\t3\t17\t0\t0\t0\t0\t36\t121\t0\t1\n")
    return path


def mission_clear_all() -> Any:
    """Return the message that clears a mission."""
    return dialect.MAVLink_mission_clear_all_message(1, 1, 0)


def legs(directory: Path) -> Path:
    """Write a mission with a short leg to the north and a long one to the east."""
    path = directory / "legs.waypoints"
    path.write_text(
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n"
        "1\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121\t0\t1\n2\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121.01\t0\t1\n"
    )
    return path


def fenced(directory: Path) -> Path:
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


def spoil(boat: DrillBoat, share: float) -> None:
    """Set the share of compass bytes that are dropped and that are flipped."""
    boat.compass.drop = boat.compass.flip = share
