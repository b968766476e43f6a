"""Other ships on straight tracks, and the traffic patterns for tests.

A pattern is placed for a boat that steers north from the start at the scenario's speed; times are those of the run.
Random values are drawn from the seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from hil.ship.noise import Stream, generator

OWN_MMSI = 235_000_007  # of the boat's own transponder
MEETING_S = 1800.0  # time of the closest approach of the ship of a pattern
FLOOD_SHIPS = 10_000
MAX_REPORTED = 10  # ships in the list of closest approaches

Array = NDArray[np.float64]
Station = Literal["A", "B", "mark"]  # AIS class of a ship, or an aid to navigation
# Invalid AIS data: every other position is 20 nautical miles away, or the values are out of range.
ErrorKind = Literal["", "leaps", "absurd"]


@dataclass(frozen=True, slots=True)
class Ship:
    """A ship with constant course and speed from (north_m, east_m) at 0 s; metres from the boat's start."""

    mmsi: int
    name: str
    north_m: float
    east_m: float
    speed_m_s: float = 0.0
    course_deg: float = 0.0
    station: Station = "A"
    at_anchor: bool = False
    error_kind: ErrorKind = ""

    def position_m(self, t_s: float) -> tuple[float, float]:
        """Return the position north and east of the boat's start."""
        course_rad = math.radians(self.course_deg)
        distance_m = self.speed_m_s * t_s
        return self.north_m + distance_m * math.cos(course_rad), self.east_m + distance_m * math.sin(course_rad)


class HasPattern(Protocol):
    """Options with the name of a traffic pattern."""

    @property
    def scene(self) -> str:
        """One of PATTERNS."""


def on_meeting_track(ship: Ship, speed_m_s: float, at_s: float, passing_distance_m: float) -> Ship:
    """Move the ship to a track that passes a boat on a northerly course at at_s.

    The boat is then passing_distance_m to port of the ship. The closest approach is within some seconds of at_s.
    """
    course_rad = math.radians(ship.course_deg)
    distance_m = ship.speed_m_s * at_s
    north_m = speed_m_s * at_s - distance_m * math.cos(course_rad) - passing_distance_m * math.sin(course_rad)
    east_m = -distance_m * math.sin(course_rad) + passing_distance_m * math.cos(course_rad)
    return replace(ship, north_m=north_m, east_m=east_m)


Pattern = Callable[[float, np.random.Generator], tuple[Ship, ...]]


