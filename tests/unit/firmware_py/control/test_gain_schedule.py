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


def at(times):
    """Return the ship at a multiple of that speed, by similarity."""
    return SHIP._replace(turning_ability_1_s=times * SHIP.turning_ability_1_s, turning_lag_s=SHIP.turning_lag_s / times)


def delay_margin_s(ship, gain):
    """Return the delay margin of the loop with the model and the gains of this proportional gain."""
    gains = gains_of(ship, gain)
    by_error = s_surface(gains, 1e-6, 0.0) / 1e-6
    by_rate = -s_surface(gains, 0.0, 1e-7) / 1e-7

    def loop(omega):
        s = 1j * omega
        return ship.turning_ability_1_s * (by_error + by_rate * s) / (s * (ship.turning_lag_s * s + 1.0))

    low, high = 1e-6, 100.0
    for _ in range(100):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if abs(loop(middle)) > 1.0 else (low, middle)
    return (math.pi + cmath.phase(loop(low))) / low


@given(speeds, corrections, prices)
def test_the_delay_margin_is_5_s_at_any_speed_price_and_correction(times, correction, price):
    ship = at(times)
    gain = proportional_gain(ship, correction, price)
    assert 0.0 < gain <= DEFAULT_CONSTANTS.crossover_rad_s / ship.turning_ability_1_s
    assert delay_margin_s(ship, gain) > 5.0


@given(speeds, corrections, prices, st.floats(1.01, 8.0))
def test_a_reduced_gain_has_a_delay_margin_as_many_times_as_large(times, correction, price, gain_reduction):
    """Divided by the gain reduction, the gain in a calm would let each degree of trim cost four of heading."""
    ship = at(times)
    full_gain, ability_1_s = proportional_gain(ship, correction, price), ship.turning_ability_1_s
    low_gain = reduced_gain(full_gain, gain_reduction, ability_1_s, SHIP.turning_ability_1_s)
    assert low_gain == full_gain or low_gain >= DEFAULT_CONSTANTS.crossover_rad_s / (
        gain_reduction * max(ability_1_s, SHIP.turning_ability_1_s)
    )
    # Of the nominal boat, too: the estimate of an oscillating boat may have lost most of its speed.
    assert delay_margin_s(ship, low_gain) > 5.0 * gain_reduction
    assert delay_margin_s(SHIP, low_gain) > 5.0 * gain_reduction


def test_the_gain_grows_with_lag_and_correction_and_falls_with_the_price():
    gain = proportional_gain(SHIP, SEA, 1.0)
    assert proportional_gain(at(0.5), SEA, 1.0) == pytest.approx(2.0 ** (6.0 / 7.0) * gain)
    assert proportional_gain(SHIP, 0.25 * SEA, 1.0) == pytest.approx(0.5 * gain)
    assert proportional_gain(SHIP, SEA, 4.0) == pytest.approx(0.5 * gain)


def test_the_deadband_grows_with_the_correction():
    quiet, rough = (deadband(SEA * share, 2.0, 1.0) / 2.0 for share in (0.01, 1.0))
    assert math.radians(0.25) < quiet < math.radians(0.35)
    assert math.radians(0.8) < rough < math.radians(0.95)


def test_the_deadband_does_not_depend_on_the_price():
    bands = [deadband(SEA, proportional_gain(SHIP, SEA, price), price) for price in (1.0, 4.0)]
    assert bands[1] == pytest.approx(bands[0])


@given(corrections, prices)
def test_an_uncertain_estimate_stays_within_the_bounds(correction, price):
    assert 0.0 < deadband(correction, proportional_gain(SHIP, correction, price), price) < math.radians(60.0)
