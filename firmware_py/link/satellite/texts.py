"""The STATUSTEXTs of satellite messages: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_MODEM = "power, cable and port of the modem; the rest of her is not concerned"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Satellite credits used up: <number> today, <number> this month": (
        "reports wait until the next day or month of UTC; commands still come while a credit is left",
        "`rambler status` shows what was spent; `SBD_DAY_CRED`, `SBD_MONTH_CRED`, `SBD_REPORT_MIN`",
    ),
    "Satellite modem does not answer": ("it has not answered as it should for a minute, and is tried again", _MODEM),
    "Satellite modem answers again": ("it has been set up anew", "nothing"),
    "Satellite message refused: <reason>": (
        "a message to her has changed nothing; only the first for a reason is told, `rambler status` counts all",
        "false code: another key or modem ashore; too old: `SBD_MT_DAYS`, or her clock; else send it again",
    ),
    "Satellite out of reach: <reason>": (
        "a session has been due for half an hour and none has succeeded; what is to be sent waits",
        "signal: antenna, its cable, sky above it; a status is the modem's word: access denied concerns its account",
    ),
    "Satellite is reached again": ("a session has succeeded", "nothing"),
    "Satellite record: <note>": (
        "another version wrote it; what is named was ignored, and no message counts that was written before",
        "send commands again that the boat has not acknowledged",
    ),
    "Satellite record begun anew: <reason>": (
        "what was spent is forgotten, and no message to her counts that was written before now",
        "the disk may be failing; send commands again that she has not acknowledged",
    ),
}
