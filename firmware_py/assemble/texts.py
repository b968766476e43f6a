"""The STATUSTEXTs of start, storage and updates: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

_LEFT_OUT = "what a run before has kept of this cannot be read; the default is used"
_LOOK = "compare parameters, plans and mode with what you want; the disk may be failing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Resumed <mode>, <age>": (
        "after a restart she goes on with mode, goal and mission as they were (`BOOT_RESUME`)",
        "nothing; `paused`: the mission waits for you; `incomplete`: see what else was told",
    ),
    "Not resumed: <age> old": (
        "what she did before the restart is older than `BOOT_RESUME_H`, so she waits for orders",
        "choose a mode, arm her",
    ),
    "Not resumed: the record is no good": ("mode and goal of before could not be read", "choose a mode, arm her"),
    "Started again: <reason> (<how often>)": (
        "the run before has ended without being told to: killed, frozen, cut off from power",
        "once: read `rambler status` and the black box; often: memory, power or a defect, report it with the logs",
    ),
    "On trial: <version>, start <number> of <number>": ("an update is being tried; it stays or is taken back", "wait"),
    "Trial passed: <version>": ("the update stays", "nothing"),
    "Update taken back: <version> has not passed in <number> starts": (
        "the version before steers again",
        "read `journalctl -u rambler` for why it did not start; report it",
    ),
    "Used of what is stored: <list>": ("beside what could not be had, this was", "see the text before"),
    "stored <file> left out: <why>": (_LEFT_OUT, _LOOK),
    "stored <file>: <note>": (
        "it was written by another version or cannot be; what is named was left out or added",
        _LOOK,
    ),
    "stored parameter left out: <why>": ("a parameter cannot be read; its default is in force", _LOOK),
    "stored parameter left out, and kept for another version: <why>": (
        "this version does not know it, or not that value; going back to the other one brings it back",
        "nothing, after an update",
    ),
    "state directory <path>: <problem>": (
        "it cannot be used as it should; she sails on, and may keep nothing",
        "rights, room and medium of the directory; `rambler check` names what is wrong",
    ),
    "<what is wrong with a link>; it is tried again": (
        "its name is not known, or its address not this computer's, now; she sails on without it",
        "nothing, where the network comes later; else correct the link in the vehicle file",
    ),
    "Port <path>: changed by another program, restored<more>": (
        "another program has opened a device's port and changed its settings; they are as before within a second",
        "end that program, or keep it from the port; `rambler check` as root names it",
    ),
    "Port <path>: also open in <program>; end that": (
        "two programs read one port: each gets a part of the bytes",
        "end that program, or keep it from the port, and start again",
    ),
    "watchdog <path>: <problem>": (
        "the hardware watchdog is not as asked for; she sails on",
        "see the page on the float, hardware watchdog; systemd may hold it already",
    ),
    "<number> starts failed: <whose> steering parameters": (
        "runs in a row failed within 60 s of their start; control and estimation start with other parameters",
        "see the next text; the log and `journalctl -u rambler` hold the errors",
    ),
    "Kept, and not used: <parameters>": (
        "these values are stored; after starts that failed others are in force, until a run has gone on for 60 s",
        "set them right before the next start, or reset all parameters",
    ),
    "Import not used: <problem>": (
        "an imported state cannot be applied: nothing of it counts, and the boat starts with what it had",
        "export the state again and import that file; what was set aside beside it may be deleted",
    ),
    "<file> is of another version: <consequence>": (
        "an earlier program version kept this record; it is set aside for a roll-back to that version, and not used",
        "nothing after an update; set the mode and arm again as you need",
    ),
    "<file> is damaged<more>": (
        "what was kept cannot be read whole: a power cut while it was written, or a failing disk",
        _LOOK,
    ),
    "<file> is missing<more>": ("one of the two copies of a file is gone", _LOOK),
    "<file> cannot be read<more>": ("rights, or a failing disk", _LOOK),
    "<file>: the other slot is used, perhaps an older version": (
        "each file is kept twice, and one copy is damaged: a power cut while it was written",
        _LOOK,
    ),
    "State directory is there now; what it holds counts from the next start": (
        "the disk has come after the start; she began with the vehicle file's values",
        "restart her while disarmed, when that matters",
    ),
}
