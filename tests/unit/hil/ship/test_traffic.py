"""Traffic patterns and closest approaches of other ships."""

import math

import numpy as np
import pytest

from hil.ship.disturbances import Vessels
from hil.ship.traffic import FLOOD, MEETING_S, OWN_MMSI, PATTERNS, Closest, Ship, meeting, ships_of

SPEED_M_S = 0.4


def distances(ship, seconds=3600):
    """How far a ship is, second by second, from a boat that goes north."""
    places = np.array([ship.position_m(float(t_s)) for t_s in range(seconds)])
    return np.hypot(places[:, 0] - SPEED_M_S * np.arange(seconds), places[:, 1])


@pytest.mark.parametrize("course_deg", [0.0, 45.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("miss_m", [-300.0, 0.0, 80.0])
def test_time_and_distance_of_the_closest_approach(course_deg, miss_m):
    ship = meeting(Ship(1, "A", 0.0, 0.0, 7.0, course_deg), SPEED_M_S, MEETING_S, miss_m)
    found = distances(ship)
    assert found[round(MEETING_S)] == pytest.approx(abs(miss_m), abs=0.5)
    assert found.min() == pytest.approx(abs(miss_m), abs=1.0)
    assert abs(int(found.argmin()) - MEETING_S) <= 5.0


def test_distance_is_to_starboard_of_the_ship():
    ship = meeting(Ship(1, "A", 0.0, 0.0, 5.0, 0.0), SPEED_M_S, MEETING_S, 100.0)
    assert ship.position_m(MEETING_S) == pytest.approx((SPEED_M_S * MEETING_S, 100.0))


@pytest.mark.parametrize("name", PATTERNS)
def test_a_seed_repeats_the_pattern(name):
    first, again = (ships_of(Vessels(name), SPEED_M_S, 3) for _ in range(2))
    assert first == again
    assert len({(ship.mmsi, ship.name) for ship in first}) == len(first)


@pytest.mark.parametrize("name", ["crossing", "head-on", "overtaking", "spoofed", "absurd", "flood"])
def test_one_ship_of_each_pattern_comes_within_100_m(name):
    assert distances(ships_of(Vessels(name), SPEED_M_S, 1)[0]).min() < 100.0


def test_contents_of_the_patterns():
    fleet = ships_of(Vessels("anchored"), SPEED_M_S, 1)
    assert sum(ship.at_anchor for ship in fleet) == 12
    assert {ship.station for ship in fleet} == {"A", "B", "mark"}
    spoofed = ships_of(Vessels("spoofed"), SPEED_M_S, 1)
    assert any(ship.mmsi == OWN_MMSI for ship in spoofed)
    assert any(ship.trick == "leaps" for ship in spoofed)
    flood = ships_of(Vessels("flood"), SPEED_M_S, 1)
    assert len(flood) == FLOOD + 1
    assert min(math.hypot(ship.north_m, ship.east_m) for ship in flood[1:]) >= 15_000.0
    for seed in range(50):
        (ship,) = ships_of(Vessels("encounter"), SPEED_M_S, seed)
        assert distances(ship).min() <= 401.0
    assert ships_of(None, SPEED_M_S, 1) == ()


def test_closest_approaches_are_reported():
    ships = tuple(Ship(number, f"S{number}", 0.0, 100.0 * number, 1.0, 0.0) for number in range(20, 0, -1))
    closest = Closest(ships)
    for start in (0.0, 100.0):
        t_s = start + np.arange(100.0)
        closest.add(t_s, 0.5 * t_s, np.zeros(100))
    figures = closest.figures()
    assert len(figures) == 10
    assert figures[0] == {"name": "S1", "mmsi": 1, "closest_m": pytest.approx(100.0), "at_s": 0.0}
    assert Closest(()).figures() == []
