"""Choice of the avoidance heading, compared with an independent computation of all headings on a plane."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
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
HEADINGS_PER_SIDE, ROUND_INTERVAL_S, MIN_GAIN, SUFFICIENT_RATIO = 6, 30.0, 0.06, 2.0
FENCE_CLEARANCE_M, FENCE_CHECK_LEGS = 30.0, 4
STEP_RAD = SETTINGS.sector_rad / HEADINGS_PER_SIDE
INCLUDED_VERTEX = 5001
TOLERANCE = 0.01  # of the near distance: the earth is no plane
ROUND_TICKS = 2 * HEADINGS_PER_SIDE + 4

HEADINGS = st.floats(-math.pi, math.pi)


@st.composite
def vessels(draw, max_cpa_m=500.0):
    """A vessel that passes near the boat, as (north [m], east [m], north [m/s], east [m/s]) and as a record."""
    in_s, speed_m_s, course_rad = draw(st.floats(0.0, 1500.0)), draw(st.sampled_from([0.0, 2.0, 6.0])), draw(HEADINGS)
    passing_m = [draw(st.floats(-max_cpa_m, max_cpa_m)) for _ in "ne"]
    velocity = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
    north_m, east_m = (place - in_s * speed for place, speed in zip(passing_m, velocity, strict=True))
    position = VesselPosition(0.0, 1, VesselKind.CLASS_A, *placed(north_m, east_m), speed_m_s, course_rad)
    near_s, cpa_in_s = draw(st.sampled_from([None, 0.0])), draw(st.sampled_from([None, in_s]))
    return (north_m, east_m, *velocity), Vessel(position, cpa_m=0.0, cpa_in_s=cpa_in_s, near_s=near_s)


MOTIONS = st.builds(
    VesselMotion,
    place=st.just(Place(*placed(0.0, 0.0))),
    heading_rad=st.just(0.0),
    speed_m_s=st.floats(0.2, 0.8),
    current_north_m_s=st.floats(-0.2, 0.2),
    current_east_m_s=st.floats(-0.2, 0.2),
    leeway_rad=st.floats(-0.3, 0.3),
)
# Distances of the fence to the north, east, south and west, in metres.
SIDES = st.tuples(*[st.floats(40.0, 1500.0)] * 4)


class Plane:
    """Prediction for all vessels on a heading."""

    def __init__(self, vessels, motion, sides):
        self.vessels, self.motion, self.sides = vessels, motion, sides
        cpa_times_s = [vessel.cpa_in_s or 0.0 for _, vessel in vessels if vessel.near_s is not None]
        self.duration_s = max(cpa_times_s, default=0.0) + 2.0 * ROUND_INTERVAL_S

    def velocity(self, heading_rad):
        motion, way_rad = self.motion, heading_rad + self.motion.leeway_rad
        north_m_s = motion.current_north_m_s + motion.speed_m_s * math.cos(way_rad)
        return north_m_s, motion.current_east_m_s + motion.speed_m_s * math.sin(way_rad)

    def ratio(self, heading_rad, start=(0.0, 0.0)):
        """Return the closest approach of the nearest vessel, relative to the near distance and in metres.

        A vessel that does not come nearer is used only without other vessels.
        """
        own = self.velocity(heading_rad)
        relevant, irrelevant = [], []
        for (north_m, east_m, *velocity), vessel in self.vessels:
            x, y = north_m - start[0], east_m - start[1]
            u, v = velocity[0] - own[0], velocity[1] - own[1]
            t_s = min(max(-(x * u + y * v) / (u * u + v * v), 0.0), TRAFFIC.horizon_s) if u or v else 0.0
            cpa_m = math.hypot(x + t_s * u, y + t_s * v)
            limit_m = TRAFFIC.limit_m(vessel.position)
            loss = min(SUFFICIENT_RATIO, math.hypot(north_m, east_m) / limit_m) - cpa_m / limit_m
            assume(abs(loss - MIN_GAIN) > TOLERANCE)
            (relevant if loss > MIN_GAIN else irrelevant).append((cpa_m / limit_m, cpa_m))
        if relevant:
            return min(relevant)
        return max(SUFFICIENT_RATIO, min(irrelevant)[0]), min(irrelevant)[1]

    def fence(self):
        if self.sides is None:
            return None
        north_m, east_m, south_m, west_m = self.sides
        corners = [(north_m, east_m), (-south_m, east_m), (-south_m, -west_m), (north_m, -west_m)]
        return Plan.of(PlanKind.FENCE, [item(INCLUDED_VERTEX, *corner, 4) for corner in corners])

    def fence_margin_m(self, heading_rad):
        """Return the smallest margin of the fence on the track, and the length of a leg."""
        if self.sides is None:
            return math.inf, 0.0
        north_m, east_m = (self.duration_s * speed_m_s for speed_m_s in self.velocity(heading_rad))
        margins_m = [side - way for side, way in zip(self.sides, (north_m, east_m, -north_m, -east_m), strict=True)]
        return min(*margins_m, *self.sides), math.hypot(north_m, east_m) / FENCE_CHECK_LEGS

    def may_be_clear(self, heading_rad):
        return self.fence_margin_m(heading_rad)[0] >= FENCE_CLEARANCE_M - 1.0

    def must_be_clear(self, heading_rad):
        margin_m, leg_m = self.fence_margin_m(heading_rad)
        return margin_m >= FENCE_CLEARANCE_M + 0.5 * leg_m + 1.0

    def first_sufficient(self, headings):
        """Return the first heading that is sufficient and clear of the fence; None without one, or if uncertain."""
        for heading_rad in headings:
            ratio, _ = self.ratio(heading_rad)
            if ratio > SUFFICIENT_RATIO - TOLERANCE and self.may_be_clear(heading_rad):
                is_certain = ratio > SUFFICIENT_RATIO + TOLERANCE and self.must_be_clear(heading_rad)
                return heading_rad if is_certain else None
        return None


def run_round(inputs, state=IDLE):
    """Run a round with constant inputs; return the state and the texts."""
    texts = []
    for _ in range(ROUND_TICKS):
        state, events = avoidance.update(SETTINGS, TRAFFIC, state, inputs)
        texts += [event.text for event in events]
    return state, texts


def deviation_rad(heading_rad, way_rad):
    return math.remainder(heading_rad - way_rad, 2.0 * math.pi)


def fan(way_rad):
    return [way_rad + side * step * STEP_RAD for step in range(1, HEADINGS_PER_SIDE + 1) for side in (1, -1)]


def avoidance_input(plane, unchanged_rad, line=None):
    records = tuple(vessel for _, vessel in plane.vessels)
    return AvoidanceInput(0.0, unchanged_rad, plane.motion, records, plane.fence(), HeadingGoal(0.0), None, line)


LINES = st.none() | st.tuples(st.floats(-300.0, 300.0), HEADINGS, st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
WORLDS = st.tuples(st.lists(vessels(), min_size=1, max_size=3), MOTIONS, st.none() | SIDES)


@given(WORLDS, HEADINGS, LINES)
def test_nearest_sufficient_heading_or_the_best_one_is_chosen(world, unchanged_rad, line):
    plane, line_ahead, way_rad, along_rad = Plane(*world), None, unchanged_rad, unchanged_rad
    own, own_m = plane.ratio(unchanged_rad)
    if line is not None:
        cross_track_m, way_rad, crab_rad, back_rad = line
        along_rad, unchanged_rad = way_rad + crab_rad, way_rad + back_rad
        line_ahead = LineAhead(cross_track_m, way_rad, along_rad)
        foot = cross_track_m * math.sin(way_rad), -cross_track_m * math.cos(way_rad)
        own, own_m = min(plane.ratio(unchanged_rad), plane.ratio(along_rad), plane.ratio(along_rad, foot))
    state, texts = run_round(avoidance_input(plane, unchanged_rad, line_ahead))
    best_certain = max(
        [plane.ratio(heading)[0] for heading in fan(way_rad) if plane.must_be_clear(heading)], default=0.0
    )
    if state.heading_rad is None:
        assert own > SUFFICIENT_RATIO - TOLERANCE or best_certain < own + 2.0 * MIN_GAIN + TOLERANCE
        if abs(own - 1.0) > TOLERANCE:
            assert texts == ([] if own > 1.0 else ["Avoidance: no better heading, course kept"])
        return
    ratio, cpa_m = plane.ratio(state.heading_rad)
    change_rad = deviation_rad(state.heading_rad, way_rad)
    assert abs(change_rad / STEP_RAD - round(change_rad / STEP_RAD)) < 1e-6
    assert abs(change_rad) < SETTINGS.sector_rad + 1e-6
    assert plane.may_be_clear(state.heading_rad)
    assert own < SUFFICIENT_RATIO + TOLERANCE
    assert ratio > own + MIN_GAIN - TOLERANCE
    assert ratio > min(best_certain, SUFFICIENT_RATIO) - MIN_GAIN - TOLERANCE
    first_rad = plane.first_sufficient(fan(way_rad))
    if first_rad is not None:
        assert abs(deviation_rad(state.heading_rad, along_rad)) < abs(deviation_rad(first_rad, along_rad)) + 1e-6
    reported_deg, reported_cpa_m, reported_own_m = (float(word) for word in texts[0].split() if word.isdigit())
    is_north = reported_deg in (0.0, 360.0)
    assert is_north or reported_deg % 360.0 == pytest.approx(math.degrees(state.heading_rad), abs=0.51)
    assert (reported_own_m, reported_cpa_m) == (pytest.approx(own_m, abs=3.0), pytest.approx(cpa_m, abs=3.0))
    assert len(texts) == 1


# Worlds with many sufficient headings.
WIDE_WORLDS = st.tuples(st.lists(vessels(900.0), min_size=1, max_size=2), MOTIONS, st.none() | SIDES)
DEVIATIONS = st.floats(-SETTINGS.sector_rad, SETTINGS.sector_rad) | st.floats(-2.5, 2.5)


@given(WORLDS | WIDE_WORLDS, HEADINGS, st.floats(-0.8, 0.8), DEVIATIONS, st.floats(0.0, 4.0), st.booleans())
def test_during_avoidance_the_heading_stays_approaches_the_course_or_returns(
    world, way_rad, crab_rad, change_rad, best_ratio, is_reported
):
    plane, steered_rad, along_rad = Plane(*world), way_rad + change_rad, way_rad + crab_rad
    line = LineAhead(0.0, way_rad, along_rad)
    own, _ = min(plane.ratio(along_rad), plane.ratio(way_rad))
    former_best = Trial(steered_rad, 100.0, best_ratio)
    former = replace(IDLE, heading_rad=steered_rad, way_rad=way_rad, best=former_best, is_refusal_reported=is_reported)
    state, texts = run_round(avoidance_input(plane, way_rad, line), former)
    is_in_sector = abs(change_rad) <= SETTINGS.sector_rad
    others = [along_rad, *fan(way_rad)]
    tried = [*([steered_rad] if is_in_sector else []), *others]
    best_certain = max([plane.ratio(heading)[0] for heading in tried if plane.must_be_clear(heading)], default=0.0)
    assert not state.is_refusal_reported
    if state.heading_rad is None:
        assert texts == ["Avoidance ended: back on course"]
        assert own > SUFFICIENT_RATIO - TOLERANCE or best_certain < own + 2.0 * MIN_GAIN + TOLERANCE
        return
    assert texts == []
    assert min(abs(deviation_rad(state.heading_rad, heading)) for heading in tried) < 1e-6
    assert plane.may_be_clear(state.heading_rad)
    ratio, _ = plane.ratio(state.heading_rad)
    assert own < SUFFICIENT_RATIO + TOLERANCE
    assert ratio > own + MIN_GAIN - TOLERANCE
    assert ratio > min(best_certain, SUFFICIENT_RATIO) - MIN_GAIN - TOLERANCE
    steered_ratio, steered_deviation = plane.ratio(steered_rad)[0], deviation_rad(steered_rad, along_rad)
    is_kept = abs(deviation_rad(state.heading_rad, steered_rad)) < 1e-6
    if is_in_sector and plane.must_be_clear(steered_rad) and steered_ratio > SUFFICIENT_RATIO + TOLERANCE:
        inward = [
            heading for heading in others if 0.0 <= deviation_rad(heading, along_rad) / steered_deviation < 1.0 - 1e-3
        ]
        min_ratio = SUFFICIENT_RATIO + MIN_GAIN + TOLERANCE
        sufficient = [
            heading for heading in inward if plane.ratio(heading)[0] > min_ratio and plane.must_be_clear(heading)
        ]
        assert not (is_kept and sufficient)
        assert is_kept or deviation_rad(state.heading_rad, along_rad) / steered_deviation < 1.0
        assert is_kept or deviation_rad(state.heading_rad, along_rad) / steered_deviation > -1e-6
        assert is_kept or ratio > SUFFICIENT_RATIO + MIN_GAIN - TOLERANCE
