"""The choice of a round of trials, against what a plane with straight ways says of every heading."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.common.vessels import Vessel, VesselKind, VesselPosition
from firmware_py.guidance import step_aside
from firmware_py.guidance.step_aside import (
    FENCE_CHECK_LEGS,
    FENCE_CLEARANCE_M,
    HEADINGS_PER_SIDE,
    IDLE,
    MIN_GAIN,
    ROUND_INTERVAL_S,
    SUFFICIENT_RATIO,
    AsideInput,
    AsideSettings,
    LineAhead,
    Trial,
)
from firmware_py.guidance.tasks import VesselMotion
from firmware_py.guidance.traffic import TrafficSettings
from firmware_py.modes import HeadingGoal
from support.plans import item, placed

PARAMETERS = ParameterSet().replaced("AIS_ACT", 1.0)
SETTINGS, TRAFFIC = AsideSettings.of(PARAMETERS), TrafficSettings.of(PARAMETERS)
STEP_RAD = SETTINGS.sector_rad / HEADINGS_PER_SIDE
INCLUDED_VERTEX = 5001
NEARLY = 0.01  # of what is near: the sphere is no plane
ROUND = 2 * HEADINGS_PER_SIDE + 4  # ticks that are enough for it

HEADINGS = st.floats(-math.pi, math.pi)


@st.composite
def vessels(draw, reach_m=500.0):
    """A vessel, at metres and m/s north and east, that passes a place near the boat after a while."""
    in_s, speed_m_s, course_rad = draw(st.floats(0.0, 1500.0)), draw(st.sampled_from([0.0, 2.0, 6.0])), draw(HEADINGS)
    beside = [draw(st.floats(-reach_m, reach_m)) for _ in "ne"]
    velocity = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
    north_m, east_m = (place - in_s * along for place, along in zip(beside, velocity, strict=True))
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
SIDES = st.tuples(*[st.floats(40.0, 1500.0)] * 4)  # metres to the north, east, south and west that a fence leaves


class Plane:
    """What comes of a heading, of all vessels."""

    def __init__(self, seen, motion, sides):
        self.seen, self.motion, self.sides = seen, motion, sides
        coming_s = [vessel.cpa_in_s for _, vessel in seen if vessel.near_s is not None and vessel.cpa_in_s is not None]
        self.ahead_s = max(coming_s, default=0.0) + 2.0 * ROUND_INTERVAL_S

    def velocity(self, heading_rad):
        motion, way_rad = self.motion, heading_rad + self.motion.leeway_rad
        north_m_s = motion.current_north_m_s + motion.speed_m_s * math.cos(way_rad)
        return north_m_s, motion.current_east_m_s + motion.speed_m_s * math.sin(way_rad)

    def ratio(self, heading_rad, begin=(0.0, 0.0)):
        """How near the nearest vessel comes, in parts of what is near, and in metres.

        One that is kept as far off as it is does not count beside others.
        """
        own = self.velocity(heading_rad)
        counted, uncounted = [], []
        for (north_m, east_m, *velocity), vessel in self.seen:
            x, y = north_m - begin[0], east_m - begin[1]
            u, v = velocity[0] - own[0], velocity[1] - own[1]
            t_s = min(max(-(x * u + y * v) / (u * u + v * v), 0.0), TRAFFIC.horizon_s) if u or v else 0.0
            near_m = math.hypot(x + t_s * u, y + t_s * v)
            limit_m = TRAFFIC.limit_m(vessel.position)
            lost = min(SUFFICIENT_RATIO, math.hypot(north_m, east_m) / limit_m) - near_m / limit_m
            assume(abs(lost - MIN_GAIN) > NEARLY)
            (counted if lost > MIN_GAIN else uncounted).append((near_m / limit_m, near_m))
        if counted:
            return min(counted)
        return max(SUFFICIENT_RATIO, min(uncounted)[0]), min(uncounted)[1]

    def fence(self):
        if self.sides is None:
            return None
        north_m, east_m, south_m, west_m = self.sides
        corners = [(north_m, east_m), (-south_m, east_m), (-south_m, -west_m), (north_m, -west_m)]
        return Plan.of(PlanKind.FENCE, [item(INCLUDED_VERTEX, *corner, 4) for corner in corners])

    def room_m(self, heading_rad):
        """How much of the fence's margin is left on the way, and the length of a leg of it."""
        if self.sides is None:
            return math.inf, 0.0
        north_m, east_m = (self.ahead_s * part_m_s for part_m_s in self.velocity(heading_rad))
        left_m = [side - way for side, way in zip(self.sides, (north_m, east_m, -north_m, -east_m), strict=True)]
        return min(*left_m, *self.sides), math.hypot(north_m, east_m) / FENCE_CHECK_LEGS

    def may_be(self, heading_rad):
        return self.room_m(heading_rad)[0] >= FENCE_CLEARANCE_M - 1.0

    def must_be(self, heading_rad):
        room_m, leg_m = self.room_m(heading_rad)
        return room_m >= FENCE_CLEARANCE_M + 0.5 * leg_m + 1.0

    def first_ample(self, headings):
        """The first that is ample and free; None where there is none, or another before it may be."""
        for one in headings:
            ratio, _ = self.ratio(one)
            if ratio > SUFFICIENT_RATIO - NEARLY and self.may_be(one):
                return one if ratio > SUFFICIENT_RATIO + NEARLY and self.must_be(one) else None
        return None


