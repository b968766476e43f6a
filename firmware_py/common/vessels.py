"""Records of other vessels: AIS reports, and the table of vessels.

Conventions as in records.py. All values come from other senders: they are checked for range, but may be wrong.
"""

from __future__ import annotations

from enum import IntEnum

import msgspec

MAX_NAME_CHARACTERS = 20
MAX_CALL_SIGN_CHARACTERS = 7
STATUS_UNKNOWN = 15
STATUS_DISTRESS = 14  # of an active AIS-SART, man overboard device or EPIRB
MIN_BESIDE_S = 60.0  # a vessel at the place of the boat for this time cannot be avoided by another heading
DISTRESS_DEVICES = frozenset((970, 972, 974))  # first three digits of the MMSI (ITU-R M.585)


class VesselKind(IntEnum):
    """Kind of sender, by its message types."""

    CLASS_A = 0
    CLASS_B = 1
    BASE_STATION = 2
    MARK = 3  # an aid to navigation


class VesselPosition(msgspec.Struct, frozen=True):
    """Reported position and motion of a vessel; `t_s` is the time of reception.

    Course and speed are over ground. `status` is the navigational status of ITU-R M.1371, 15 if unknown. `turn_rad_s`
    is positive to starboard, None if unknown or only its sign is known. `accurate`: within 10 m.
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
    """Reported identity of a vessel; empty, 0 or None if not reported.

    `dimensions_m` are the distances from the antenna to bow, stern, port and starboard side. `ship_type` follows ITU-R
    M.1371, for an aid to navigation its type.
    """

    t_s: float
    mmsi: int
    name: str = ""
    call_sign: str = ""
    ship_type: int = 0
    dimensions_m: tuple[int, int, int, int] | None = None


VesselReport = VesselPosition | VesselIdentity


def is_distress_number(mmsi: int) -> bool:
    """Return whether the MMSI belongs to an AIS-SART, a man overboard device or an EPIRB."""
    return mmsi // 1_000_000 in DISTRESS_DEVICES


def merge(earlier: VesselIdentity, later: VesselIdentity) -> VesselIdentity:
    """Merge the identities of two messages; the later one takes precedence."""
    return VesselIdentity(
        later.t_s,
        later.mmsi,
        later.name or earlier.name,
        later.call_sign or earlier.call_sign,
        later.ship_type or earlier.ship_type,
        later.dimensions_m or earlier.dimensions_m,
    )


class Vessel(msgspec.Struct, frozen=True):
    """A vessel of the table: last accepted position, identity, and results of the last check.

    `doubted` is an impossible position, reported `doubts` times in a row. `distance_m` and `bearing_rad` belong to the
    extrapolated position. `cpa_m` is the closest approach within twice AIS_NEAR_S, `cpa_in_s` the time until then; None
    while the own position is unknown. `near_s`: time since which it counts as near, None if it does not. `beside_s` and
    `beside_rad`: time since which it stays at the place of the boat, and its place then (latitude, longitude). `own`:
    it has moved with the boat since, so it is the transponder of the boat itself. `reported_s`: time at which a
    distress beacon was last reported to the operator; `bearing_reported`: with bearing and distance.
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
    def is_distress_beacon(self) -> bool:
        """Whether it is a distress beacon."""
        return self.position.status == STATUS_DISTRESS or is_distress_number(self.position.mmsi)

    @property
    def is_other_vessel(self) -> bool:
        """Whether it is another vessel."""
        return not (self.own or self.is_distress_beacon)

    @property
    def is_avoidable(self) -> bool:
        """Whether it is another vessel that is not at the place of the boat all the time."""
        beside = self.beside_s is not None and self.position.t_s - self.beside_s >= MIN_BESIDE_S
        return self.is_other_vessel and not beside

    @property
    def mmsi(self) -> int:
        """The number of the vessel."""
        return self.position.mmsi

    @property
    def title(self) -> str:
        """The name, or the number if the name is unknown."""
        if self.is_distress_beacon:
            return f"Distress beacon {self.position.mmsi:09d}"
        return (self.identity.name if self.identity is not None else "") or f"MMSI {self.position.mmsi:09d}"


class Traffic(msgspec.Struct, frozen=True):
    """Known vessels, avoidance heading (None without avoidance), and number of vessels that the full table rejected."""

    vessels: tuple[Vessel, ...] = ()
    aside_rad: float | None = None
    rejected: int = 0
