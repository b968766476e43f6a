"""Margin of a place to the fence."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.guidance.fence import FenceState, update
from firmware_py.plans.fence import fence_of, margin_m

MAX_DISTANCE_M = 1e7
FENCE_RETURN, INCLUDED_VERTEX, EXCLUDED_VERTEX, INCLUDED_CIRCLE, EXCLUDED_CIRCLE = range(5000, 5005)  # MAV_CMD
WAYPOINT = 16

CENTRE = Place(0.6, 2.0)


def corner(command, north_m, east_m, *params):
    place = CENTRE.at_offset(north_m, east_m)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (place.latitude_rad, place.longitude_rad))
    return PlanItem(command, 0, True, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def square(command, half_m, group=0, at=(0.0, 0.0)):
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return [corner(command, at[0] + n * half_m, at[1] + e * half_m, 4, group) for n, e in signs]


def fence(*items):
    return Plan.of(PlanKind.FENCE, items)


def test_margin_is_the_distance_of_the_nearest_edge():
    plan = fence(*square(INCLUDED_VERTEX, 500.0))
    assert margin_m(plan, CENTRE) == pytest.approx(500.0, abs=0.5)
    assert margin_m(plan, CENTRE.at_offset(450.0, 0.0)) == pytest.approx(50.0, abs=0.5)
    assert margin_m(plan, CENTRE.at_offset(0.0, -530.0)) == pytest.approx(-30.0, abs=0.5)
    assert margin_m(plan, CENTRE.at_offset(530.0, 540.0)) == pytest.approx(-50.0, abs=0.5)


def test_circle_at_0_0_is_valid():
    both = fence(*square(INCLUDED_VERTEX, 500.0), PlanItem(EXCLUDED_CIRCLE, params=(100.0, 0.0, 0.0, 0.0)))
    assert margin_m(both, CENTRE) == pytest.approx(500.0, abs=0.5)
    alone = fence(PlanItem(EXCLUDED_CIRCLE, params=(100.0, 0.0, 0.0, 0.0)))
    assert margin_m(alone, Place(0.0, 0.0)) == pytest.approx(-100.0)


@pytest.mark.parametrize("first", range(4))
def test_vertex_at_0_0_is_valid(first):
    corners = [(0, 0), (10_000_000, 0), (10_000_000, 10_000_000), (0, 10_000_000)]
    rotated = corners[first:] + corners[:first]
    plan = fence(*(PlanItem(INCLUDED_VERTEX, params=(4.0, 0.0, 0.0, 0.0), x=x, y=y) for x, y in rotated))
    half = math.radians(0.5)
    assert margin_m(plan, Place(half, half)) == pytest.approx(half * 6371008.8, rel=0.001)
    assert margin_m(plan, Place(half, -half)) == pytest.approx(-half * 6371008.8, rel=0.001)


def test_margin_is_negative_inside_exclusion_areas():
    plan = fence(
        *square(INCLUDED_VERTEX, 500.0),
        *square(EXCLUDED_VERTEX, 50.0, at=(200.0, 0.0)),
        corner(EXCLUDED_CIRCLE, -200.0, 0.0, 40.0),
    )
    assert margin_m(plan, CENTRE.at_offset(200.0, 0.0)) == pytest.approx(-50.0, abs=0.5)
    assert margin_m(plan, CENTRE.at_offset(-190.0, 0.0)) == pytest.approx(-30.0, abs=0.5)
    assert margin_m(plan, CENTRE) == pytest.approx(150.0, abs=0.5)


def test_place_must_be_inside_all_areas_of_one_group():
    both = fence(corner(INCLUDED_CIRCLE, 0.0, 0.0, 300.0), corner(INCLUDED_CIRCLE, 0.0, 200.0, 300.0))
    assert margin_m(both, CENTRE.at_offset(0.0, 100.0)) == pytest.approx(200.0, abs=0.5)
    assert margin_m(both, CENTRE.at_offset(0.0, -150.0)) == pytest.approx(-50.0, abs=0.5)
    either = fence(corner(INCLUDED_CIRCLE, 0.0, 0.0, 300.0, 1), corner(INCLUDED_CIRCLE, 0.0, 200.0, 300.0, 2))
    assert margin_m(either, CENTRE.at_offset(0.0, -150.0)) == pytest.approx(150.0, abs=0.5)


def test_empty_fence_and_incomplete_polygon_have_no_margin():
    assert margin_m(fence(), CENTRE) == MAX_DISTANCE_M
    assert fence_of(fence(*square(INCLUDED_VERTEX, 500.0)[:2])) is None


def test_margin_near_the_fence_is_recomputed_every_two_metres():
    plan = fence(*square(INCLUDED_VERTEX, 500.0))
    state = update(FenceState(), plan, CENTRE.at_offset(495.0, 0.0))
    assert update(state, plan, CENTRE.at_offset(493.1, 0.0)) is state
    assert update(state, plan, CENTRE.at_offset(492.9, 0.0)).margin_m == pytest.approx(7.1, abs=0.1)


def test_margin_is_recomputed_after_movement_or_with_another_fence():
    plan = fence(*square(INCLUDED_VERTEX, 500.0))
    state = update(FenceState(), plan, CENTRE)
    assert update(state, plan, CENTRE.at_offset(49.0, 0.0)) is state  # less than a tenth of the margin
    moved = update(state, plan, CENTRE.at_offset(51.0, 0.0))
    assert moved.margin_m == pytest.approx(449.0, abs=0.5)
    changed = update(moved, fence(*square(INCLUDED_VERTEX, 400.0)), CENTRE.at_offset(51.0, 0.0))
    assert changed.margin_m == pytest.approx(349.0, abs=0.5)


items = st.builds(
    PlanItem,
    st.sampled_from([FENCE_RETURN, INCLUDED_VERTEX, EXCLUDED_VERTEX, INCLUDED_CIRCLE, EXCLUDED_CIRCLE, WAYPOINT]),
    params=st.tuples(*[st.floats(width=32) for _ in range(4)]),
    x=st.integers(-(2**31), 2**31 - 1),
    y=st.integers(-(2**31), 2**31 - 1),
)


@given(st.lists(items, max_size=12), st.floats(-1.57, 1.57), st.floats(-3.14, 3.14))
def test_margin_is_finite_for_any_fence(fence_items, latitude_rad, longitude_rad):
    assert math.isfinite(margin_m(fence(*fence_items), Place(latitude_rad, longitude_rad)))
