import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.control.law import DELIVERED, Ship, deadband, gains_of, proportional_gain, reduced_gain, s_surface

SHIP = Ship(0.049, 4.0, 17.0, math.radians(30.0), 0.0)  # at 0.4 m/s
SEA = math.radians(0.3) ** 2
speeds = st.floats(0.1, 3.0)
corrections = st.floats(0.0, 1.0)
prices = st.floats(0.1, 10.0)


def at(times):
    """The ship at a multiple of that speed, by similarity."""
    return SHIP._replace(turning_ability_1_s=times * SHIP.turning_ability_1_s, turning_lag_s=SHIP.turning_lag_s / times)


def delay_margin_s(ship, stiffness):
    """Return how much delay the loop of the model bears with the gains of that stiffness."""
    gains = gains_of(ship, stiffness)
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
def test_the_helm_bears_five_seconds_of_delay_at_any_speed_price_and_knowledge(times, correction, price):
    ship = at(times)
    stiffness = proportional_gain(ship, correction, price)
    assert 0.0 < stiffness <= DELIVERED.crossover_rad_s / ship.turning_ability_1_s
    assert delay_margin_s(ship, stiffness) > 5.0


@given(speeds, corrections, prices, st.floats(1.01, 8.0))
def test_a_softened_helm_bears_as_many_times_the_delay_and_is_no_softer_than_that_takes(
    times, correction, price, gain_reduction
):
    """Divided by the gain reduction, the stiffness in a calm let each degree of trim cost four of heading."""
    ship = at(times)
    stiff, found_1_s = proportional_gain(ship, correction, price), ship.turning_ability_1_s
    soft = reduced_gain(stiff, gain_reduction, found_1_s, SHIP.turning_ability_1_s)
    assert soft == stiff or soft >= DELIVERED.crossover_rad_s / (
        gain_reduction * max(found_1_s, SHIP.turning_ability_1_s)
    )
    # Of the boat as she was told, too: an estimate that swings with her may have lost most of her speed.
    assert delay_margin_s(ship, soft) > 5.0 * gain_reduction
    assert delay_margin_s(SHIP, soft) > 5.0 * gain_reduction


def test_the_helm_is_stiffer_where_the_ship_is_slower_and_more_is_seen_and_softer_where_travel_is_dear():
    stiffness = proportional_gain(SHIP, SEA, 1.0)
    assert proportional_gain(at(0.5), SEA, 1.0) == pytest.approx(2.0 ** (6.0 / 7.0) * stiffness)
    assert proportional_gain(SHIP, 0.25 * SEA, 1.0) == pytest.approx(0.5 * stiffness)
    assert proportional_gain(SHIP, SEA, 4.0) == pytest.approx(0.5 * stiffness)


def test_the_band_is_an_angle_of_heading_error_that_grows_with_what_is_shown():
    quiet, rough = (deadband(SEA * share, 2.0, 1.0) / 2.0 for share in (0.01, 1.0))
    assert math.radians(0.25) < quiet < math.radians(0.35)
    assert math.radians(0.8) < rough < math.radians(0.95)


def test_a_dearer_rudder_waits_in_the_same_band():
    bands = [deadband(SEA, proportional_gain(SHIP, SEA, price), price) for price in (1.0, 4.0)]
    assert bands[1] == pytest.approx(bands[0])


@given(corrections, prices)
def test_what_is_hardly_known_at_all_moves_no_bounds(correction, price):
    assert 0.0 < deadband(correction, proportional_gain(SHIP, correction, price), price) < math.radians(60.0)
