"""Table of vessels: entries, plausibility, reports, echoes and distress beacons."""

import math
import random
import re

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, Severity
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.guidance import traffic
from firmware_py.guidance.traffic import OwnMotion, TrafficSettings, TrafficState
from support.plans import placed

MAX_VESSELS = 100
SETTINGS = TrafficSettings.of(ParameterSet())  # near: 500 m within 1500 s; at rest (below 0.5 m/s): 100 m
HERE = OwnMotion(Place(*placed(0.0, 0.0)), (0.0, 0.0))


def position(mmsi, t_s, north_m, east_m, speed_m_s=5.0, course_deg=180.0, kind=VesselKind.CLASS_A):
    return VesselPosition(t_s, mmsi, kind, *placed(north_m, east_m), speed_m_s, math.radians(course_deg))


def update(state, t_s, *reports, own=HERE):
    state, events = traffic.update(SETTINGS, state, reports, own, t_s)
    return state, [event.text for event in events]


def simulate(seconds, *ships, state=None, every_s=10.0):
    """Simulate ships on straight lines that send reports; return the state and the texts with their times."""
    state, log = state or TrafficState(), []
    for t_s in range(round(seconds)):
        reports = [ship(float(t_s)) for ship in ships] if t_s % every_s == 0 else []
        state, texts = update(state, float(t_s), *reports)
        log += [(t_s, text) for text in texts]
    return state, log


def straight(mmsi, north_m, east_m, speed_m_s=5.0, course_deg=180.0):
    course_rad = math.radians(course_deg)
    north_m_s, east_m_s = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
    return lambda t_s: position(mmsi, t_s, north_m + north_m_s * t_s, east_m + east_m_s * t_s, speed_m_s, course_deg)


def test_approach_is_reported_once_and_ends_when_the_vessel_has_passed():
    state, log = simulate(3000.0, straight(211000001, 9000.0, 200.0))
    assert len(log) == 1
    report_s, text = log[0]
    assert text == "MMSI 211000001: closest 200 m in 27 min, bearing 1 deg"
    assert report_s == pytest.approx((9000.0 - 7500.0 - 458.0) / 5.0, abs=20.0)  # 25 min before its distance is 500 m
    assert not state.near
    assert simulate(1850.0, straight(211000001, 9000.0, 200.0))[0].near


def test_second_approach_is_reported_again():
    ship = straight(1, 3000.0, 0.0)
    state, log = simulate(1500.0, ship)
    assert len(log) == 1
    reports = [position(1, 1500.0 + t, -4500.0 + 5.0 * t, 0.0, 5.0, 0.0) for t in range(0, 600, 10)]
    texts = []
    for report in reports:
        state, new_texts = update(state, report.t_s, report)
        texts += new_texts
    assert len(texts) == 1


@pytest.mark.parametrize("east_m", [700.0, 5000.0])
def test_vessel_passing_at_a_distance_is_not_reported(east_m):
    assert simulate(3000.0, straight(1, 9000.0, east_m))[1] == []


@pytest.mark.parametrize(("distance_m", "count"), [(90.0, 1), (300.0, 0)])
def test_vessel_at_rest_has_another_near_distance(distance_m, count):
    for speed_m_s in (0.1, 0.0):
        assert len(simulate(100.0, straight(1, distance_m, 0.0, speed_m_s))[1]) == count


def test_ship_at_anchor_ahead_is_reported():
    own = OwnMotion(HERE.place, (0.4, 0.0))
    state, texts = update(TrafficState(), 0.0, position(1, 0.0, 500.0, 20.0, 0.0), own=own)
    assert texts == ["MMSI 000000001: closest 20 m in 21 min, bearing 2 deg"]
    assert state.near


def test_vessel_stays_near_while_the_way_back_leads_near_it():
    place, north_m_s, return_m_s = HERE.place, (0.4, 0.0), (0.04, -0.39)
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 200.0, 10.0, 0.0), own=OwnMotion(place, north_m_s))
    assert state.near
    for t_s, passed_m, is_near in ((500.0, 20.0, True), (800.0, 80.0, True), (1000.0, 140.0, False)):
        abeam = position(1, t_s, -passed_m, -250.0, 0.0)
        state, texts = update(state, t_s, abeam, own=OwnMotion(place, north_m_s, north_m_s, return_m_s))
        assert (state.near, texts) == (is_near, [])


