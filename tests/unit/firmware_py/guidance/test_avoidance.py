"""Vessel avoidance: choice of the heading, fence, and return to the course."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.common.vessels import Vessel, VesselKind, VesselPosition
from firmware_py.guidance import avoidance
from firmware_py.guidance.avoidance import IDLE, AvoidanceInput, AvoidanceSettings, LineAhead, Trial
from firmware_py.guidance.tasks import VesselMotion
from firmware_py.guidance.traffic import TrafficSettings
from firmware_py.modes import HeadingGoal
from support.plans import item, placed

PARAMETERS = ParameterSet().replaced("AIS_ACT", 1.0)
SETTINGS, TRAFFIC = AvoidanceSettings.of(PARAMETERS), TrafficSettings.of(PARAMETERS)
MOTION = VesselMotion(Place(*placed(0.0, 0.0)), 0.0, 0.4, 0.0, 0.0)
INCLUDED_VERTEX, EXCLUDED_CIRCLE = 5001, 5004


def ship(north_m, east_m, speed_m_s=6.0, course_deg=180.0, near_s=0.0, cpa_in_s=900.0):
    position = VesselPosition(0.0, 1, VesselKind.CLASS_A, *placed(north_m, east_m), speed_m_s, math.radians(course_deg))
    return Vessel(position, cpa_m=0.0, cpa_in_s=cpa_in_s, near_s=near_s)


def inputs(*vessels, t_s=0.0, unchanged_rad=0.0, motion=MOTION, fence=None, goal=HeadingGoal(0.0), line=None):  # noqa: B008 - frozen
    return AvoidanceInput(t_s, unchanged_rad, motion, vessels, fence, goal, None, line)


def run_round(*vessels, state=IDLE, **changes):
    """Run ticks until a round of trials has ended; return the state and the texts."""
    texts = []
    for tick in range(20):
        state, events = avoidance.update(SETTINGS, TRAFFIC, state, inputs(*vessels, **{"t_s": 0.1 * tick, **changes}))
        texts += [event.text for event in events]
    return state, texts


def fence_to(east_m):
    corners = [(-2000.0, -2000.0), (4000.0, -2000.0), (4000.0, east_m), (-2000.0, east_m)]
    items = [item(INCLUDED_VERTEX, *corner, len(corners)) for corner in corners]
    return Plan.of(PlanKind.FENCE, items)


@pytest.mark.parametrize(("east_m", "heading_deg"), [(-50.0, 60.0), (0.0, 60.0), (50.0, 300.0)])
def test_heading_for_a_ship_ahead_is_at_the_limit_of_the_sector(east_m, heading_deg):
    state, texts = run_round(ship(6000.0, east_m))
    assert math.degrees(state.heading_rad) == pytest.approx(heading_deg)
    (text,) = texts
    if east_m == -50.0:
        assert text == "Avoidance: heading 60 deg, closest 384 m instead of 50 m"


def test_heading_near_a_fence_is_to_the_other_side():
    free, _ = run_round(ship(6000.0, -50.0), fence=fence_to(3000.0))
    assert math.degrees(free.heading_rad) == pytest.approx(60.0)
    for others in ((), (ship(6000.0, -60.0, cpa_in_s=0.0),)):  # the track is checked until the last vessel has passed
        state, _ = run_round(ship(6000.0, -50.0), *others, fence=fence_to(200.0))
        assert math.degrees(state.heading_rad) > 180.0


@pytest.mark.parametrize(("near_s", "cpa_in_s"), [(None, 900.0), (0.0, None), (0.0, 0.0)])
@pytest.mark.parametrize(("east_m", "is_clear"), [(51.25, True), (51.15, False)])
def test_track_of_a_minute_stays_30_m_clear_of_the_fence(east_m, is_clear, near_s, cpa_in_s):
    """On 60 deg the boat is 20.8 m nearer to the fence after 60 s; the last leg is 6 m long."""
    state, _ = run_round(ship(6000.0, -50.0, near_s=near_s, cpa_in_s=cpa_in_s), fence=fence_to(east_m))
    assert (math.degrees(state.heading_rad) == pytest.approx(60.0)) is is_clear


def test_no_better_heading_is_reported_once():
    corners = [(-2000.0, -60.0), (9000.0, -60.0), (9000.0, 60.0), (-2000.0, 60.0)]
    lane = Plan.of(PlanKind.FENCE, [item(INCLUDED_VERTEX, *corner, 4) for corner in corners])
    state, texts = run_round(ship(6000.0, 0.0), fence=lane)
    assert state.heading_rad is None
    assert texts == ["Avoidance: no better heading, course kept"]
    state, texts = run_round(ship(6000.0, 0.0), fence=lane, state=state, t_s=40.0)
    assert texts == []


@pytest.mark.parametrize("current_m_s", [0.0, 0.2, -0.2])
def test_boat_abeam_of_a_ship_at_anchor_returns_to_its_line(current_m_s):
    abeam, away_rad, along_rad = ship(20.0, -250.0, 0.0), math.radians(60.0), -math.asin(current_m_s / 0.4)
    motion = VesselMotion(MOTION.place, 0.0, 0.4, 0.0, current_m_s)
    line = {"unchanged_rad": math.radians(280.0), "line": LineAhead(250.0, 0.0, along_rad), "motion": motion}
    avoiding = replace(IDLE, heading_rad=away_rad, way_rad=0.0, goal=HeadingGoal(0.0))
    state, texts = run_round(abeam, state=avoiding, **line)
    assert state.heading_rad == along_rad
    assert texts == []
    # The unchanged course is not sufficient: the boat approaches its line as far as a sufficient heading allows.
    state, _ = run_round(ship(150.0, -150.0, 0.0), state=avoiding, **line)
    assert math.radians(9.0) < state.heading_rad <= away_rad
    # Not yet sufficient: no change.
    state, _ = run_round(ship(20.0, -190.0, 0.0), state=avoiding, **line)
    assert state.heading_rad == away_rad


def test_sector_follows_a_turning_course():
    state, _ = run_round(ship(0.0, 90.0, 0.0), unchanged_rad=math.radians(90.0))
    assert math.degrees(state.heading_rad) < 90.0 + 60.0
    for way_deg in (120.0, 150.0, 180.0, 210.0):
        way_rad, t_s = math.radians(way_deg), way_deg
        ahead = ship(300.0 * math.cos(way_rad), 300.0 * math.sin(way_rad), 0.0)
        state, _ = run_round(ahead, state=state, unchanged_rad=way_rad, t_s=t_s)
        assert math.degrees(state.way_rad) == pytest.approx(way_deg)
        assert abs(math.degrees(state.heading_rad) - way_deg) <= 60.0 + 1e-6


def test_avoidance_ends_when_the_vessel_is_clear_or_removed():
    state, _ = run_round(ship(6000.0, -50.0))
    returned, texts = run_round(ship(6000.0, -2000.0), state=state, t_s=40.0)
    assert returned.heading_rad is None
    assert texts == ["Avoidance ended: back on course"]
    ended, events = avoidance.end(state)
    assert ended is IDLE
    assert [event.text for event in events] == ["Avoidance ended: back on course"]
    assert avoidance.end(replace(state, heading_rad=None)) == (IDLE, ())
    assert avoidance.end(IDLE) == (IDLE, ())


def test_rounds_start_every_half_minute_or_with_another_goal():
    vessel = ship(6000.0, -50.0)
    state, _ = run_round(vessel, t_s=100.0)
    for tenths in range(300):
        assert avoidance.update(
            SETTINGS, TRAFFIC, state, inputs(vessel, t_s=100.0 + 0.1 * tenths, unchanged_rad=-1.2)
        ) == (state, ())
    later, _ = avoidance.update(SETTINGS, TRAFFIC, state, inputs(vessel, t_s=130.0, unchanged_rad=-1.2))
    assert (later.next_trial, later.way_rad) == (0, -1.2)
    other = {"t_s": 103.0, "unchanged_rad": -1.2, "goal": HeadingGoal(-1.2)}
    turned, _ = run_round(vessel, state=state, **other)
    assert abs(math.remainder(turned.heading_rad + 1.2, 2.0 * math.pi)) <= SETTINGS.sector_rad + 1e-6
    assert avoidance.update(SETTINGS, TRAFFIC, turned, inputs(vessel, **other)) == (turned, ())


def test_reported_distances_are_those_at_the_end_of_the_round():
    def cpa_m(tick_s):
        state = IDLE
        for tick in range(20):
            state, events = avoidance.update(
                SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0, cpa_in_s=0.0), t_s=tick_s * tick)
            )
            if events:
                return float(events[0].text.split()[-6])
        return None

    assert cpa_m(0.1) == 384.0
    # The ship is ahead at 1000 s; the round of 14 ticks leaves less time to move aside.
    assert cpa_m(5.0) == pytest.approx(50.0 + (384.0 - 50.0) * (1000.0 - 5.0 * 14) / 1000.0, abs=3.0)


@pytest.mark.parametrize("legs", [0.5, 1.5, 3.5])
def test_fence_is_checked_between_the_ends_of_a_leg(legs):
    """A small circle is on the track of 60 degrees; its distance from the ends of the four legs is sufficient.

    The track is that of 960 s at 0.4 m/s: a minute longer than to the closest approach.
    """
    radius_m, distance_m = 15.0, legs * 0.25 * 0.4 * 960.0
    centre = distance_m * math.cos(math.radians(60.0)), distance_m * math.sin(math.radians(60.0))
    fence = Plan.of(PlanKind.FENCE, [item(EXCLUDED_CIRCLE, *centre, radius_m)])
    state, _ = run_round(ship(6000.0, -50.0), fence=fence)
    off_rad = math.pi if state.heading_rad is None else state.heading_rad - math.radians(60.0)
    assert math.cos(off_rad) < 0.0 or abs(distance_m * math.sin(off_rad)) >= radius_m + 30.0


def test_goal_that_changes_in_each_tick_does_not_prevent_a_decision():
    state = IDLE
    for tick in range(60):
        goal = HeadingGoal(0.001 * tick)
        state, _ = avoidance.update(
            SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0), t_s=0.1 * tick, unchanged_rad=0.001 * tick, goal=goal)
        )
    assert state.heading_rad is not None


@pytest.mark.parametrize(
    ("best_ratio", "best_rad", "ratio", "heading_rad", "is_better"),
    [
        (1.9, 0.3, 1.97, 0.6, True),
        (1.9, 0.3, 1.95, 0.6, False),
        (2.0, 0.3, 3.0, 0.6, False),  # the best heading is sufficient
        (2.0, 0.6, 3.0, 0.3, True),
        (2.0, 0.6, 3.0, -0.3, False),  # on the other side
        (2.0, 0.6, 2.05, 0.3, False),
    ],
)
def test_better_heading_is_clearly_better_or_sufficient_and_nearer_to_the_course(
    best_ratio, best_rad, ratio, heading_rad, is_better
):
    best, trial = Trial(best_rad, 100.0, best_ratio), Trial(heading_rad, 100.0, ratio)
    assert avoidance._is_better(best, trial, 0.0) is is_better


def test_tick_tries_at_most_three_headings(monkeypatch):
    counts = []
    try_heading = avoidance._try_heading
    monkeypatch.setattr(avoidance, "_try_heading", lambda *args: counts.append(1) or try_heading(*args))
    state = IDLE
    for tick in range(40):
        former_count = len(counts)
        state, _ = avoidance.update(SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0), t_s=0.1 * tick))
        assert len(counts) - former_count <= 3


def test_escort_does_not_hide_a_ship():
    """The distance to the escort is the same on any heading, so the ship decides."""
    escort = replace(ship(80.0, 0.0, 0.4, 0.0, cpa_in_s=0.0), near_s=0.0)
    alone, texts_alone = run_round(ship(6000.0, -50.0))
    state, texts = run_round(ship(6000.0, -50.0), escort)
    assert math.degrees(state.heading_rad) == pytest.approx(math.degrees(alone.heading_rad))
    assert texts == texts_alone


def test_escort_alone_causes_no_avoidance():
    for north_m, east_m in ((80.0, 0.0), (-80.0, 0.0), (0.0, 80.0), (0.0, -5.0)):
        assert run_round(ship(north_m, east_m, 0.4, 0.0))[0].heading_rad is None


def test_vessel_ahead_with_the_same_position_but_no_speed_is_avoided():
    state, _ = run_round(ship(80.0, 0.0, 0.0, 0.0))
    assert state.heading_rad is not None
