"""Vessel avoidance: choice of the heading, fence, and return to the course."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.common.vessels import Vessel, VesselKind, VesselPosition
from firmware_py.guidance import step_aside
from firmware_py.guidance.step_aside import IDLE, AsideInput, AsideSettings, LineAhead
from firmware_py.guidance.tasks import VesselMotion
from firmware_py.guidance.traffic import TrafficSettings
from firmware_py.modes import HeadingGoal
from support.plans import item, placed

PARAMETERS = ParameterSet().replaced("AIS_ACT", 1.0)
SETTINGS, TRAFFIC = AsideSettings.of(PARAMETERS), TrafficSettings.of(PARAMETERS)
MOTION = VesselMotion(Place(*placed(0.0, 0.0)), 0.0, 0.4, 0.0, 0.0)
INCLUDED_VERTEX, EXCLUDED_CIRCLE = 5001, 5004


def ship(north_m, east_m, speed_m_s=6.0, course_deg=180.0, near_s=0.0, in_s=900.0):
    position = VesselPosition(0.0, 1, VesselKind.CLASS_A, *placed(north_m, east_m), speed_m_s, math.radians(course_deg))
    return Vessel(position, cpa_m=0.0, cpa_in_s=in_s, near_s=near_s)


def inputs(*vessels, t_s=0.0, unchanged_rad=0.0, motion=MOTION, fence=None, goal=HeadingGoal(0.0), line=None):  # noqa: B008 - frozen
    return AsideInput(t_s, unchanged_rad, motion, vessels, fence, goal, None, line)


def decided(*vessels, state=IDLE, **more):
    """Run ticks until a round of trials has ended; return the state and the texts."""
    texts = []
    for tick in range(20):
        state, events = step_aside.update(SETTINGS, TRAFFIC, state, inputs(*vessels, **{"t_s": 0.1 * tick, **more}))
        texts += [event.text for event in events]
    return state, texts


def fenced(east_m):
    corners = [(-2000.0, -2000.0), (4000.0, -2000.0), (4000.0, east_m), (-2000.0, east_m)]
    items = [item(INCLUDED_VERTEX, *corner, len(corners)) for corner in corners]
    return Plan.of(PlanKind.FENCE, items)


@pytest.mark.parametrize(("east_m", "heading_deg"), [(-50.0, 60.0), (0.0, 60.0), (50.0, 300.0)])
def test_a_ship_ahead_is_passed_on_its_side_at_the_limit_of_the_sector(east_m, heading_deg):
    state, texts = decided(ship(6000.0, east_m))
    assert math.degrees(state.heading_rad) == pytest.approx(heading_deg)
    (text,) = texts
    if east_m == -50.0:
        assert text == "Avoidance: heading 60 deg, closest 384 m instead of 50 m"


def test_the_heading_stays_within_the_sector():
    for way_deg in range(0, 360, 30):
        state, _ = decided(ship(3000.0, 4000.0, 6.0, 230.0), unchanged_rad=math.radians(way_deg))
        if state.heading_rad is not None:
            off = (math.degrees(state.heading_rad) - way_deg + 180.0) % 360.0 - 180.0
            assert abs(off) <= 60.0 + 1e-6


def test_a_fence_forces_the_other_side():
    free, _ = decided(ship(6000.0, -50.0), fence=fenced(3000.0))
    assert math.degrees(free.heading_rad) == pytest.approx(60.0)
    for others in ((), (ship(6000.0, -60.0, in_s=0.0),)):  # the track is checked until the last vessel has passed
        state, _ = decided(ship(6000.0, -50.0), *others, fence=fenced(200.0))
        assert math.degrees(state.heading_rad) > 180.0


def test_no_better_heading_is_reported_once():
    corners = [(-2000.0, -60.0), (9000.0, -60.0), (9000.0, 60.0), (-2000.0, 60.0)]
    lane = Plan.of(PlanKind.FENCE, [item(INCLUDED_VERTEX, *corner, 4) for corner in corners])
    state, texts = decided(ship(6000.0, 0.0), fence=lane)
    assert state.heading_rad is None
    assert texts == ["Avoidance: no better heading, course kept"]
    state, texts = decided(ship(6000.0, 0.0), fence=lane, state=state, t_s=40.0)
    assert texts == []


def test_a_current_is_taken_into_account():
    set_east = VesselMotion(MOTION.place, 0.0, 0.4, 0.0, 0.3)
    state, _ = decided(ship(6000.0, 330.0, 6.0), motion=set_east)
    # On the unchanged course the current would carry the boat in front of the ship, 330 m to the east by now.
    assert math.degrees(state.heading_rad) > 180.0


def test_on_a_line_the_unchanged_course_is_over_ground():
    set_east = VesselMotion(MOTION.place, 0.0, 0.4, 0.0, 0.2)
    crab_rad = -math.asin(0.5)
    # 250 m beside the line: the heading of the line would lead to the ship.
    state, _ = decided(
        ship(435.0, 250.0, 0.0), motion=set_east, unchanged_rad=crab_rad, goal=None, line=LineAhead(0.0, 0.0, crab_rad)
    )
    assert state.heading_rad is None


@pytest.mark.parametrize("set_m_s", [0.0, 0.2, -0.2])
def test_abeam_of_a_ship_at_anchor_the_boat_follows_its_line(set_m_s):
    abeam, away_rad, along_rad = ship(20.0, -250.0, 0.0), math.radians(60.0), -math.asin(set_m_s / 0.4)
    motion = VesselMotion(MOTION.place, 0.0, 0.4, 0.0, set_m_s)
    line = {"unchanged_rad": math.radians(280.0), "line": LineAhead(250.0, 0.0, along_rad), "motion": motion}
    before = replace(IDLE, heading_rad=away_rad, way_rad=0.0, goal=HeadingGoal(0.0))
    state, texts = decided(abeam, state=before, **line)
    assert state.heading_rad == along_rad
    assert texts == []
    # The unchanged course would not be sufficient: the boat approaches its line as far as it is.
    state, _ = decided(ship(150.0, -150.0, 0.0), state=before, **line)
    assert math.radians(9.0) < state.heading_rad <= away_rad
    # Not yet sufficient: no change.
    state, _ = decided(ship(20.0, -190.0, 0.0), state=before, **line)
    assert state.heading_rad == away_rad


def test_the_sector_follows_a_turning_course():
    state, _ = decided(ship(0.0, 90.0, 0.0), unchanged_rad=math.radians(90.0))
    assert math.degrees(state.heading_rad) < 90.0 + 60.0
    for way_deg in (120.0, 150.0, 180.0, 210.0):
        way_rad, t_s = math.radians(way_deg), way_deg
        ahead = ship(300.0 * math.cos(way_rad), 300.0 * math.sin(way_rad), 0.0)
        state, _ = decided(ahead, state=state, unchanged_rad=way_rad, t_s=t_s)
        assert math.degrees(state.way_rad) == pytest.approx(way_deg)
        assert abs(math.degrees(state.heading_rad) - way_deg) <= 60.0 + 1e-6


def test_of_several_vessels_the_closest_approach_counts():
    state, _ = decided(ship(6000.0, -50.0), ship(6000.0, 450.0))
    aside_deg = math.degrees(state.heading_rad)
    assert aside_deg > 180.0  # the second vessel passes to starboard


def test_avoidance_ends_when_the_vessel_is_clear_or_gone():
    state, _ = decided(ship(6000.0, -50.0))
    back, texts = decided(ship(6000.0, -2000.0), state=state, t_s=40.0)
    assert back.heading_rad is None
    assert texts == ["Avoidance ended: back on course"]
    ended, events = step_aside.end(state)
    assert ended is IDLE
    assert [event.text for event in events] == ["Avoidance ended: back on course"]
    assert step_aside.end(replace(state, heading_rad=None)) == (IDLE, ())
    assert step_aside.end(IDLE) == (IDLE, ())


def test_rounds_start_every_half_minute_or_with_another_goal():
    vessel = ship(6000.0, -50.0)
    state, _ = decided(vessel, t_s=100.0)
    for tenths in range(300):
        assert step_aside.update(
            SETTINGS, TRAFFIC, state, inputs(vessel, t_s=100.0 + 0.1 * tenths, unchanged_rad=-1.2)
        ) == (state, ())
    later, _ = step_aside.update(SETTINGS, TRAFFIC, state, inputs(vessel, t_s=130.0, unchanged_rad=-1.2))
    assert (later.next_trial, later.way_rad) == (0, -1.2)
    other = {"t_s": 103.0, "unchanged_rad": -1.2, "goal": HeadingGoal(-1.2)}
    turned, _ = decided(vessel, state=state, **other)
    assert abs(math.remainder(turned.heading_rad + 1.2, 2.0 * math.pi)) <= SETTINGS.sector_rad + 1e-6
    assert step_aside.update(SETTINGS, TRAFFIC, turned, inputs(vessel, **other)) == (turned, ())


def test_reported_distances_are_those_at_the_end_of_the_round():
    def cpa_m(tick_s):
        state = IDLE
        for tick in range(20):
            state, events = step_aside.update(
                SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0, in_s=0.0), t_s=tick_s * tick)
            )
            if events:
                return float(events[0].text.split()[-6])
        return None

    assert cpa_m(0.1) == 384.0
    assert cpa_m(5.0) == pytest.approx(50.0 + (384.0 - 50.0) * (1000.0 - 5.0 * 14) / 1000.0, abs=3.0)


@pytest.mark.parametrize("out", [0.5, 1.5, 3.5])
def test_the_fence_is_checked_between_two_places(out):
    """A small circle on the track of 60 degrees; the ends of its four legs are far enough from it."""
    radius_m, out_m = 15.0, out * 0.25 * 0.4 * 960.0
    centre = out_m * math.cos(math.radians(60.0)), out_m * math.sin(math.radians(60.0))
    fence = Plan.of(PlanKind.FENCE, [item(EXCLUDED_CIRCLE, *centre, radius_m)])
    state, _ = decided(ship(6000.0, -50.0), fence=fence)
    off_rad = math.pi if state.heading_rad is None else state.heading_rad - math.radians(60.0)
    assert math.cos(off_rad) < 0.0 or abs(out_m * math.sin(off_rad)) >= radius_m + 30.0


def test_a_goal_that_changes_at_each_tick_does_not_prevent_a_decision():
    state = IDLE
    for tick in range(60):
        goal = HeadingGoal(0.001 * tick)
        state, _ = step_aside.update(
            SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0), t_s=0.1 * tick, unchanged_rad=0.001 * tick, goal=goal)
        )
    assert state.heading_rad is not None


def test_a_tick_tries_one_heading(monkeypatch):
    counts = []
    trial = step_aside._trial
    monkeypatch.setattr(step_aside, "_trial", lambda *args: counts.append(1) or trial(*args))
    state = IDLE
    for tick in range(40):
        before = len(counts)
        state, _ = step_aside.update(SETTINGS, TRAFFIC, state, inputs(ship(6000.0, -50.0), t_s=0.1 * tick))
        assert len(counts) - before <= 3


def test_an_escort_does_not_hide_a_ship():
    """The escort keeps its relative position on any heading, so that headings are chosen by the ship."""
    escort = replace(ship(80.0, 0.0, 0.4, 0.0, in_s=0.0), near_s=0.0)
    alone, texts_alone = decided(ship(6000.0, -50.0))
    state, texts = decided(ship(6000.0, -50.0), escort)
    assert math.degrees(state.heading_rad) == pytest.approx(math.degrees(alone.heading_rad))
    assert texts == texts_alone


def test_an_escort_alone_causes_no_avoidance():
    for north_m, east_m in ((80.0, 0.0), (-80.0, 0.0), (0.0, 80.0), (0.0, -5.0)):
        assert decided(ship(north_m, east_m, 0.4, 0.0))[0].heading_rad is None


def test_an_escort_that_would_be_run_down_still_counts():
    state, _ = decided(ship(80.0, 0.0, 0.0, 0.0))
    assert state.heading_rad is not None