def test_vessel_ahead_is_near_although_other_courses_lead_away_from_it():
    place, away_m_s = HERE.place, (-0.4, 0.0)
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 200.0, 10.0, 0.0), own=OwnMotion(place, (0.4, 0.0)))
    state, _ = update(state, 2.0, own=OwnMotion(place, (0.4, 0.0), away_m_s, away_m_s))
    assert state.near


@pytest.mark.parametrize(
    ("own_m_s", "north_m", "east_m", "is_near"),
    [
        ((0.0, 0.0), 109.0, 0.0, True),
        ((0.0, 0.0), 111.0, 0.0, False),  # passed at 1.1 near distances of 100 m
        ((0.4, 0.0), 150.0, 299.0, True),
        ((0.4, 0.0), 150.0, 301.0, False),  # clear at 3 near distances, although it is still ahead
        ((0.4, 0.0), -109.0, 0.0, True),
        ((0.4, 0.0), -111.0, 0.0, False),
    ],
)
def test_vessel_is_clear_beyond_multiples_of_its_near_distance(own_m_s, north_m, east_m, is_near):
    own = OwnMotion(HERE.place, own_m_s)
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 50.0, 0.0, 0.0), own=own)
    assert state.near
    state, _ = update(state, 2.0, position(1, 2.0, north_m, east_m, 0.0), own=own)
    assert state.near is is_near


@pytest.mark.parametrize(("now_s", "is_checked"), [(101.9, False), (102.0, True), (99.9, True)])
def test_table_is_checked_every_two_seconds(now_s, is_checked):
    state, _ = update(TrafficState(), 100.0, position(1, 100.0, 3000.0, 0.0))
    assert (update(state, now_s)[0].checked_s == now_s) is is_checked


@pytest.mark.parametrize(
    ("distance_m", "moved_m", "delay_s", "is_echo"),
    [(39.0, 51.0, 2.0, True), (41.0, 51.0, 2.0, False), (39.0, 49.0, 2.0, False), (39.0, 51.0, 2.1, False)],
)
def test_vessel_that_moves_by_50_m_within_40_m_of_the_boat_is_its_echo(distance_m, moved_m, delay_s, is_echo):
    state = TrafficState()
    for t_s, north_m in ((0.0, 0.0), (100.0, moved_m)):
        own = OwnMotion(Place(*placed(north_m, 0.0)), (0.5, 0.0))
        state, _ = update(state, t_s + delay_s, position(1, t_s, north_m, distance_m, 0.5, 0.0), own=own)
    assert state.vessels[0].own is is_echo


@pytest.mark.parametrize(("distance_m", "is_added"), [(209_000.0, True), (211_000.0, False)])
def test_vessel_that_arrives_earlier_replaces_one_in_a_full_table(distance_m, is_added):
    """The boat approaches with 0.5 m/s: a vessel at rest in a distance of 10 km arrives after 20,000 s."""
    table = [position(1, 0.0, 10_000.0, 0.0, 0.0), *(position(n, 0.0, 9000.0, 0.0, 5.0) for n in range(2, 101))]
    state, _ = update(TrafficState(), 0.0, *table)
    state, _ = update(state, 0.1, position(999, 0.1, distance_m, 0.0, 10.0))
    assert any(vessel.mmsi == 999 for vessel in state.vessels) is is_added
    assert any(vessel.mmsi == 1 for vessel in state.vessels) is not is_added
    assert state.rejected == 1


def test_vessel_without_speed_or_course_does_not_move():
    report = VesselPosition(0.0, 1, VesselKind.CLASS_B, *placed(80.0, 0.0))
    state, texts = update(TrafficState(), 0.0, report)
    assert len(texts) == 1
    assert state.vessels[0].distance_m == pytest.approx(80.0, abs=0.1)


def test_name_is_stored_and_reported():
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0, 0.0), VesselIdentity(0.0, 1, "", "CALL", 70))
    state, _ = update(state, 1.0, VesselIdentity(1.0, 1, "ANNA"))
    assert state.vessels[0].identity == VesselIdentity(1.0, 1, "ANNA", "CALL", 70)
    state, texts = update(state, 5.0, position(1, 5.0, 3000.0, 0.0))
    assert texts == ["ANNA: closest 0 m in 10 min, bearing 0 deg"]
    assert update(TrafficState(), 0.0, VesselIdentity(0.0, 2, "ANNA"))[0].vessels == ()


