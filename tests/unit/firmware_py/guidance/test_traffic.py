"""Table of vessels: entries, plausibility and reports."""

import math
import random
import re

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, Severity
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.guidance import traffic
from firmware_py.guidance.traffic import MAX_VESSELS, OwnMotion, TrafficSettings, TrafficState
from support.plans import placed

SETTINGS = TrafficSettings.of(ParameterSet())  # 500 m, 1500 s; still: 100 m, 0.5 m/s
HERE = OwnMotion(Place(*placed(0.0, 0.0)), (0.0, 0.0))


def position(mmsi, t_s, north_m, east_m, speed_m_s=5.0, course_deg=180.0, kind=VesselKind.CLASS_A):
    return VesselPosition(t_s, mmsi, kind, *placed(north_m, east_m), speed_m_s, math.radians(course_deg))


def look(state, t_s, *reports, own=HERE):
    state, events = traffic.update(SETTINGS, state, reports, own, t_s)
    return state, [event.text for event in events]


def sail(seconds, *ships, state=None, every_s=10.0):
    """Let ships go on in straight lines and report; return the texts with their times."""
    state, log = state or TrafficState(), []
    for t_s in range(round(seconds)):
        reports = [ship(float(t_s)) for ship in ships] if t_s % every_s == 0 else []
        state, texts = look(state, float(t_s), *reports)
        log += [(t_s, text) for text in texts]
    return state, log


def straight(mmsi, north_m, east_m, speed_m_s=5.0, course_deg=180.0):
    course_rad = math.radians(course_deg)
    north_m_s, east_m_s = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
    return lambda t_s: position(mmsi, t_s, north_m + north_m_s * t_s, east_m + east_m_s * t_s, speed_m_s, course_deg)


def test_an_approach_is_reported_once_and_ends_when_the_vessel_has_passed():
    state, log = sail(3000.0, straight(211000001, 9000.0, 200.0))
    assert len(log) == 1
    when_s, text = log[0]
    assert text == "MMSI 211000001: closest 200 m in 27 min, bearing 1 deg"
    assert when_s == pytest.approx((9000.0 - 7500.0 - 458.0) / 5.0, abs=20.0)  # 25 min before it is within 500 m
    assert not state.near
    assert sail(1850.0, straight(211000001, 9000.0, 200.0))[0].near


def test_a_second_approach_is_reported_again():
    ship = straight(1, 3000.0, 0.0)
    state, log = sail(1500.0, ship)
    assert len(log) == 1
    back = [position(1, 1500.0 + t, -4500.0 + 5.0 * t, 0.0, 5.0, 0.0) for t in range(0, 600, 10)]
    texts = []
    for report in back:
        state, more = look(state, report.t_s, report)
        texts += more
    assert len(texts) == 1


@pytest.mark.parametrize("east_m", [700.0, 5000.0])
def test_a_vessel_passing_at_a_distance_is_not_reported(east_m):
    assert sail(3000.0, straight(1, 9000.0, east_m))[1] == []


@pytest.mark.parametrize(("distance_m", "count"), [(90.0, 1), (300.0, 0)])
def test_vessels_at_rest_have_their_own_near_distance(distance_m, count):
    assert len(sail(100.0, straight(1, distance_m, 0.0, 0.1))[1]) == count
    assert len(sail(100.0, straight(1, distance_m, 0.0, None or 0.0))[1]) == count


def test_an_anchored_ship_ahead_is_reported():
    own = OwnMotion(HERE.place, (0.4, 0.0))
    state, texts = look(TrafficState(), 0.0, position(1, 0.0, 500.0, 20.0, 0.0), own=own)
    assert texts == ["MMSI 000000001: closest 20 m in 21 min, bearing 2 deg"]
    assert state.near


def test_a_vessel_has_not_passed_while_the_way_back_leads_near_it():
    place, north, back = HERE.place, (0.4, 0.0), (0.04, -0.39)
    state, _ = look(TrafficState(), 0.0, position(1, 0.0, 200.0, 10.0, 0.0), own=OwnMotion(place, north))
    assert state.near
    for t_s, past_m, near in ((500.0, 20.0, True), (800.0, 80.0, True), (1000.0, 140.0, False)):
        abeam = position(1, t_s, -past_m, -250.0, 0.0)
        state, texts = look(state, t_s, abeam, own=OwnMotion(place, north, north, back))
        assert (state.near, texts) == (near, [])


