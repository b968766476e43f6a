"""What a drill does to the boat: how each thing is broken and mended, and the plans that she has aboard."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from hil.lab.drill.boat import DrillBoat

FENCE_M = 50.0
LOG_SPEED = 20.0  # times real time

Change = Callable[[DrillBoat], object]


def nothing(_boat: DrillBoat) -> None:
    """Neither break nor mend: it comes, or goes, by itself."""


def put(path: str, value: object) -> Change:
    """Set an attribute of the boat, or of something aboard."""
    *owners, name = path.split(".")

    def change(boat: DrillBoat) -> None:
        owner: object = boat
        for one in owners:
            owner = getattr(owner, one)
        setattr(owner, name, value)

    return change


def knocked(turned_rad: float, seconds: float) -> Change:
    """Turn her as a breaking sea does."""

    def change(boat: DrillBoat) -> None:
        steps = round(50.0 * seconds)
        for _ in range(steps):
            boat.world.knock(turned_rad / steps)
            boat.run(seconds / steps)

    return change


def compass_and_receiver(silent: bool) -> Change:  # noqa: FBT001 - one switch
    """Take away every heading that there is."""

    def change(boat: DrillBoat) -> None:
        boat.compass.silent = silent
        boat.receiver.fix = not silent

    return change


def logs_gone(boat: DrillBoat) -> None:
    """Put a file where the logs belong; what writes them looks at the disk once in a second that is a real one."""
    boat.pacer.keep(LOG_SPEED)
    shutil.rmtree(boat.state / "logs", ignore_errors=True)
    (boat.state / "logs").write_text("in the way")


def killed(boat: DrillBoat) -> None:
    """End the autopilot as a power cut does, and start it again."""
    boat.kill()
    boat.start()


def ended(boat: DrillBoat) -> None:
    """Have the autopilot end in good order, and start it again."""
    boat.end()
    boat.start()


def together(*changes: Change) -> Change:
    """Do several things at once."""

    def change(boat: DrillBoat) -> None:
        for one in changes:
            one(boat)

    return change


def one_after_the_other(seconds: float, *changes: Change) -> Change:
    """Do several things, so many seconds apart."""

    def change(boat: DrillBoat) -> None:
        for place, one in enumerate(changes):
            boat.run(seconds if place else 0.0)
            one(boat)

    return change


def waiting(directory: Path) -> Path:
    """Write a mission that waits at the start for ever."""
    path = directory / "wait.waypoints"
    path.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n1\t0\t3\t17\t0\t0\t0\t0\t36\t121\t0\t1\n")
    return path


def mission_clear_all() -> Any:
    """Return the message that clears a mission."""
    return dialect.MAVLink_mission_clear_all_message(1, 1, 0)


def legs(directory: Path) -> Path:
    """Write a mission to the north, soon at its end, and then far to the east."""
    path = directory / "legs.waypoints"
    path.write_text(
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t36\t121\t0\t1\n"
        "1\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121\t0\t1\n2\t0\t3\t16\t0\t0\t0\t0\t36.0005\t121.01\t0\t1\n"
    )
    return path


def fenced(directory: Path) -> Path:
    """Write a plan with a round fence about the start."""
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
    """Have the compass lose and flip a share of its bytes."""
    boat.compass.drop = boat.compass.flip = share