def test_no_vessel_is_near_without_own_position():
    state, texts = update(TrafficState(), 0.0, position(1, 0.0, 100.0, 0.0), own=None)
    assert texts == []
    assert (state.vessels[0].distance_m, state.vessels[0].cpa_m) == (None, None)


@pytest.mark.parametrize(("speed_m_s", "max_age_s"), [(5.0, 600.0), (0.0, 1800.0)])
def test_silent_vessel_at_rest_is_removed_later(speed_m_s, max_age_s):
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0, speed_m_s))
    assert len(update(state, max_age_s)[0].vessels) == 1
    assert update(state, max_age_s + 2.0)[0].vessels == ()


def test_jump_of_the_position_needs_confirmation():
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 9000.0, 9000.0))
    old_position = state.vessels[0].position
    for t_s in (10.0, 20.0):
        state, texts = update(state, t_s, position(1, t_s, 100.0, 0.0))
        assert state.vessels[0].position == old_position
        assert texts == []
    state, texts = update(state, 30.0, position(1, 30.0, 100.0, 0.0))
    assert state.vessels[0].distance_m == pytest.approx(100.0, abs=0.5)
    assert len(texts) == 1


@pytest.mark.parametrize(("jump_m", "is_used"), [(1095.0, True), (1105.0, False)])
def test_jump_within_the_speed_of_the_fastest_craft_needs_no_confirmation(jump_m, is_used):
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 9000.0, 9000.0))
    state, _ = update(state, 10.0, position(1, 10.0, 9000.0 - jump_m, 9000.0))  # 500 m, and 60 m/s
    assert (state.vessels[0].position.t_s == 10.0) is is_used


def test_position_does_not_alternate_between_two_vessels_with_one_number():
    state, log = TrafficState(), []
    for t_s in range(0, 300, 10):
        state, texts = update(state, float(t_s), position(1, t_s, 9000.0 - 5.0 * t_s, 9000.0))
        log += texts
        state, texts = update(state, t_s + 5.0, position(1, t_s + 5.0, 100.0, 0.0))
        log += texts
    assert log == []
    assert state.vessels[0].distance_m > 9000.0


def test_full_table_keeps_the_vessels_that_could_arrive_first():
    rng = random.Random(2)
    state = TrafficState()
    state, _ = update(state, 0.0, position(999, 0.0, 6000.0, 0.0, 8.0))
    for number in range(10_000):
        distance_m = rng.uniform(20_000.0, 60_000.0)
        angle_rad = rng.uniform(0.0, 2.0 * math.pi)
        report = position(
            number + 1000,
            0.1,
            distance_m * math.cos(angle_rad),
            distance_m * math.sin(angle_rad),
            rng.uniform(0.0, 10.0),
        )
        state, _ = update(state, 0.1, report)
        assert len(state.vessels) <= MAX_VESSELS
    assert any(vessel.mmsi == 999 for vessel in state.vessels)
    assert state.rejected == 10_001 - MAX_VESSELS
    times_s = [vessel.distance_m / (vessel.position.speed_m_s + 0.5) for vessel in state.vessels]
    assert max(times_s) < 60_000.0 / 10.5 + 100.0


def test_several_near_vessels_are_reported_in_order_of_approach():
    ships = [position(number, 0.0, 500.0 + 100.0 * number, 0.0) for number in range(59, 0, -1)]
    state, texts = update(TrafficState(), 0.0, *ships)
    assert [text[:14] for text in texts] == ["MMSI 000000001"]
    assert update(state, 4.9)[1] == []
    assert [text[:14] for text in update(state, 5.0)[1]] == ["MMSI 000000002"]


def test_vessel_at_its_closest_approach_is_reported_first():
    """The other one is at its closest approach in half a second."""
    _, texts = update(TrafficState(), 0.0, position(1, 0.0, 2.5, 300.0), position(2, 0.0, -300.0, 0.0))
    assert [text[:14] for text in texts] == ["MMSI 000000002"]


