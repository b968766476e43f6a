"""How the links fare, for those who look on: frozen records."""

from __future__ import annotations

from firmware_py.common.record_class import dataclass


@dataclass(frozen=True, slots=True)
class PeerStatus:
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


@dataclass(frozen=True, slots=True)
class SatelliteStatus:
    """A link by messages: the modem, its sessions since the start, and the credits spent of those there are.

    `signal` is 0 to 5, `waiting` and `dropped` count what is to be sent, `session_age_s` is since the last session that
    succeeded. `refused` counts messages received by the reason why they changed nothing. A limit of 0 is none.
    """

    imei: str
    signal: int | None
    waiting: int
    dropped: int
    sessions: int
    failed: int
    last_status: int | None
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


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """A link by its URL, the class of its rates, and who is on it."""

    url: str
    rates: str
    peers: tuple[PeerStatus, ...]
    satellite: SatelliteStatus | None = None
