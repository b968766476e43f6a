"""What is known of other vessels: the records that AIS gives, and what the table makes of them.

Conventions as in records.py. Everything here was sent by somebody else: it has been range-checked, not believed.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

NAME_LETTERS = 20
CALL_SIGN_LETTERS = 7
STATUS_UNKNOWN = 15
STATUS_DISTRESS = 14  # an active AIS-SART, man overboard device or EPIRB
BESIDE_S = 60.0  # so long at the boat's place, and a heading changes nothing
DISTRESS_DEVICES = frozenset((970, 972, 974))  # the first three digits of their numbers (ITU-R M.585)


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


def is_distress_number(mmsi: int) -> bool:
    """Whether a number is that of an AIS-SART, a man overboard device or an EPIRB."""
    return mmsi // 1_000_000 in DISTRESS_DEVICES


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
    `beside_s` and `beside_rad`: since when this vessel is always at the very place of the boat, and where it was then
    (latitude, longitude). `own`: it has gone a way with the boat since, so it is the boat's own echo.
    `reported_s`: when a distress beacon was last reported; `bearing_reported`: with bearing and distance.
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
    beside_s: float | None = None
    beside_rad: tuple[float, float] = (0.0, 0.0)
    own: bool = False
    reported_s: float | None = None
    bearing_reported: bool = False

    @property
    def distress(self) -> bool:
        """Whether it is a distress beacon."""
        return self.position.status == STATUS_DISTRESS or is_distress_number(self.position.mmsi)

    @property
    def warned_of(self) -> bool:
        """Whether it is another vessel."""
        return not (self.own or self.distress)

    @property
    def avoided(self) -> bool:
        """Whether it is another vessel that is not at the boat's place all the time."""
        beside = self.beside_s is not None and self.position.t_s - self.beside_s >= BESIDE_S
        return self.warned_of and not beside

    @property
    def mmsi(self) -> int:
        """The number that the vessel sends."""
        return self.position.mmsi

    @property
    def title(self) -> str:
        """The name, or the number where none is known."""
        if self.distress:
            return f"Distress beacon {self.position.mmsi:09d}"
        return (self.identity.name if self.identity is not None else "") or f"MMSI {self.position.mmsi:09d}"


class Traffic(msgspec.Struct, frozen=True):
    """The vessels known; the heading steered to step aside, None on her own way; how many there was no room for."""

    vessels: tuple[Vessel, ...] = ()
    aside_rad: float | None = None
    turned_away: int = 0
