"""Panels, battery and loads: energy balance and elevation of the sun."""

import math

import numpy as np
import pytest

from hil.ship.disturbances import Supply
from hil.ship.power_plant import EFFICIENCY, Place, PowerPlant

DAY_S = 86_400.0
MIDSUMMER, MIDWINTER = 1_782_000_000.0, 1_797_811_200.0  # 2026-06-21 and 2026-12-21, 00:00 UTC


def plant(begin_utc_s=MIDSUMMER, latitude_deg=36.0, servo_j=lambda: 0.0, **supply):
    return PowerPlant(Supply(**supply), Place(latitude_deg, 0.0, begin_utc_s - begin_utc_s % DAY_S), chance(), servo_j)


def chance(seed=1):
    return np.random.default_rng(seed)


def balance_j(of):
    totals = of.totals
    return totals.charger_j - totals.load_j - (totals.into_battery_j - totals.out_of_battery_j)


@pytest.mark.parametrize(("begin", "highest_deg"), [(MIDSUMMER, 90.0 - 36.0 + 23.44), (MIDWINTER, 90.0 - 36.0 - 23.44)])
def test_elevation_of_the_sun(begin, highest_deg):
    of = plant(begin)
    heights = [of.elevation_rad(60.0 * minute) for minute in range(1440)]
    assert max(heights) == heights[720]
    assert math.degrees(max(heights)) == pytest.approx(highest_deg, abs=0.1)


def test_energy_of_a_clear_midsummer_day():
    of = plant(panel_w=100.0, clouds=0.0, battery_wh=1e5, charge=0.1)
    of.advance_to(DAY_S)
    # 7 to 9 kWh/m2 and day on level ground at 36 deg north.
    assert 700.0 < of.totals.panel_j / 3600.0 < 900.0
    assert of.totals.charger_j == pytest.approx(EFFICIENCY * of.totals.panel_j)


def test_clouds():
    clear, one, again = plant(clouds=0.0, charge=0.1), plant(clouds=0.7, charge=0.1), plant(clouds=0.7, charge=0.1)
    for of in (clear, one, again):
        of.advance_to(0.4 * DAY_S)
    assert 0.3 < one.totals.panel_j / clear.totals.panel_j < 0.85
    assert one.totals == again.totals


def test_energy_balance():
    taken = iter(range(10**6))
    of = plant(servo_j=lambda: float(next(taken)), charge=0.5)
    of.advance_to(DAY_S / 4)
    assert balance_j(of) == pytest.approx(0.0, abs=1e-6)
    assert of.totals.load_j == pytest.approx((4.0 + 1.0) * DAY_S / 4)
    assert of.totals.empty_s == 0.0


def test_full_and_empty_battery():
    full = plant(charge=1.0, panel_w=500.0, battery_wh=100.0)
    full.advance_to(DAY_S / 2)
    assert full.charge > 0.99
    assert balance_j(full) == pytest.approx(0.0, abs=1e-6)
    empty = plant(charge=0.01, panel_w=0.0, battery_wh=10.0)
    empty.advance_to(3600.0)
    assert empty.charge == 0.0
    assert empty.totals.empty_s > 3000.0
