"""Wind and depth as a client reads them."""

import math

import pytest


def test_pymavlink_reads_wind_and_depth(start_hil, connect):
    hil = start_hil("udpout", scenario="calm", disturbances="wind=9:200:0,depth=25")
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    depth = station.receive("WATER_DEPTH")
    assert depth.healthy == 1
    assert depth.distance == pytest.approx(25.0, abs=0.3)
    assert 1e-7 * depth.lat == pytest.approx(36.0, abs=0.01)
    # The first means contain winds from before the first heading and fix.
    wind = station.receive("WIND_COV", lambda message: abs(message.wind_x - 8.457) < 0.3)
    assert wind.wind_x == pytest.approx(-9.0 * math.cos(math.radians(200.0)), abs=0.3)
    assert wind.wind_y == pytest.approx(-9.0 * math.sin(math.radians(200.0)), abs=0.3)
    assert math.isnan(wind.wind_z)
