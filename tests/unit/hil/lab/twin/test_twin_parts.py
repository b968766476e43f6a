"""The ship model of the compiled simulation equals that of the HIL simulation, bit for bit."""

import numpy as np
import pytest

from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.twin import devices, sailing
from hil.lab.twin import ship as ships
from hil.lab.twin.sea import sea_of as draw_sea
from hil.ship.hull import GRID_S, Hull
from hil.ship.scenarios import TABLE, parse_scenario

pytestmark = pytest.mark.timeout(600)  # the ship is compiled first

DISTURBANCES = (
    "float=0.4:1.2,leeway=6:3:80,sway=0.5,orbital=0.3,speed=0.5:30:8:6,compass=2:3:1:1:1:4:0,kt=0.7:1.3,delay=0.33"
)
NOISE = "yaw=4,bias=12:600"


@pytest.mark.parametrize(
    "text",
    [*(row.name for row in TABLE), "tank+orbital=0.2,compass", f"mission+{DISTURBANCES},{NOISE}", "calm+sway,compass"],
)
def test_hull_equals_that_of_the_harness(text):
    scenario, seconds = parse_scenario(text), 10.0
    hull, sea = Hull(scenario, OCEAN_RAMBLER, 3), draw_sea(scenario, 3, seconds)
    state, delayed_rad, ship = (
        np.zeros(ships.HULL_STATES),
        np.zeros(max(sea.ship.delay_steps, 1)),
        sailing.record_of(sea.ship),
    )
    ships.begin_hull(state, ship)
    numbers = np.random.default_rng(1)
    rudder_rad = 0.0
    for step in range(int(seconds / GRID_S)):
        offset_s = float(numbers.uniform(0.0, GRID_S))
        heading_rad = ships.compass_heading(state, ship, sea.series, step, offset_s)
        assert heading_rad == hull.compass_heading_rad(offset_s)
        assert ships.velocity(state, ship, sea.series, step, offset_s) == hull.velocity_in_waves_m_s(offset_s)
        assert ships.position(state, ship, sea.series, step, offset_s) == hull.position_in_waves_m(offset_s)
        rudder_rad = min(max(rudder_rad + float(numbers.normal(0.0, 0.02)), -0.5), 0.5)
        hull.step(rudder_rad)
        delayed_rudder_rad = ships.rudder_in_water(ship, delayed_rad, step, rudder_rad)
        ships.step_hull(state, ship, sea.series, step, delayed_rudder_rad)
        assert state[ships.PSI] == hull.glider_heading_rad(0.0)


def test_invalid_ship_is_refused():
    with pytest.raises(ValueError, match="invalid ship model"):
        draw_sea(parse_scenario("tank"), 1, 10.0, OCEAN_RAMBLER._replace(turning_lag_s=-1.0))


def test_bearings_are_rounded_as_in_nmea_sentences():
    assert devices.bearing(359.97, 0.1) == 0.0
    assert devices.bearing(-0.26, 0.1) == pytest.approx(359.7)
    assert [devices.digits_of(number) for number in (0.0, 9.9, 10.0, 359.9)] == [1, 1, 2, 3]