def test_reported_vessel_stays_in_a_full_table():
    state, _ = update(TrafficState(), 0.0, position(1, 0.0, 400.0, 0.0, 0.6, 0.0))
    assert state.near
    for number in range(2, 300):
        state, _ = update(state, 0.1, position(number, 0.1, 300.0, 10.0 * (number % 20), 20.0))
    assert any(vessel.mmsi == 1 and vessel.near_s is not None for vessel in state.vessels)


def test_receiver_problems_are_reported_at_intervals():
    def health(text, role=DeviceRole.AIS):
        return (DeviceHealth(0.0, role, DeviceState.RUNNING, 1, 1, text),)

    state, events = traffic.receiver_events(TrafficState(), health("checksum"), 0.0)
    assert [event.text for event in events] == ["AIS: checksum"]
    assert traffic.receiver_events(state, health("too many sentences, some dropped"), 599.9)[1] == ()
    assert len(traffic.receiver_events(state, health("checksum"), 600.0)[1]) == 1
    assert traffic.receiver_events(TrafficState(), health("checksum", DeviceRole.COMPASS), 0.0)[1] == ()


def simulate_moving(seconds, *ships, speed_m_s=0.5, state=None, radius_m=math.inf, every_s=10.0):
    """Simulate the boat on a course north, or within a radius north and south; ships depend on its position."""
    state, log = state or TrafficState(), []
    for t_s in range(round(seconds)):
        north_m = speed_m_s * t_s if radius_m == math.inf else radius_m * math.sin(speed_m_s * t_s / radius_m)
        own = OwnMotion(Place(*placed(north_m, 0.0)), (speed_m_s, 0.0))
        reports = [ship(float(t_s), north_m) for ship in ships] if t_s % every_s == 0 else []
        state, texts = update(state, float(t_s), *reports, own=own)
        log += [(t_s, text) for text in texts]
    return state, log


def escort(mmsi, distance_m, speed_m_s=0.5):
    """A vessel at a constant distance north of the boat, with the noise of two receivers."""
    return lambda t_s, north_m: position(mmsi, t_s, north_m + distance_m + 8.0 * math.sin(t_s), 5.0, speed_m_s, 0.0)


@pytest.mark.parametrize(("seconds", "radius_m", "max_time_s"), [(900.0, math.inf, 140.0), (3000.0, 60.0, 3000.0)])
def test_own_echo_is_reported_once_and_is_not_near(seconds, radius_m, max_time_s):
    state, log = simulate_moving(seconds, escort(235000007, 0.0), radius_m=radius_m)
    assert [text for _, text in log][1:] == ["MMSI 235000007: own echo, ignored"]
    assert log[1][0] < max_time_s
    assert not state.near
    (echo,) = state.vessels
    assert (echo.own, echo.is_avoidable) == (True, False)


@pytest.mark.parametrize("distance_m", [60.0, 80.0, -150.0])
def test_escort_is_not_an_echo(distance_m):
    state, log = simulate_moving(3000.0, escort(244000123, distance_m))
    assert state.vessels[0].is_avoidable
    assert not any("echo" in text for _, text in log)


def test_mark_at_the_loiter_point_is_not_an_echo():
    def mark(t_s, _north_m):
        return position(992351001, t_s, 0.0, 5.0, 0.0, kind=VesselKind.MARK)

    state, log = simulate_moving(3000.0, mark, radius_m=30.0)
    assert state.near
    assert len(log) == 1


def test_echo_that_moves_away_is_a_vessel_again():
    state, _ = simulate_moving(900.0, escort(235000007, 0.0))
    own = OwnMotion(Place(*placed(450.0, 0.0)), (0.5, 0.0))
    for t_s in (902.0, 912.0, 922.0):  # accepted at the third report
        state, _ = update(state, t_s, position(235000007, t_s, 3000.0, 0.0, 5.0), own=own)
    state, _ = update(state, 930.0, own=own)
    assert state.vessels[0].is_avoidable
    assert state.near


def test_escort_alongside_is_near_but_not_avoided():
    state, log = simulate_moving(90.0, escort(244000123, 0.0))
    (vessel,) = state.vessels
    assert (vessel.own, vessel.near_s is not None, vessel.is_avoidable) == (False, True, False)
    assert len(log) == 1


BEACON = 972603802  # MMSI of a man overboard device
SART_ACTIVE = 14  # navigational status of ITU-R M.1371


