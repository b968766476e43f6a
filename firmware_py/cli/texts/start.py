"""Texts of the start, of what is kept on disk, of updates, keys and who may command."""

from __future__ import annotations

from collections.abc import Mapping

_LEFT_OUT = "what a run before has kept of this cannot be read; the default is used"
_LOOK = "compare parameters, plans and mode with what you want; the disk may be failing"

TEXTS: Mapping[str, tuple[str, str]] = {
    "Resumed <mode>, <age>": (
        "after a restart she goes on with mode, goal and mission as they were (`BOOT_RESUME`)",
        "nothing; `paused`: the mission waits for you; `not whole`: see what else was told",
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
    "<file> can be read by others; set another key if somebody may have": (
        "a signing key was readable by other users of the computer",
        "`rambler key set`, and the same key at your stations",
    ),
    "signing.key lost: <problem>; set or remove the key over a trusted link, or by `rambler key`": (
        "see the fault KEY_LOST: nobody is heard but over trusted links",
        "as it says",
    ),
    "Signing key is there now, and in force": ("the disk with the key has come after the start", "nothing"),
    "Signing key set": ("from now on frames must be signed, as each link's policy says", "keep the key in two places"),
    "Signing key removed": ("frames need no signature any more", "set another one, unless the link is private"),
    "<what is done>, but this could not be stored": (
        "the key counts until the next start, and not after",
        "see STORAGE_FAILING; set it again when the disk works",
    ),
    "SETUP_SIGNING refused: set the key by `rambler key set`, or over a link with ?trusted=1 in its URL": (
        "a key is set over links with `trusted` alone, since it is sent in the clear",
        "as it says; a cable's link may be trusted",
    ),
    "SETUP_SIGNING refused: no key, or no timestamp": ("all zeros, of one of them", "set a key of 32 bytes"),
    "Signature refused: wrong key or old timestamp": (
        "somebody signs with another key, or with a clock that is behind",
        "the station's key and clock; if it is nobody of yours, leave it",
    ),
    "<message> refused: it is not signed": ("the link wants signatures for this", "give the station the key"),
    "<message> refused: system <number> may not command here": (
        "the link's allow-list does not name that system",
        "the station's system number, or `systems=` of the link",
    ),
    "Whoever reaches <link> commands her: it wants a signing key": (
        "the link is open and no key is set",
        "`rambler key set`, or `systems=` and `policy=` of the link: see who may command",
    ),
    "More than <number> messages a second to pass on between links: some are lost": (
        "a station or a companion computer says more than the boat routes",
        "ask it for less, or keep its link out of it with `?route=0`",
    ),
    "Another vehicle is system <number>, too: give one of them another LNK_SYSID": (
        "frames of another vehicle with her ids are heard: what a station on that link orders, both may do",
        "give each vehicle a system id of its own, and start it anew",
    ),
    "You speak MAVLink 1: fence, rally points and signing need MAVLink 2": (
        "the station goes on in MAVLink 1 and is answered in it, without the messages and fields that it does not have",
        "set the station to MAVLink 2 if it knows it; she follows with its first frame",
    ),
    "Nothing leaves by <link>: <why>": (
        "the system has refused what goes out there for ten seconds; told once each time, to those on other links",
        "see to that network, its firewall or the adapter; `rambler status` says when it is over",
    ),
    "No place for <address> on <link>": ("as many stations as are served are there already", "close one of them"),
    "Place of <address> on <link> given to <address>": (
        "one that was silent or not signed made room for a better one",
        "nothing, unless the one named is yours",
    ),
    "<address> on <link> dropped: no valid frame": ("somebody connected and spoke no MAVLink", "nothing"),
}