def test_a_vessel_without_speed_or_course_does_not_move():
    report = VesselPosition(0.0, 1, VesselKind.CLASS_B, *placed(80.0, 0.0))
    state, texts = look(TrafficState(), 0.0, report)
    assert len(texts) == 1
    assert state.vessels[0].distance_m == pytest.approx(80.0, abs=0.1)


def test_the_name_is_reported_and_kept():
    state, _ = look(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0, 0.0), VesselIdentity(0.0, 1, "", "CALL", 70))
    state, _ = look(state, 1.0, VesselIdentity(1.0, 1, "ANNA"))
    assert state.vessels[0].identity == VesselIdentity(1.0, 1, "ANNA", "CALL", 70)
    state, texts = look(state, 5.0, position(1, 5.0, 3000.0, 0.0))
    assert texts == ["ANNA: closest 0 m in 10 min, bearing 0 deg"]
    assert look(TrafficState(), 0.0, VesselIdentity(0.0, 2, "ANNA"))[0].vessels == ()


def test_without_own_position_no_vessel_is_near():
    state, texts = look(TrafficState(), 0.0, position(1, 0.0, 100.0, 0.0), own=None)
    assert texts == []
    assert (state.vessels[0].distance_m, state.vessels[0].cpa_m) == (None, None)


@pytest.mark.parametrize(("speed_m_s", "after_s"), [(5.0, 600.0), (0.0, 1800.0)])
def test_silent_vessels_are_removed_later_if_at_rest(speed_m_s, after_s):
    state, _ = look(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0, speed_m_s))
    assert len(look(state, after_s)[0].vessels) == 1
    assert look(state, after_s + 2.0)[0].vessels == ()


def test_a_jump_is_used_only_after_confirmation():
    state, _ = look(TrafficState(), 0.0, position(1, 0.0, 9000.0, 9000.0))
    there = state.vessels[0].position
    for t_s in (10.0, 20.0):
        state, texts = look(state, t_s, position(1, t_s, 100.0, 0.0))
        assert state.vessels[0].position == there
        assert texts == []
    state, texts = look(state, 30.0, position(1, 30.0, 100.0, 0.0))
    assert state.vessels[0].distance_m == pytest.approx(100.0, abs=0.5)
    assert len(texts) == 1


def test_two_vessels_with_one_number_do_not_alternate():
    state, log = TrafficState(), []
    for t_s in range(0, 300, 10):
        state, texts = look(state, float(t_s), position(1, t_s, 9000.0 - 5.0 * t_s, 9000.0))
        log += texts
        state, texts = look(state, t_s + 5.0, position(1, t_s + 5.0, 100.0, 0.0))
        log += texts
    assert log == []
    assert state.vessels[0].distance_m > 9000.0


def test_a_full_table_keeps_the_vessels_that_could_arrive_first():
    rng = random.Random(2)
    state = TrafficState()
    real = position(999, 0.0, 6000.0, 0.0, 8.0)
    state, _ = look(state, 0.0, real)
    for number in range(10_000):
        far = rng.uniform(20_000.0, 60_000.0)
        angle = rng.uniform(0.0, 2.0 * math.pi)
        report = position(number + 1000, 0.1, far * math.cos(angle), far * math.sin(angle), rng.uniform(0.0, 10.0))
        state, _ = look(state, 0.1, report)
        assert len(state.vessels) <= MAX_VESSELS
    assert any(vessel.mmsi == 999 for vessel in state.vessels)
    assert state.rejected == 10_001 - MAX_VESSELS
    kept = [vessel.distance_m / (vessel.position.speed_m_s + 0.5) for vessel in state.vessels]
    assert max(kept) < 60_000.0 / 10.5 + 100.0


