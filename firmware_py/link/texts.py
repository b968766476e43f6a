"""STATUSTEXTs of keys, links and satellite messages: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

TEXTS: Mapping[str, tuple[str, str]] = {
    "<file> is readable by other users; set a new key if they may have read it": (
        "a signing key was readable by other users of the computer",
        "set a new key with `rambler key set`, and at your stations",
    ),
    "signing.key lost: <problem>; set or remove the key over a trusted link or by `rambler key`": (
        "see the fault KEY_LOST: only trusted links are accepted",
        "set or remove the key as the text says",
    ),
    "Signing key loaded and active": ("the disk with the key was mounted after the start", "nothing"),
    "Signing key set": ("frames must be signed from now on, by the policy of each link", "store a copy of the key"),
    "Signing key removed": ("frames need no signature", "set another key unless the link is private"),
    "<what is done>, but this could not be stored": (
        "the key is lost at the next start",
        "see STORAGE_FAILING; set it again when the disk works",
    ),
    "SETUP_SIGNING refused: set the key by `rambler key set`, or over a link with ?trusted=1 in its URL": (
        "the key would be sent unencrypted, so that only trusted links accept it",
        "use `rambler key set`, or make a cable link trusted",
    ),
    "SETUP_SIGNING refused: no key, or no timestamp": ("key or timestamp is zero", "set a key of 32 bytes"),
    "Signature refused: wrong key or old timestamp": (
        "a station signs with another key, or its clock is slow",
        "check key and clock of the station; ignore it if the station is not yours",
    ),
    "<message> refused: not signed": ("the link requires signatures for this message", "set the key at the station"),
    "<message> refused: system <number> may not command here": (
        "the system is not in the allow list of the link",
        "check the system id of the station, or add it to `systems=` of the link",
    ),
    "Open link: anyone on <link> can command; set a signing key": (
        "the link is open and no key is set",
        "set a key with `rambler key set`, or restrict the link with `systems=` and `policy=`",
    ),
    "Routing overload: over <number> messages/s, some dropped": (
        "a station or companion computer sends more than the autopilot routes",
        "reduce its rates, or exclude its link with `?route=0`",
    ),
    "Duplicate system id <number> on the link: change LNK_SYSID": (
        "another vehicle on the link uses the boat's ids: both may obey a command",
        "give each vehicle its own system id, and restart it",
    ),
    "MAVLink 1 in use: fence, rally and signing need MAVLink 2": (
        "the autopilot replies in MAVLink 1, without the messages and fields of MAVLink 2",
        "set the station to MAVLink 2 if possible; the boat changes with its first frame",
    ),
    "Link blocked: <link>: <why>": (
        "the system has refused to send on the link for 10 s; reported once each time, over the other links",
        "check that network, its firewall or the adapter; `rambler status` shows whether it has recovered",
    ),
    "Station <address> refused: <link> is full": (
        "the link has the maximum number of stations",
        "close one of them",
    ),
    "Station <address> dropped from <link>: replaced by <address>": (
        "a silent or unsigned station was replaced by another one",
        "nothing, unless the dropped station is yours: connect it again",
    ),
    "<address> on <link> dropped: no valid frame": ("a connection sent no MAVLink", "nothing"),
}

_MODEM_REMEDY = "check power, cable and port of the modem; the other functions are not affected"

SATELLITE_TEXTS: Mapping[str, tuple[str, str]] = {
    "Satellite credits used up: <number> today, <number> this month": (
        "reports wait until the next UTC day or month; commands are received while a credit is left",
        "`rambler status` shows the credits used; `SBD_DAY_CRED`, `SBD_MONTH_CRED`, `SBD_REPORT_MIN`",
    ),
    "Satellite modem not responding": ("no valid reply for a minute; the autopilot keeps trying", _MODEM_REMEDY),
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
