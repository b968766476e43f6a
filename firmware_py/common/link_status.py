"""Status of the links for telemetry and status reports: frozen records."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

# Reasons why satellite sessions failed. Source: ISU AT Command Reference, MO session status of +SBDIX.
_SESSION_ERRORS: Mapping[int, str] = {
    10: "no end in time",
    11: "gateway's queue full",
    12: "too many segments",
    13: "no end",
    14: "false segment size",
    15: "access denied",
    16: "modem locked",
    17: "gateway silent",
    18: "connection lost",
    19: "link failed",
    32: "no service",
    33: "antenna fault",
    34: "radio disabled",
    35: "modem busy",
    36: "wait 3 min",
    37: "service disabled",
    38: "traffic held up",
}


def session_error_text(status: int | None) -> str:
    """Return the reason of a failed session with its status number; `status` is None without a reply of the modem."""
    if status is None:
        return "modem fell silent"
    return f"status {status}, {_SESSION_ERRORS.get(status, 'not known')}"


class PeerStatus(msgspec.Struct, frozen=True):
    """A peer of a link; `heard_age_s` is the time since its last valid frame, None before the first.

    `has_place`: it is an active peer, one of the limited number that the link sends to. `signs`: its frames have valid
    signatures. `dropped` counts messages that exceeded a queue or the credit of an unverified peer, `rejected` damaged
    frames.
    """

    address: str
    ground_station: bool
    has_place: bool
    signs: bool
    heard_age_s: float | None
    sent_bytes: int
    dropped: int
    rejected: int


class SatelliteStatus(msgspec.Struct, frozen=True):
    """A satellite link: the modem, its sessions since the start, and the credits used.

    `signal` is 0 to 5. `waiting` and `dropped` count outgoing messages. `session_age_s` is the time since the last
    successful session, `last_status` the MO session status of the last one. `blocked_reason` is the reason why a due
    session does not start, empty if nothing prevents it. `refused` counts received messages that had no effect, by
    reason. A limit of 0 means no limit.
    """

    imei: str
    signal: int | None
    waiting: int
    dropped: int
    sessions: int
    failed: int
    last_status: int | None
    blocked_reason: str
    session_age_s: float | None
    sent: int
    sent_bytes: int
    received: int
    refused: dict[str, int]
    day_credits: int
    day_limit: int
    month_credits: int
    month_limit: int
    total_credits: int


class LinkStatus(msgspec.Struct, frozen=True):
    """A link: its URL, its rate class and its peers; `blocked_reason`: why nothing is sent, empty if it works."""

    url: str
    rates: str
    peers: tuple[PeerStatus, ...]
    satellite: SatelliteStatus | None = None
    blocked_reason: str = ""
