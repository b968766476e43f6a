"""STATUSTEXTs of other vessels: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_NOTHING = "nothing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "<vessel>: closest <number> m in <number> min, bearing <number> deg": (
        "closest approach at constant velocities (`AIS_NEAR_M`, `AIS_STILL_M`); the bearing is the present one",
        "watch it; call it by radio if possible; with `AIS_ACT` 1 the boat avoids it",
    ),
    "Avoidance: heading <number> deg, closest <number> m instead of <number> m": (
        "the boat steers the heading with the largest distance to the vessel (`AIS_ACT`)",
        "nothing; a manually steered mode ends it",
    ),
    "Avoidance: no better heading, course kept": (
        "within `AIS_SECTOR_DEG` and inside the fence, no heading increases the distance to the vessel",
        "check whether another course is free",
    ),
    "Avoidance ended: back on course": ("the vessel has passed, or is far enough away", _NOTHING),
    "Distress beacon <number>: <number> m, bearing <number> deg": (
        "a man overboard device, an AIS-SART, an EPIRB or a vessel with status 14 sends; repeated every ten minutes",
        "report position and number to the rescue coordination centre; the boat does not avoid it as a vessel",
    ),
    "Distress beacon <number>: at <latitude>, <longitude>": (
        "a distress beacon, while the position of the boat is unknown",
        "report position and number to the rescue coordination centre",
    ),
    "Distress beacon <number>: no position yet": (
        "the beacon is switched on and has no fix; its position follows within minutes",
        "report the number to the rescue coordination centre",
    ),
    "<vessel>: own echo, ignored": (
        "the receiver receives the transponder of the boat itself (VDM)",
        "nothing; `own_mmsi` in the vehicle file excludes it at once",
    ),
    "AIS: <problem>": (
        "receiver missing, messages refused, or too many messages; reported once in ten minutes",
        "if it continues: check cable and baud rate; `rambler status` counts the messages",
    ),
}
