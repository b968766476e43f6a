import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.control.law import (
    DEFAULT_CONSTANTS,
    Ship,
    deadband,
    gains_of,
    proportional_gain,
    reduced_gain,
    s_surface,
)

SHIP = Ship(0.049, 4.0, 17.0, math.radians(30.0), 0.0)  # at 0.4 m/s
SEA = math.radians(0.3) ** 2
speeds = st.floats(0.1, 3.0)
corrections = st.floats(0.0, 1.0)
prices = st.floats(0.1, 10.0)


def ship_at_ratio(ratio):
    """Return the ship at a multiple of its speed, by similarity."""
    return SHIP._replace(turning_ability_1_s=ratio * SHIP.turning_ability_1_s, turning_lag_s=SHIP.turning_lag_s / ratio)


def delay_margin_s(ship, gain):
    """Return the delay margin [s] of the loop with the model and this proportional gain."""
    gains = gains_of(ship, gain)
    error_gain = s_surface(gains, 1e-6, 0.0) / 1e-6
    rate_gain = -s_surface(gains, 0.0, 1e-7) / 1e-7

    def loop_gain(omega):
        s = 1j * omega
        return ship.turning_ability_1_s * (error_gain + rate_gain * s) / (s * (ship.turning_lag_s * s + 1.0))

    low_omega, high_omega = 1e-6, 100.0
    for _ in range(100):
        middle = math.sqrt(low_omega * high_omega)
        low_omega, high_omega = (middle, high_omega) if abs(loop_gain(middle)) > 1.0 else (low_omega, middle)
    return (math.pi + cmath.phase(loop_gain(low_omega))) / low_omega


@given(speeds, corrections, prices)
def test_delay_margin_exceeds_5_s_at_any_speed_price_and_correction(ratio, correction, price):
    ship = ship_at_ratio(ratio)
    gain = proportional_gain(ship, correction, price)
    assert 0.0 < gain <= DEFAULT_CONSTANTS.crossover_rad_s / ship.turning_ability_1_s
    assert delay_margin_s(ship, gain) > 5.0


@given(speeds, corrections, prices, st.floats(1.01, 8.0))
def test_delay_margin_grows_with_the_gain_reduction(ratio, correction, price, gain_reduction):
    """Only the upper limit is reduced: a reduced gain of calm water causes an error of four times the trim."""
    ship = ship_at_ratio(ratio)
    gain, ability_1_s = proportional_gain(ship, correction, price), ship.turning_ability_1_s
    low_gain = reduced_gain(gain, gain_reduction, ability_1_s, SHIP.turning_ability_1_s)
    max_ability_1_s = max(ability_1_s, SHIP.turning_ability_1_s)
    assert low_gain == gain or low_gain >= DEFAULT_CONSTANTS.crossover_rad_s / (gain_reduction * max_ability_1_s)
    # Also for the nominal boat, because the estimated speed may be far too low while the boat oscillates.
    assert delay_margin_s(ship, low_gain) > 5.0 * gain_reduction
    assert delay_margin_s(SHIP, low_gain) > 5.0 * gain_reduction


def test_gain_grows_with_lag_and_correction_and_decreases_with_the_price():
    gain = proportional_gain(SHIP, SEA, 1.0)
    assert proportional_gain(ship_at_ratio(0.5), SEA, 1.0) == pytest.approx(2.0 ** (6.0 / 7.0) * gain)
    assert proportional_gain(SHIP, 0.25 * SEA, 1.0) == pytest.approx(0.5 * gain)
    assert proportional_gain(SHIP, SEA, 4.0) == pytest.approx(0.5 * gain)


def test_deadband_grows_with_the_correction():
    calm_rad, rough_rad = (deadband(SEA * factor, 2.0, 1.0) / 2.0 for factor in (0.01, 1.0))
    assert math.radians(0.25) < calm_rad < math.radians(0.35)
    assert math.radians(0.8) < rough_rad < math.radians(0.95)


def test_deadband_does_not_depend_on_the_price():
    bands = [deadband(SEA, proportional_gain(SHIP, SEA, price), price) for price in (1.0, 4.0)]
    assert bands[1] == pytest.approx(bands[0])


@given(corrections, prices)
def test_deadband_is_limited_at_any_correction_and_price(correction, price):
    assert 0.0 < deadband(correction, proportional_gain(SHIP, correction, price), price) < math.radians(60.0)