def decided(inputs, state=IDLE):
    """The state after a round in which the world stands still, and the texts."""
    texts = []
    for _ in range(ROUND):
        state, events = step_aside.update(SETTINGS, TRAFFIC, state, inputs)
        texts += [event.text for event in events]
    return state, texts


def off_rad(heading_rad, way_rad):
    return math.remainder(heading_rad - way_rad, 2.0 * math.pi)


def fan(way_rad):
    return [way_rad + side * step * STEP_RAD for step in range(1, HEADINGS_PER_SIDE + 1) for side in (1, -1)]


def looked_at(plane, unchanged_rad, **more):
    seen = tuple(vessel for _, vessel in plane.seen)
    return AsideInput(0.0, unchanged_rad, plane.motion, seen, plane.fence(), HeadingGoal(0.0), None, **more)


LINES = st.none() | st.tuples(st.floats(-300.0, 300.0), HEADINGS, st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
WORLDS = st.tuples(st.lists(vessels(), min_size=1, max_size=3), MOTIONS, st.none() | SIDES)


@given(WORLDS, HEADINGS, LINES)
def test_the_nearest_sufficient_heading_or_the_best_one_is_taken(world, unchanged_rad, line):
    plane, more, way_rad, along_rad = Plane(*world), {}, unchanged_rad, unchanged_rad
    own, own_m = plane.ratio(unchanged_rad)
    if line is not None:
        off_m, way_rad, crab_rad, back_rad = line
        along_rad, unchanged_rad = way_rad + crab_rad, way_rad + back_rad
        more = {"line": LineAhead(off_m, way_rad, along_rad)}
        foot = off_m * math.sin(way_rad), -off_m * math.cos(way_rad)
        own, own_m = min(plane.ratio(unchanged_rad), plane.ratio(along_rad), plane.ratio(along_rad, foot))
    state, texts = decided(looked_at(plane, unchanged_rad, **more))
    sure = max([plane.ratio(one)[0] for one in fan(way_rad) if plane.must_be(one)], default=0.0)
    if state.heading_rad is None:
        assert own > SUFFICIENT_RATIO - NEARLY or sure < own + 2.0 * MIN_GAIN + NEARLY
        if abs(own - 1.0) > NEARLY:
            assert texts == ([] if own > 1.0 else ["Avoidance: no better heading, course kept"])
        return
    ratio, cpa_m = plane.ratio(state.heading_rad)
    aside_rad = off_rad(state.heading_rad, way_rad)
    assert abs(aside_rad / STEP_RAD - round(aside_rad / STEP_RAD)) < 1e-6
    assert abs(aside_rad) < SETTINGS.sector_rad + 1e-6
    assert plane.may_be(state.heading_rad)
    assert own < SUFFICIENT_RATIO + NEARLY
    assert ratio > own + MIN_GAIN - NEARLY
    assert ratio > min(sure, SUFFICIENT_RATIO) - MIN_GAIN - NEARLY
    first_rad = plane.first_ample(fan(way_rad))
    if first_rad is not None:
        assert abs(off_rad(state.heading_rad, along_rad)) < abs(off_rad(first_rad, along_rad)) + 1e-6
    reported_deg, reported_cpa_m, reported_own_m = (float(word) for word in texts[0].split() if word.isdigit())
    assert reported_deg % 360.0 == pytest.approx(math.degrees(state.heading_rad), abs=0.51) or reported_deg in (
        0.0,
        360.0,
    )
    assert (reported_own_m, reported_cpa_m) == (pytest.approx(own_m, abs=3.0), pytest.approx(cpa_m, abs=3.0))
    assert len(texts) == 1


# Wide enough that much is ample.
WIDE_WORLDS = st.tuples(st.lists(vessels(900.0), min_size=1, max_size=2), MOTIONS, st.none() | SIDES)
ASIDE = st.floats(-SETTINGS.sector_rad, SETTINGS.sector_rad) | st.floats(-2.5, 2.5)


@given(WORLDS | WIDE_WORLDS, HEADINGS, st.floats(-0.8, 0.8), ASIDE, st.floats(0.0, 4.0), st.booleans())
def test_during_avoidance_the_heading_stays_approaches_the_course_or_returns(
    world, way_rad, crab_rad, aside_rad, best_part, reported_before
):
    plane, steered_rad, along_rad = Plane(*world), way_rad + aside_rad, way_rad + crab_rad
    line = LineAhead(0.0, way_rad, along_rad)
    own, _ = min(plane.ratio(along_rad), plane.ratio(way_rad))
    of_before = Trial(steered_rad, 100.0, best_part)
    before = replace(
        IDLE, heading_rad=steered_rad, way_rad=way_rad, best=of_before, is_refusal_reported=reported_before
    )
    state, texts = decided(looked_at(plane, way_rad, line=line), before)
    within = abs(aside_rad) <= SETTINGS.sector_rad
    others = [along_rad, *fan(way_rad)]
    tried = [*([steered_rad] if within else []), *others]
    sure = max([plane.ratio(one)[0] for one in tried if plane.must_be(one)], default=0.0)
    assert not state.is_refusal_reported
    if state.heading_rad is None:
        assert texts == ["Avoidance ended: back on course"]
        assert own > SUFFICIENT_RATIO - NEARLY or sure < own + 2.0 * MIN_GAIN + NEARLY
        return
    assert texts == []
    assert min(abs(off_rad(state.heading_rad, one)) for one in tried) < 1e-6
    assert plane.may_be(state.heading_rad)
    ratio, _ = plane.ratio(state.heading_rad)
    assert own < SUFFICIENT_RATIO + NEARLY
    assert ratio > own + MIN_GAIN - NEARLY
    assert ratio > min(sure, SUFFICIENT_RATIO) - MIN_GAIN - NEARLY
    steered, steered_off = plane.ratio(steered_rad)[0], off_rad(steered_rad, along_rad)
    stays = abs(off_rad(state.heading_rad, steered_rad)) < 1e-6
    if within and plane.must_be(steered_rad) and steered > SUFFICIENT_RATIO + NEARLY:
        inward = [one for one in others if 0.0 <= off_rad(one, along_rad) / steered_off < 1.0 - 1e-3]
        ample = [
            one for one in inward if plane.ratio(one)[0] > SUFFICIENT_RATIO + MIN_GAIN + NEARLY and plane.must_be(one)
        ]
        assert not (stays and ample)
        assert stays or off_rad(state.heading_rad, along_rad) / steered_off < 1.0
        assert stays or off_rad(state.heading_rad, along_rad) / steered_off > -1e-6
        assert stays or ratio > SUFFICIENT_RATIO + MIN_GAIN - NEARLY
