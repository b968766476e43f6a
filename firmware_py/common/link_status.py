"""How the links fare, for those who look on: frozen records."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

# How a session by satellite has ended without success. Source: ISU AT Command Reference, MO session status of +SBDIX.
_SESSION_ENDINGS: Mapping[int, str] = {
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


def session_ending(status: int | None) -> str:
    """Return what the status of a session that failed means, with its number; None when the modem did not say."""
    if status is None:
        return "modem fell silent"
    return f"status {status}, {_SESSION_ENDINGS.get(status, 'not known')}"


class PeerStatus(msgspec.Struct, frozen=True):
    """A correspondent of a link; `heard_age_s` since its last valid frame, None before the first.

    `dropped` counts messages that its line or its credit had no room for, `rejected` broken frames from it.
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
    """A link by messages: the modem, its sessions since the start, and the credits spent of those there are.

    `signal` is 0 to 5, `waiting` and `dropped` count what is to be sent, `session_age_s` is since the last session that
    succeeded, `hindrance` what keeps her from one that is due, empty for nothing. `refused` counts messages received by
    the reason why they changed nothing. A limit of 0 is none.
    """

    imei: str
    signal: int | None
    waiting: int
    dropped: int
    sessions: int
    failed: int
    last_status: int | None
    hindrance: str
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
    """A link by its URL, the class of its rates, and who is on it; `hindrance`: why nothing leaves, else empty."""

    url: str
    rates: str
    peers: tuple[PeerStatus, ...]
    satellite: SatelliteStatus | None = None
    hindrance: str = ""