def crossing(speed_m_s: float, _rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a ship that crosses from starboard."""
    ship = Ship(211_000_001, "CROSSING LADY", 0.0, 0.0, 7.0, 270.0)
    return (on_meeting_track(ship, speed_m_s, MEETING_S, 80.0),)


def head_on(speed_m_s: float, _rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a ship on the opposite course."""
    return (on_meeting_track(Ship(211_000_002, "HEAD ON", 0.0, 0.0, 6.0, 180.0), speed_m_s, MEETING_S, -40.0),)


def overtaking(speed_m_s: float, _rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a yacht of class B that overtakes the boat."""
    yacht = Ship(211_000_003, "OVERTAKER", 0.0, 0.0, 3.5, 3.0, "B")
    return (on_meeting_track(yacht, speed_m_s, MEETING_S, 30.0),)


def anchored(speed_m_s: float, rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return ships at anchor around the boat's track, one of them on the track, and a buoy."""
    ships = []
    for number in range(12):
        ahead_m = speed_m_s * MEETING_S * (0.5 + number / 8.0)
        beside_m = float(rng.uniform(120.0, 600.0)) * (-1.0) ** number
        station: Station = "A" if number % 3 else "B"
        ships.append(
            Ship(211_000_100 + number, f"ANCHORED {number + 1}", ahead_m, beside_m, station=station, at_anchor=True)
        )
    ships[4] = replace(ships[4], east_m=15.0)
    return (*ships, Ship(992_111_000, "FAIRWAY BUOY", speed_m_s * MEETING_S, -60.0, station="mark"))


def spoofed(speed_m_s: float, rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a crossing ship, 30 false ones, one whose position jumps, and one with the boat's own MMSI."""
    ghosts = []
    for number in range(30):
        mmsi = int(rng.integers(200_000_000, 775_000_000))
        north_m, east_m = map(float, rng.uniform(-20_000.0, 20_000.0, 2))
        speed, course_deg = float(rng.uniform(0.0, 20.0)), float(rng.uniform(0.0, 360.0))
        ghosts.append(Ship(mmsi, f"GHOST {number + 1}", north_m, east_m, speed, course_deg))
    leaping = Ship(211_000_005, "LEAPER", 9000.0, 9000.0, 5.0, 200.0, error_kind="leaps")
    duplicate = Ship(OWN_MMSI, "DOUBLE", 300.0, 0.0, 0.4, 180.0, "B")
    return (*crossing(speed_m_s, rng), *ghosts, leaping, duplicate)


def absurd(speed_m_s: float, rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a crossing ship and stations that send values out of range."""
    stations = tuple(
        Ship(211_000_200 + number, f"ABSURD {number + 1}", 500.0, 100.0 * number, 5.0, 180.0, error_kind="absurd")
        for number in range(6)
    )
    return (*crossing(speed_m_s, rng), *stations)


def flood(speed_m_s: float, rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return a crossing ship and ten thousand distant ones, which fill the AIS channels."""
    angles, ranges = rng.uniform(0.0, 2.0 * math.pi, FLOOD_SHIPS), rng.uniform(15_000.0, 35_000.0, FLOOD_SHIPS)
    courses, speeds = rng.uniform(0.0, 360.0, FLOOD_SHIPS), rng.uniform(0.0, 10.0, FLOOD_SHIPS)
    ships = tuple(
        Ship(
            300_000_000 + number,
            f"FAR {number + 1}",
            float(ranges[number] * math.cos(angles[number])),
            float(ranges[number] * math.sin(angles[number])),
            float(speeds[number]),
            float(courses[number]),
        )
        for number in range(FLOOD_SHIPS)
    )
    return (*crossing(speed_m_s, rng), *ships)


def encounter(speed_m_s: float, rng: np.random.Generator) -> tuple[Ship, ...]:
    """Return one random ship of class A or B with 2 to 10 m/s that passes within 400 m."""
    ship = Ship(
        211_000_009,
        "RANDOM",
        0.0,
        0.0,
        float(rng.uniform(2.0, 10.0)),
        float(rng.uniform(0.0, 360.0)),
        "A" if rng.random() < 0.7 else "B",
    )
    return (on_meeting_track(ship, speed_m_s, MEETING_S, float(rng.uniform(-400.0, 400.0))),)


PATTERNS: Mapping[str, Pattern] = {
    "crossing": crossing,
    "head-on": head_on,
    "overtaking": overtaking,
    "anchored": anchored,
    "spoofed": spoofed,
    "absurd": absurd,
    "flood": flood,
    "encounter": encounter,
}


def ships_of(options: HasPattern | None, speed_m_s: float, seed: int) -> tuple[Ship, ...]:
    """Return the ships of a traffic pattern for a boat of this speed; none without a pattern."""
    return () if options is None else PATTERNS[options.scene](speed_m_s, generator(seed, Stream.SHIPS))


class ClosestApproaches:
    """The closest approach of each ship to the boat, over pieces of the boat's track."""

    def __init__(self, ships: tuple[Ship, ...]) -> None:
        """Start with infinite distances."""
        self._ships = ships
        self._closest = [(math.inf, 0.0)] * len(ships)

    def add(self, t_s: Array, north_m: Array, east_m: Array) -> None:
        """Add a piece of the track."""
        for number, ship in enumerate(self._ships):
            course_rad, travelled_m = math.radians(ship.course_deg), ship.speed_m_s * t_s
            relative_north_m = ship.north_m + travelled_m * math.cos(course_rad) - north_m
            relative_east_m = ship.east_m + travelled_m * math.sin(course_rad) - east_m
            distance_m = np.hypot(relative_north_m, relative_east_m)
            index = int(distance_m.argmin())
            self._closest[number] = min(self._closest[number], (float(distance_m[index]), float(t_s[index])))

    def figures(self) -> list[dict[str, float | str]]:
        """Return the MAX_REPORTED closest approaches, the closest first."""
        nearest = sorted(zip(self._closest, self._ships, strict=True), key=lambda pair: pair[0])[:MAX_REPORTED]
        return [
            {"name": ship.name, "mmsi": ship.mmsi, "closest_m": distance_m, "at_s": at_s}
            for (distance_m, at_s), ship in nearest
            if math.isfinite(distance_m)
        ]
