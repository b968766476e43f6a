"""The STATUSTEXTs of satellite messages: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_MODEM = "check power, cable and port of the modem; the other functions are not affected"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Satellite credits used up: <number> today, <number> this month": (
        "reports wait until the next UTC day or month; commands are received while a credit is left",
        "`rambler status` shows the credits used; `SBD_DAY_CRED`, `SBD_MONTH_CRED`, `SBD_REPORT_MIN`",
    ),
    "Satellite modem not responding": ("no valid reply for a minute; the autopilot keeps trying", _MODEM),
    "Satellite modem recovered": ("the modem responds and is set up again", "nothing"),
    "Satellite message refused: <reason>": (
        "a received message was ignored; only the first for each reason is reported, `rambler status` counts all",
        "false code: another key or modem ashore; too old: `SBD_MT_DAYS`, or the boat's clock; else send it again",
    ),
    "Satellite out of reach: <reason>": (
        "no session has succeeded for half an hour; messages wait",
        "signal: check antenna, cable and view of the sky; access denied: check the account of the modem",
    ),
    "Satellite link recovered": ("a session has succeeded", "nothing"),
    "Satellite record: <note>": (
        "another version wrote the record; the named part is ignored, and older messages are refused",
        "send unacknowledged commands again",
    ),
    "Satellite record damaged, new one started: <reason>": (
        "the credit count starts at 0, and messages that were written before are refused",
        "the disk may be failing; send unacknowledged commands again",
    ),
}
