"""Closest point of approach: known cases, and comparison with a search in small time steps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.vessels import VesselKind, VesselPosition
from firmware_py.guidance.approach import RelativeMotion, relative_motion
from support.plans import placed

METRES = st.floats(-20_000.0, 20_000.0)
SPEEDS = st.floats(-15.0, 15.0)


@pytest.mark.parametrize(
    ("vessel", "own", "cpa_m", "time_s"),
    [
        (RelativeMotion(1000.0, 0.0, -5.0, 0.0), (0.0, 0.0), 0.0, 200.0),  # head on
        (RelativeMotion(1000.0, 0.0, -4.0, 0.0), (1.0, 0.0), 0.0, 200.0),
        (RelativeMotion(1000.0, 300.0, -5.0, 0.0), (0.0, 0.0), 300.0, 200.0),
        (RelativeMotion(1000.0, 0.0, 5.0, 0.0), (0.0, 0.0), 1000.0, 0.0),  # moves away
        (RelativeMotion(1000.0, 0.0, 0.5, 0.5), (0.5, 0.5), 1000.0, 0.0),  # same velocity
        (RelativeMotion(10_000.0, 0.0, -5.0, 0.0), (0.0, 0.0), 7000.0, 600.0),  # beyond the horizon
    ],
)
def test_closest_approach_of_known_cases(vessel, own, cpa_m, time_s):
    assert vessel.closest_approach(own, 600.0) == pytest.approx((cpa_m, time_s))


@given(METRES, METRES, SPEEDS, SPEEDS, SPEEDS, SPEEDS)
def test_no_distance_within_the_horizon_is_smaller(north_m, east_m, north_m_s, east_m_s, own_north_m_s, own_east_m_s):
    vessel = RelativeMotion(north_m, east_m, north_m_s, east_m_s)
    cpa_m, time_s = vessel.closest_approach((own_north_m_s, own_east_m_s), 1500.0)
    times = np.linspace(0.0, 1500.0, 3001)
    distances = np.hypot(north_m + (north_m_s - own_north_m_s) * times, east_m + (east_m_s - own_east_m_s) * times)
    assert 0.0 <= time_s <= 1500.0
    assert cpa_m <= distances.min() + 1e-6
    speed_m_s = abs(north_m_s) + abs(east_m_s) + abs(own_north_m_s) + abs(own_east_m_s)
    assert distances.min() - cpa_m <= 0.25 * speed_m_s + 1e-6


def test_position_is_extrapolated():
    position = VesselPosition(10.0, 1, VesselKind.CLASS_A, *placed(1000.0, 0.0), 5.0, math.pi / 2.0)
    vessel = relative_motion(Place(*placed(0.0, 0.0)), position, 40.0)
    assert (vessel.north_m, vessel.east_m) == pytest.approx((1000.0, 150.0), abs=0.2)
    assert (vessel.north_m_s, vessel.east_m_s) == pytest.approx((0.0, 5.0))
    for unknown in (replace(position, speed_m_s=None), replace(position, course_rad=None)):
        vessel = relative_motion(Place(*placed(0.0, 0.0)), unknown, 40.0)
        assert (vessel.north_m, vessel.east_m) == pytest.approx((1000.0, 0.0), abs=0.2)
        assert (vessel.north_m_s, vessel.east_m_s) == (0.0, 0.0)
