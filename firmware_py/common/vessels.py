"""What is known of other vessels: the records that AIS gives, and what the table makes of them.

Conventions as in records.py. Everything here was sent by somebody else: it has been range-checked, not believed.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

NAME_LETTERS = 20
CALL_SIGN_LETTERS = 7
STATUS_UNKNOWN = 15


class VesselKind(IntEnum):
    """What sends: by the messages that it sends, not by its number."""

    CLASS_A = 0
    CLASS_B = 1
    BASE_STATION = 2
    MARK = 3  # an aid to navigation


class VesselPosition(msgspec.Struct, frozen=True):
    """Where a vessel says that it is, and how it moves; `t_s` is when this was received.

    Course and speed are over ground. `status` is the navigational status of ITU-R M.1371, 15 for not told.
    `turn_rad_s` is positive to starboard, None where it is not told, or only its sign. `accurate`: within 10 m.
    """

    t_s: float
    mmsi: int
    kind: VesselKind
    latitude_rad: float
    longitude_rad: float
    speed_m_s: float | None = None
    course_rad: float | None = None
    heading_rad: float | None = None
    turn_rad_s: float | None = None
    status: int = STATUS_UNKNOWN
    accurate: bool = False


class VesselIdentity(msgspec.Struct, frozen=True):
    """What a vessel says of itself; empty, 0 or None for what it does not say.

    `dimensions_m` are the distances from the antenna to bow, stern, port and starboard side. `ship_type` is that of
    ITU-R M.1371, of a mark its own.
    """

    t_s: float
    mmsi: int
    name: str = ""
    call_sign: str = ""
    ship_type: int = 0
    dimensions_m: tuple[int, int, int, int] | None = None


VesselReport = VesselPosition | VesselIdentity


def merged(before: VesselIdentity, after: VesselIdentity) -> VesselIdentity:
    """Return what a vessel has said of itself in two messages, the later one where both tell the same."""
    return VesselIdentity(
        after.t_s,
        after.mmsi,
        after.name or before.name,
        after.call_sign or before.call_sign,
        after.ship_type or before.ship_type,
        after.dimensions_m or before.dimensions_m,
    )


class Vessel(msgspec.Struct, frozen=True):
    """A vessel of the table: the last believed position, what is known of it, and what was found at the last look.

    `doubted` is a position that it cannot have come to, told `doubts` times in a row. `distance_m` and `bearing_rad`
    are of where it is by now if it has gone on. `cpa_m` is how near it comes within twice AIS_NEAR_S, `cpa_in_s` when;
    None while the boat does not know where she is. `near_s`: since when it is told of as near, None while it is not.
    """

    position: VesselPosition
    identity: VesselIdentity | None = None
    doubted: VesselPosition | None = None
    doubts: int = 0
    distance_m: float | None = None
    bearing_rad: float | None = None
    cpa_m: float | None = None
    cpa_in_s: float | None = None
    near_s: float | None = None

    @property
    def mmsi(self) -> int:
        """The number that the vessel sends."""
        return self.position.mmsi

    @property
    def title(self) -> str:
        """The name, or the number where none is known."""
        return (self.identity.name if self.identity is not None else "") or f"MMSI {self.position.mmsi:09d}"


class Traffic(msgspec.Struct, frozen=True):
    """The vessels known; the heading steered to step aside, None on her own way; how many there was no room for."""

    vessels: tuple[Vessel, ...] = ()
    aside_rad: float | None = None
    turned_away: int = 0