def beacon(t_s, mmsi=BEACON, north_m=400.0, status=SART_ACTIVE):
    return VesselPosition(t_s, mmsi, VesselKind.CLASS_A, *placed(north_m, 0.0), 0.2, 1.5, status=status)


@pytest.mark.parametrize(
    ("mmsi", "status"),
    [
        *((970123456, 15), (970123456, SART_ACTIVE)),  # AIS-SART; 15: undefined, as in a test
        *((BEACON, SART_ACTIVE), (974001001, 0)),  # man overboard device, EPIRB
        (211000001, SART_ACTIVE),  # a vessel
    ],
)
@pytest.mark.parametrize("distance_m", [20.0, 400.0, 3000.0, 30000.0])
def test_distress_beacon_is_reported_at_once_and_not_avoided(mmsi, status, distance_m):
    state, events = traffic.update(SETTINGS, TrafficState(), [beacon(0.0, mmsi, distance_m, status)], HERE, 0.0)
    (event,) = events
    assert event.severity is Severity.CRITICAL
    match = re.fullmatch(rf"Distress beacon {mmsi:09d}: (\d+) m, bearing (000|360) deg", event.text)
    assert float(match[1]) == pytest.approx(distance_m, rel=1e-3)
    for t_s in range(1, 600):
        state, texts = update(state, float(t_s), beacon(float(t_s), mmsi, distance_m, status))
        assert texts == []
    assert not state.near
    assert not state.vessels[0].is_avoidable
    assert state.vessels[0].title == f"Distress beacon {mmsi:09d}"
    assert update(state, 602.0, beacon(602.0, mmsi, distance_m, status))[1]  # repeated after ten minutes


def test_beacons_are_reported_one_after_the_other_and_after_a_ship():
    state, texts = update(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0))
    assert len(texts) == 1
    state, texts = update(state, 2.0, beacon(2.0), beacon(2.0, 972000002, 800.0))
    assert [text[:25] for text in texts] == ["Distress beacon 972603802"]
    assert [text[:25] for text in update(state, 4.0)[1]] == ["Distress beacon 972000002"]


def test_beacon_without_position_is_reported():
    state, texts = update(TrafficState(), 0.0, VesselIdentity(0.0, BEACON), own=None)
    assert texts == [f"Distress beacon {BEACON}: no position yet"]
    assert update(state, 4.9, VesselIdentity(4.9, BEACON + 1), own=None)[1] == []
    assert update(state, 5.0, VesselIdentity(5.0, BEACON + 1), own=None)[1] == [
        f"Distress beacon {BEACON + 1}: no position yet"
    ]
    for t_s in (1.0, 5.0, 599.9):
        assert update(state, t_s, VesselIdentity(t_s, BEACON), own=None)[1] == []
    assert len(update(state, 600.0, VesselIdentity(600.0, BEACON), own=None)[1]) == 1
    state, texts = update(state, 600.0, beacon(600.0), own=None)
    latitude_deg, longitude_deg = (math.degrees(angle) for angle in placed(400.0, 0.0))
    assert texts == [f"Distress beacon {BEACON}: at {latitude_deg:.4f}, {longitude_deg:.4f}"]


@pytest.mark.parametrize("fix_s", [1, 4, 14, 300])
def test_bearing_of_a_beacon_is_reported_with_the_first_fix(fix_s):
    state, texts = update(TrafficState(), 0.0, beacon(0.0), own=None)
    assert len(texts) == 1
    log = []
    for t_s in range(1, 400):
        state, texts = update(state, float(t_s), beacon(float(t_s)), own=HERE if t_s >= fix_s else None)
        log += [(t_s, text) for text in texts]
    ((report_s, text),) = log
    assert fix_s <= report_s <= fix_s + 2
    assert re.fullmatch(rf"Distress beacon {BEACON}: 400 m, bearing (000|360) deg", text)


def test_beacon_replaces_a_vessel_in_a_full_table():
    near = [position(number, 0.0, 100.0, 0.0) for number in range(1, MAX_VESSELS + 1)]
    state, _ = update(TrafficState(), 0.0, *near)
    assert update(state, 2.0, beacon(2.0, north_m=9000.0))[1][0].startswith("Distress beacon")
