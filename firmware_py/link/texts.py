"""The STATUSTEXTs of keys and links: meaning and remedy, for params/TEXTS.md."""

from __future__ import annotations

from collections.abc import Mapping

TEXTS: Mapping[str, tuple[str, str]] = {
    "<file> is readable by other users; set a new key if they may have read it": (
        "a signing key was readable by other users of the computer",
        "`rambler key set`, and the same key at your stations",
    ),
    "signing.key lost: <problem>; set or remove the key over a trusted link or by `rambler key`": (
        "see the fault KEY_LOST: only trusted links are accepted",
        "as it says",
    ),
    "Signing key loaded and active": ("the disk with the key has come after the start", "nothing"),
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
        "a station signs with another key, or its clock is slow",
        "check key and clock of the station; ignore it if the station is not yours",
    ),
    "<message> refused: not signed": ("the link wants signatures for this", "give the station the key"),
    "<message> refused: system <number> may not command here": (
        "the link's allow-list does not name that system",
        "the station's system number, or `systems=` of the link",
    ),
    "Open link: anyone on <link> can command; set a signing key": (
        "the link is open and no key is set",
        "`rambler key set`, or `systems=` and `policy=` of the link: see who may command",
    ),
    "Routing overload: over <number> messages/s, some dropped": (
        "a station or a companion computer says more than the boat routes",
        "ask it for less, or keep its link out of it with `?route=0`",
    ),
    "Duplicate system id <number> on the link: change LNK_SYSID": (
        "another vehicle on the link uses the boat's ids: both may obey a command",
        "give each vehicle its own system id, and restart it",
    ),
    "MAVLink 1 in use: fence, rally and signing need MAVLink 2": (
        "the station goes on in MAVLink 1 and is answered in it, without the messages and fields that it does not have",
        "set the station to MAVLink 2 if possible; the boat changes with its first frame",
    ),
    "Link blocked: <link>: <why>": (
        "the system has refused to send on the link for 10 s; reported once each time, over the other links",
        "see to that network, its firewall or the adapter; `rambler status` says when it is over",
    ),
    "Station <address> refused: <link> is full": (
        "as many stations as are served are there already",
        "close one of them",
    ),
    "Station <address> dropped from <link>: replaced by <address>": (
        "one that was silent or not signed made room for a better one",
        "nothing, unless the one named is yours",
    ),
    "<address> on <link> dropped: no valid frame": ("a connection sent no MAVLink", "nothing"),
}
