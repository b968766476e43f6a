"""The closest point of approach, against a search in small steps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import Place
from firmware_py.common.vessels import VesselKind, VesselPosition
from firmware_py.guidance.approach import Relative, relative
from support.plans import placed

METRES = st.floats(-20_000.0, 20_000.0)
SPEEDS = st.floats(-15.0, 15.0)


@pytest.mark.parametrize(
    ("vessel", "own", "cpa_m", "when_s"),
    [
        (Relative(1000.0, 0.0, -5.0, 0.0), (0.0, 0.0), 0.0, 200.0),  # head on
        (Relative(1000.0, 0.0, -4.0, 0.0), (1.0, 0.0), 0.0, 200.0),
        (Relative(1000.0, 300.0, -5.0, 0.0), (0.0, 0.0), 300.0, 200.0),
        (Relative(1000.0, 0.0, 5.0, 0.0), (0.0, 0.0), 1000.0, 0.0),  # goes away
        (Relative(1000.0, 0.0, 0.5, 0.5), (0.5, 0.5), 1000.0, 0.0),  # keeps company
        (Relative(10_000.0, 0.0, -5.0, 0.0), (0.0, 0.0), 7000.0, 600.0),  # beyond the time that is looked ahead
    ],
)
def test_plain_cases(vessel, own, cpa_m, when_s):
    assert vessel.nearest(own, 600.0) == pytest.approx((cpa_m, when_s))


@given(METRES, METRES, SPEEDS, SPEEDS, SPEEDS, SPEEDS)
def test_nothing_is_nearer_within_the_time(north_m, east_m, north_m_s, east_m_s, own_north_m_s, own_east_m_s):
    vessel = Relative(north_m, east_m, north_m_s, east_m_s)
    cpa_m, when_s = vessel.nearest((own_north_m_s, own_east_m_s), 1500.0)
    times = np.linspace(0.0, 1500.0, 3001)
    distances = np.hypot(north_m + (north_m_s - own_north_m_s) * times, east_m + (east_m_s - own_east_m_s) * times)
    assert 0.0 <= when_s <= 1500.0
    assert cpa_m <= distances.min() + 1e-6
    speed_m_s = abs(north_m_s) + abs(east_m_s) + abs(own_north_m_s) + abs(own_east_m_s)
    assert distances.min() - cpa_m <= 0.25 * speed_m_s + 1e-6


def test_a_position_is_extrapolated():
    position = VesselPosition(10.0, 1, VesselKind.CLASS_A, *placed(1000.0, 0.0), 5.0, math.pi / 2.0)
    seen = relative(Place(*placed(0.0, 0.0)), position, 40.0)
    assert (seen.north_m, seen.east_m) == pytest.approx((1000.0, 150.0), abs=0.2)
    assert (seen.north_m_s, seen.east_m_s) == pytest.approx((0.0, 5.0))
