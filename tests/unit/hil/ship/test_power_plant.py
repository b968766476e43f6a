"""Panels, battery and loads: energy balance and elevation of the sun."""

import math

import numpy as np
import pytest

from hil.ship.disturbances import Supply
from hil.ship.power_plant import CHARGER_EFFICIENCY, Place, PowerPlant

DAY_S = 86_400.0
MIDSUMMER, MIDWINTER = 1_782_000_000.0, 1_797_811_200.0  # 2026-06-21 and 2026-12-21, 00:00 UTC


def plant(begin_utc_s=MIDSUMMER, latitude_deg=36.0, servo_j=lambda: 0.0, **supply):
    return PowerPlant(
        Supply(**supply), Place(latitude_deg, 0.0, begin_utc_s - begin_utc_s % DAY_S), np.random.default_rng(1), servo_j
    )


def energy_error_j(power):
    """Return the energy of the charger that neither the loads nor the battery received."""
    totals = power.totals
    return totals.charger_j - totals.load_j - (totals.into_battery_j - totals.out_of_battery_j)


@pytest.mark.parametrize(("begin", "highest_deg"), [(MIDSUMMER, 90.0 - 36.0 + 23.44), (MIDWINTER, 90.0 - 36.0 - 23.44)])
def test_elevation_of_the_sun_is_highest_at_noon(begin, highest_deg):
    power = plant(begin)
    elevations_rad = [power.elevation_rad(60.0 * minute) for minute in range(1440)]
    assert max(elevations_rad) == elevations_rad[720]
    assert math.degrees(max(elevations_rad)) == pytest.approx(highest_deg, abs=0.1)


def test_energy_of_a_clear_midsummer_day_is_plausible():
    power = plant(panel_w=100.0, clouds=0.0, battery_wh=1e5, charge=0.1)
    power.advance_to(DAY_S)
    # 7 to 9 kWh/m2 and day on level ground at 36 deg north.
    assert 700.0 < power.totals.panel_j / 3600.0 < 900.0
    assert power.totals.charger_j == pytest.approx(CHARGER_EFFICIENCY * power.totals.panel_j)


def test_clouds_reduce_the_energy_repeatably():
    clear, cloudy, again = plant(clouds=0.0, charge=0.1), plant(clouds=0.7, charge=0.1), plant(clouds=0.7, charge=0.1)
    for power in (clear, cloudy, again):
        power.advance_to(0.4 * DAY_S)
    assert 0.3 < cloudy.totals.panel_j / clear.totals.panel_j < 0.85
    assert cloudy.totals == again.totals


def test_charger_energy_equals_load_and_battery_energy():
    servo_energies_j = iter(range(10**6))
    power = plant(servo_j=lambda: float(next(servo_energies_j)), charge=0.5)
    power.advance_to(DAY_S / 4)
    assert energy_error_j(power) == pytest.approx(0.0, abs=1e-6)
    assert power.totals.load_j == pytest.approx((4.0 + 1.0) * DAY_S / 4)
    assert power.totals.empty_s == 0.0


def test_full_battery_limits_the_charger_and_empty_battery_is_counted():
    full = plant(charge=1.0, panel_w=500.0, battery_wh=100.0)
    full.advance_to(DAY_S / 2)
    assert full.charge > 0.99
    assert full.totals.into_battery_j == pytest.approx(full.totals.out_of_battery_j, rel=0.1)
    assert energy_error_j(full) == pytest.approx(0.0, abs=1e-6)
    empty = plant(charge=0.01, panel_w=0.0, battery_wh=10.0)
    empty.advance_to(3600.0)
    assert empty.charge == 0.0
    assert empty.totals.empty_s > 3000.0
