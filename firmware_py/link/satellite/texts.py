"""The STATUSTEXTs of satellite messages: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_MODEM = "check power, cable and port of the modem; the other functions are not affected"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Satellite credits used up: <number> today, <number> this month": (
        "reports wait until the next day or month of UTC; commands still come while a credit is left",
        "`rambler status` shows what was spent; `SBD_DAY_CRED`, `SBD_MONTH_CRED`, `SBD_REPORT_MIN`",
    ),
    "Satellite modem not responding": ("it has not answered as it should for a minute, and is tried again", _MODEM),
    "Satellite modem recovered": ("the modem responds and is set up again", "nothing"),
    "Satellite message refused: <reason>": (
        "a received message was ignored; only the first for each reason is reported, `rambler status` counts all",
        "false code: another key or modem ashore; too old: `SBD_MT_DAYS`, or the boat's clock; else send it again",
    ),
    "Satellite out of reach: <reason>": (
        "a session has been due for half an hour and none has succeeded; what is to be sent waits",
        "signal: antenna, its cable, sky above it; a status is the modem's word: access denied concerns its account",
    ),
    "Satellite link recovered": ("a session has succeeded", "nothing"),
    "Satellite record: <note>": (
        "another version wrote it; what is named was ignored, and no message counts that was written before",
        "send commands again that the boat has not acknowledged",
    ),
    "Satellite record damaged, new one started: <reason>": (
        "the credit count starts at 0, and messages that were written before are refused",
        "the disk may be failing; send unacknowledged commands again",
    ),
}
