"""Traffic patterns and closest approaches of other ships."""

import math

import numpy as np
import pytest

from hil.ship.disturbances import Vessels
from hil.ship.traffic import (
    FLOOD_SHIPS,
    MEETING_S,
    OWN_MMSI,
    PATTERNS,
    ClosestApproaches,
    Ship,
    on_meeting_track,
    ships_of,
)

SPEED_M_S = 0.4


def distances(ship, seconds=3600):
    """Return the distances each second of a ship from a boat on a northerly course."""
    positions = np.array([ship.position_m(float(t_s)) for t_s in range(seconds)])
    return np.hypot(positions[:, 0] - SPEED_M_S * np.arange(seconds), positions[:, 1])


@pytest.mark.parametrize("course_deg", [0.0, 45.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("passing_distance_m", [-300.0, 0.0, 80.0])
def test_ship_on_a_meeting_track_has_its_closest_approach_at_the_time(course_deg, passing_distance_m):
    ship = on_meeting_track(Ship(1, "A", 0.0, 0.0, 7.0, course_deg), SPEED_M_S, MEETING_S, passing_distance_m)
    distances_m = distances(ship)
    assert distances_m[round(MEETING_S)] == pytest.approx(abs(passing_distance_m), abs=0.5)
    assert distances_m.min() == pytest.approx(abs(passing_distance_m), abs=1.0)
    assert abs(int(distances_m.argmin()) - MEETING_S) <= 5.0


def test_ship_passes_to_starboard_of_the_boat():
    ship = on_meeting_track(Ship(1, "A", 0.0, 0.0, 5.0, 0.0), SPEED_M_S, MEETING_S, 100.0)
    assert ship.position_m(MEETING_S) == pytest.approx((SPEED_M_S * MEETING_S, 100.0))


@pytest.mark.parametrize("name", PATTERNS)
def test_seed_determines_the_pattern(name):
    ships, again = (ships_of(Vessels(name), SPEED_M_S, 3) for _ in range(2))
    assert ships == again
    assert len({(ship.mmsi, ship.name) for ship in ships}) == len(ships)


@pytest.mark.parametrize("name", ["crossing", "head-on", "overtaking", "spoofed", "absurd", "flood"])
def test_first_ship_of_a_pattern_passes_within_100_m(name):
    assert distances(ships_of(Vessels(name), SPEED_M_S, 1)[0]).min() < 100.0


def test_patterns_contain_their_ships():
    fleet = ships_of(Vessels("anchored"), SPEED_M_S, 1)
    assert sum(ship.at_anchor for ship in fleet) == 12
    assert {ship.station for ship in fleet} == {"A", "B", "mark"}
    spoofed = ships_of(Vessels("spoofed"), SPEED_M_S, 1)
    assert any(ship.mmsi == OWN_MMSI for ship in spoofed)
    assert any(ship.error_kind == "leaps" for ship in spoofed)
    flood = ships_of(Vessels("flood"), SPEED_M_S, 1)
    assert len(flood) == FLOOD_SHIPS + 1
    assert min(math.hypot(ship.north_m, ship.east_m) for ship in flood[1:]) >= 15_000.0
    for seed in range(50):
        (ship,) = ships_of(Vessels("encounter"), SPEED_M_S, seed)
        assert distances(ship).min() <= 401.0
    assert ships_of(None, SPEED_M_S, 1) == ()


def test_closest_approaches_are_reported():
    ships = tuple(Ship(number, f"S{number}", 0.0, 100.0 * number, 1.0, 0.0) for number in range(20, 0, -1))
    closest = ClosestApproaches(ships)
    for start in (0.0, 100.0):
        t_s = start + np.arange(100.0)
        closest.add(t_s, 0.5 * t_s, np.zeros(100))
    figures = closest.figures()
    assert len(figures) == 10
    assert figures[0] == {"name": "S1", "mmsi": 1, "closest_m": pytest.approx(100.0), "at_s": 0.0}
    assert ClosestApproaches(()).figures() == []