def test_several_near_vessels_are_reported_in_order_of_approach():
    ghosts = [straight(number, 500.0 + 100.0 * number, 0.0) for number in range(1, 60)]
    _, log = sail(60.0, *ghosts)
    assert len(log) <= 12
    assert log[0][1].startswith("MMSI 000000001: ")


def test_a_reported_vessel_stays_in_a_full_table():
    state, _ = look(TrafficState(), 0.0, position(1, 0.0, 400.0, 0.0, 0.6, 0.0))
    assert state.near
    for number in range(2, 300):
        state, _ = look(state, 0.1, position(number, 0.1, 300.0, 10.0 * (number % 20), 20.0))
    assert any(vessel.mmsi == 1 and vessel.near_s is not None for vessel in state.vessels)


def test_receiver_problems_are_reported_at_intervals():
    def health(text, role=DeviceRole.AIS):
        return (DeviceHealth(0.0, role, DeviceState.RUNNING, 1, 1, text),)

    state, events = traffic.receiver_events(TrafficState(), health("checksum"), 0.0)
    assert [event.text for event in events] == ["AIS: checksum"]
    assert traffic.receiver_events(state, health("too many sentences, some dropped"), 10.0)[1] == ()
    assert len(traffic.receiver_events(state, health("checksum"), 700.0)[1]) == 1
    assert traffic.receiver_events(TrafficState(), health("checksum", DeviceRole.COMPASS), 0.0)[1] == ()


def sail_north(seconds, *ships, speed_m_s=0.5, state=None, radius_m=math.inf, every_s=10.0):
    """Sail north, or to and fro within a radius, among ships that say where they are seen from the boat's place."""
    state, log = state or TrafficState(), []
    for t_s in range(round(seconds)):
        way_m = speed_m_s * t_s if radius_m == math.inf else radius_m * math.sin(speed_m_s * t_s / radius_m)
        own = OwnMotion(Place(*placed(way_m, 0.0)), (speed_m_s, 0.0))
        reports = [ship(float(t_s), way_m) for ship in ships] if t_s % every_s == 0 else []
        state, texts = look(state, float(t_s), *reports, own=own)
        log += [(t_s, text) for text in texts]
    return state, log


def keeping(mmsi, off_m, speed_m_s=0.5):
    """A vessel that stays so far north of the boat, give or take what two receivers differ by."""
    return lambda t_s, way_m: position(mmsi, t_s, way_m + off_m + 8.0 * math.sin(t_s), 5.0, speed_m_s, 0.0)


@pytest.mark.parametrize(("seconds", "radius_m", "latest_s"), [(900.0, math.inf, 140.0), (3000.0, 60.0, 3000.0)])
def test_the_own_echo_is_reported_once_and_is_not_near(seconds, radius_m, latest_s):
    state, log = sail_north(seconds, keeping(235000007, 0.0), radius_m=radius_m)
    assert [text for _, text in log][1:] == ["MMSI 235000007: own echo, ignored"]
    assert log[1][0] < latest_s
    assert not state.near
    (echo,) = state.vessels
    assert (echo.own, echo.is_avoidable) == (True, False)


@pytest.mark.parametrize("off_m", [60.0, 80.0, -150.0])
def test_an_escort_is_not_an_echo(off_m):
    state, log = sail_north(3000.0, keeping(244000123, off_m))
    assert state.vessels[0].is_avoidable
    assert not any("echo" in text for _, text in log)


def test_a_mark_at_the_loiter_point_is_not_an_echo():
    def mark(t_s, _way_m):
        return position(992351001, t_s, 0.0, 5.0, 0.0, kind=VesselKind.MARK)

    state, log = sail_north(3000.0, mark, radius_m=30.0)
    assert state.near
    assert len(log) == 1


def test_an_echo_that_goes_elsewhere_is_a_vessel_again():
    state, _ = sail_north(900.0, keeping(235000007, 0.0))
    own = OwnMotion(Place(*placed(450.0, 0.0)), (0.5, 0.0))
    for t_s in (902.0, 912.0, 922.0):  # believed at the third
        state, _ = look(state, t_s, position(235000007, t_s, 3000.0, 0.0, 5.0), own=own)
    state, _ = look(state, 930.0, own=own)
    assert state.vessels[0].is_avoidable
    assert state.near


