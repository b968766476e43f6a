"""The STATUSTEXTs of other vessels: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_NOTHING = "nothing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "<vessel> comes to <number> m in <number> min, from <number> deg": (
        "so near it comes if both go on as they do (`AIS_NEAR_M`, `AIS_STILL_M`); the bearing is of where it is now",
        "watch it; call it, if somebody can; `AIS_ACT` 1 has her step aside",
    ),
    "Steps aside to <number> deg: <number> m become <number> m": (
        "she steers the heading that opens the distance most (`AIS_ACT`)",
        "nothing; a mode in which you steer yourself ends it",
    ),
    "Cannot step aside: no heading is better": (
        "within `AIS_SECTOR_DEG`, and inside the fence, every other heading brings the vessel as near",
        "look whether another way is open: she goes on as she did",
    ),
    "Goes her own way again": ("the vessel is past, or wide enough away", _NOTHING),
    "Distress beacon <number>: <number> m, bearing <number> deg": (
        "a man overboard device, an AIS-SART or an EPIRB calls, or a vessel of status 14; repeated every ten minutes",
        "report position and number to the rescue coordination centre; the boat does not avoid it as a vessel",
    ),
    "Distress beacon <number>: at <latitude>, <longitude>": (
        "the same, while the boat does not know its own position",
        "report position and number to the rescue coordination centre",
    ),
    "Distress beacon <number>: no position yet": (
        "the beacon has switched on and has no fix; its position follows within minutes",
        "report the number to the rescue coordination centre",
    ),
    "<vessel> is always where the boat is: its own echo": (
        "the boat's own transponder heard by a receiver (VDM); it is no vessel to avoid",
        "nothing; `own_mmsi` in the vehicle file keeps it out at once",
    ),
    "AIS: <what is wrong>": (
        "it is away, or messages are refused, or more came than she reads; told once in ten minutes",
        "if it goes on: cable and baud rate; `rambler status` counts. Who sends her own number errs, or deceives",
    ),
}
