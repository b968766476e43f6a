"""The STATUSTEXTs of start, storage and updates: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_IGNORED = "the stored record of an earlier run cannot be read; the default is used"
_CHECK = "compare parameters, plans and mode with your intention; the disk may be failing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Resumed <mode>, <age>": (
        "after a restart, mode, goal and mission continue (`BOOT_RESUME`)",
        "nothing; `paused`: the mission waits for you; `incomplete`: see the other texts",
    ),
    "Not resumed: <age> old": ("the stored task is older than `BOOT_RESUME_H`", "choose a mode and arm the boat"),
    "Not resumed: invalid record": ("the stored mode and goal cannot be read", "choose a mode and arm the boat"),
    "Started again: <reason> (<how often>)": (
        "the last run ended unexpectedly: killed, frozen, or power lost",
        "once: read `rambler status` and the black box; often: memory, power or a defect, report it with the logs",
    ),
    "On trial: <version>, start <number> of <number>": ("an update is on trial", "wait"),
    "Trial passed: <version>": ("the update is permanent", "nothing"),
    "Update rolled back: <version> failed <number> starts": (
        "the previous version is active again",
        "read in `journalctl -u rambler` why it did not start; report it",
    ),
    "Loaded from storage: <list>": ("the part of the stored data that could be read", "see the text before"),
    "stored <file> ignored: <why>": (_IGNORED, _CHECK),
    "stored <file>: <note>": (
        "it was written by another version or contains invalid values; the named part was ignored or added",
        _CHECK,
    ),
    "stored parameter ignored: <why>": ("a stored parameter cannot be read; its default is used", _CHECK),
    "stored parameter ignored, kept for another version: <why>": (
        "this version does not know the parameter or its value; the other version will use it again",
        "after an update: nothing",
    ),
    "state directory <path>: <problem>": (
        "the state directory cannot be used fully; steering continues, but nothing may be stored",
        "check permissions, space and medium of the directory; `rambler check` names the problem",
    ),
    "<what is wrong with a link>; it is tried again": (
        "its host name is unknown or its address is not available now; steering continues without it",
        "nothing if the network comes later; otherwise correct the link in the vehicle file",
    ),
    "Port <path>: changed by another program, restored<more>": (
        "another program has changed the settings of a port; they are restored within a second",
        "end that program, or exclude it from the port; `rambler check` as root names it",
    ),
    "Port <path>: also open in <program>; end that program": (
        "two programs read one port: each gets a part of the bytes",
        "end that program, or exclude it from the port, and restart",
    ),
    "waiting for <port and its problem>": (
        "a port of a device is missing at the start; it is opened as soon as it is there",
        "check plug and power of the device, and the path in the vehicle file",
    ),
    "[<section>]: package <name> <version> <problem>": (
        "the driver package of a device cannot be used; the boat runs without that device",
        "do what the text says, and restart; `rambler check` repeats it",
    ),
    "watchdog <path>: <problem>": (
        "the hardware watchdog is not available as configured; steering continues",
        "see the hardware watchdog on the page for float computers; systemd may already use it",
    ),
    "<number> starts failed: <whose> steering parameters": (
        "consecutive runs failed within 60 s of their start; control and estimation use other parameters",
        "see the next text; the log and `journalctl -u rambler` contain the errors",
    ),
    "Stored but not used: <parameters>": (
        "after failed starts, other values are used until a run has lasted 60 s",
        "correct them before the next start, or reset all parameters",
    ),
    "Import not used: <problem>": (
        "an imported state cannot be applied; the boat starts with the previous state",
        "export the state again and import that file; the set-aside file may be deleted",
    ),
    "<file> is of another version: <consequence>": (
        "the record of an earlier version is set aside for a roll-back to that version, and not used",
        "after an update: nothing; set mode and arming again as needed",
    ),
    "<file> is damaged<more>": ("a power cut during writing, or a failing disk", _CHECK),
    "<file> is missing<more>": ("one of the two slots of a file is missing", _CHECK),
    "<file> cannot be read<more>": ("permissions, or a failing disk", _CHECK),
    "<file>: the other slot is used, perhaps an older version": (
        "each file has two slots, and one is damaged by a power cut during writing",
        _CHECK,
    ),
    "State directory mounted: its content is used from the next start": (
        "the disk was mounted after the start; the boat has started with the values of the vehicle file",
        "if that matters, restart while disarmed",
    ),
}