def test_an_escort_alongside_is_near_but_not_avoided():
    state, log = sail_north(90.0, keeping(244000123, 0.0))
    (vessel,) = state.vessels
    assert (vessel.own, vessel.near_s is not None, vessel.is_avoidable) == (False, True, False)
    assert len(log) == 1


BEACON = 972603802


def beacon(t_s, mmsi=BEACON, north_m=400.0, status=14):
    return VesselPosition(t_s, mmsi, VesselKind.CLASS_A, *placed(north_m, 0.0), 0.2, 1.5, status=status)


@pytest.mark.parametrize(
    ("mmsi", "status"), [(970123456, 15), (972603802, 14), (974001001, 0), (211000001, 14), (970123456, 14)]
)
@pytest.mark.parametrize("distance_m", [20.0, 400.0, 3000.0, 30000.0])
def test_a_distress_beacon_is_reported_at_once_and_is_no_vessel_to_avoid(mmsi, status, distance_m):
    state, events = traffic.update(SETTINGS, TrafficState(), [beacon(0.0, mmsi, distance_m, status)], HERE, 0.0)
    (event,) = events
    assert event.severity is Severity.CRITICAL
    found = re.fullmatch(rf"Distress beacon {mmsi:09d}: (\d+) m, bearing (000|360) deg", event.text)
    assert float(found[1]) == pytest.approx(distance_m, rel=1e-3)
    for t_s in range(1, 600):
        state, texts = look(state, float(t_s), beacon(float(t_s), mmsi, distance_m, status))
        assert texts == []
    assert not state.near
    assert not state.vessels[0].is_avoidable
    assert state.vessels[0].title == f"Distress beacon {mmsi:09d}"
    assert look(state, 602.0, beacon(602.0, mmsi, distance_m, status))[1]  # repeated after ten minutes


def test_a_beacon_is_reported_just_after_a_ship_and_several_one_after_the_other():
    state, texts = look(TrafficState(), 0.0, position(1, 0.0, 3000.0, 0.0))
    assert len(texts) == 1
    state, texts = look(state, 2.0, beacon(2.0), beacon(2.0, 972000002, 800.0))
    assert [text[:25] for text in texts] == ["Distress beacon 972603802"]
    assert [text[:25] for text in look(state, 4.0)[1]] == ["Distress beacon 972000002"]


def test_a_beacon_is_reported_without_positions():
    state, texts = look(TrafficState(), 0.0, VesselIdentity(0.0, BEACON), own=None)
    assert texts == [f"Distress beacon {BEACON}: no position yet"]
    for t_s in range(1, 600):
        state, texts = look(state, float(t_s), VesselIdentity(float(t_s), BEACON), own=None)
        assert texts == []
    state, texts = look(state, 600.0, beacon(600.0), own=None)
    latitude_deg, longitude_deg = (math.degrees(angle) for angle in placed(400.0, 0.0))
    assert texts == [f"Distress beacon {BEACON}: at {latitude_deg:.4f}, {longitude_deg:.4f}"]


@pytest.mark.parametrize("fix_s", [1, 4, 14, 300])
def test_a_beacon_gets_its_bearing_with_the_first_fix(fix_s):
    state, texts = look(TrafficState(), 0.0, beacon(0.0), own=None)
    assert len(texts) == 1
    log = []
    for t_s in range(1, 400):
        state, texts = look(state, float(t_s), beacon(float(t_s)), own=HERE if t_s >= fix_s else None)
        log += [(t_s, text) for text in texts]
    ((when_s, text),) = log
    assert fix_s <= when_s <= fix_s + 2
    assert re.fullmatch(rf"Distress beacon {BEACON}: 400 m, bearing (000|360) deg", text)


def test_a_full_table_has_room_for_a_beacon():
    near = [position(number, 0.0, 100.0, 0.0) for number in range(1, MAX_VESSELS + 1)]
    state, _ = look(TrafficState(), 0.0, *near)
    assert look(state, 2.0, beacon(2.0, north_m=9000.0))[1][0].startswith("Distress beacon")
