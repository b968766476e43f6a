"""Gain schedule of the heading controller: delay margin, gain reduction, deadband."""

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

NOMINAL_SHIP = Ship(  # at 0.4 m/s
    turning_ability_1_s=0.049, turning_lag_s=4.0, norrbin_s2=17.0, limit_rad=math.radians(30.0), bias_rad=0.0
)
CORRECTION_RAD2_S = math.radians(0.3) ** 2  # variance of the heading updates of the filter per second
speed_ratios = st.floats(0.1, 3.0)
corrections_rad2_s = st.floats(0.0, 1.0)
travel_weights = st.floats(0.1, 10.0)


def ship_at_ratio(ratio):
    """Return the nominal ship at `ratio` times its speed; K is proportional to the speed, T to its inverse."""
    return NOMINAL_SHIP._replace(
        turning_ability_1_s=ratio * NOMINAL_SHIP.turning_ability_1_s, turning_lag_s=NOMINAL_SHIP.turning_lag_s / ratio
    )


def delay_margin_s(ship, gain):
    """Return the delay margin of the loop of a ship with a proportional gain."""
    gains = gains_of(ship, gain)
    error_gain = s_surface(gains, 1e-6, 0.0) / 1e-6
    rate_gain = -s_surface(gains, 0.0, 1e-7) / 1e-7

    def loop_gain(omega_rad_s):
        s = 1j * omega_rad_s
        return ship.turning_ability_1_s * (error_gain + rate_gain * s) / (s * (ship.turning_lag_s * s + 1.0))

    low_rad_s, high_rad_s = 1e-6, 100.0
    for _ in range(100):
        middle_rad_s = math.sqrt(low_rad_s * high_rad_s)
        low_rad_s, high_rad_s = (
            (middle_rad_s, high_rad_s) if abs(loop_gain(middle_rad_s)) > 1.0 else (low_rad_s, middle_rad_s)
        )
    return (math.pi + cmath.phase(loop_gain(low_rad_s))) / low_rad_s


@given(speed_ratios, corrections_rad2_s, travel_weights)
def test_delay_margin_exceeds_5_s_at_any_speed_correction_and_travel_weight(ratio, correction_rad2_s, travel_weight):
    ship = ship_at_ratio(ratio)
    gain = proportional_gain(ship, correction_rad2_s, travel_weight)
    assert 0.0 < gain <= DEFAULT_CONSTANTS.crossover_rad_s / ship.turning_ability_1_s
    assert delay_margin_s(ship, gain) > 5.0


@given(speed_ratios, corrections_rad2_s, travel_weights, st.floats(1.01, 8.0))
def test_delay_margin_grows_with_the_gain_reduction(ratio, correction_rad2_s, travel_weight, gain_reduction):
    """Only the upper limit is reduced: with a lower gain in calm water, the rudder trim would cause a large error."""
    ship = ship_at_ratio(ratio)
    gain, ability_1_s = proportional_gain(ship, correction_rad2_s, travel_weight), ship.turning_ability_1_s
    low_gain = reduced_gain(gain, gain_reduction, ability_1_s, NOMINAL_SHIP.turning_ability_1_s)
    max_ability_1_s = max(ability_1_s, NOMINAL_SHIP.turning_ability_1_s)
    assert low_gain == gain or low_gain >= DEFAULT_CONSTANTS.crossover_rad_s / (gain_reduction * max_ability_1_s)
    # The nominal ship needs the margin too, because the estimated speed may be far too low during oscillations.
    assert delay_margin_s(ship, low_gain) > 5.0 * gain_reduction
    assert delay_margin_s(NOMINAL_SHIP, low_gain) > 5.0 * gain_reduction


def test_gain_grows_with_lag_and_correction_and_decreases_with_the_travel_weight():
    gain = proportional_gain(NOMINAL_SHIP, CORRECTION_RAD2_S, 1.0)
    assert proportional_gain(ship_at_ratio(0.5), CORRECTION_RAD2_S, 1.0) == pytest.approx(2.0 ** (6.0 / 7.0) * gain)
    assert proportional_gain(NOMINAL_SHIP, 0.25 * CORRECTION_RAD2_S, 1.0) == pytest.approx(0.5 * gain)
    assert proportional_gain(NOMINAL_SHIP, CORRECTION_RAD2_S, 4.0) == pytest.approx(0.5 * gain)


def test_deadband_grows_with_the_correction():
    """The quotient of deadband and proportional gain is the deadband as a heading error."""
    gain = 2.0
    calm_rad, rough_rad = (deadband(CORRECTION_RAD2_S * factor, gain, 1.0) / gain for factor in (0.01, 1.0))
    assert math.radians(0.25) < calm_rad < math.radians(0.35)
    assert math.radians(0.8) < rough_rad < math.radians(0.95)


def test_deadband_does_not_depend_on_the_travel_weight():
    deadbands_rad = [
        deadband(CORRECTION_RAD2_S, proportional_gain(NOMINAL_SHIP, CORRECTION_RAD2_S, weight), weight)
        for weight in (1.0, 4.0)
    ]
    assert deadbands_rad[1] == pytest.approx(deadbands_rad[0])


@given(corrections_rad2_s, travel_weights)
def test_deadband_is_limited_at_any_correction_and_travel_weight(correction_rad2_s, travel_weight):
    gain = proportional_gain(NOMINAL_SHIP, correction_rad2_s, travel_weight)
    assert 0.0 < deadband(correction_rad2_s, gain, travel_weight) < math.radians(60.0)


def test_correction_of_the_gain_is_limited_to_0_08_and_1_5_deg_per_sqrt_s():
    """The weight on rudder travel is so large that the crossover frequency does not limit the gain."""

    def gain_at(correction_deg_per_sqrt_s):
        return proportional_gain(NOMINAL_SHIP, math.radians(correction_deg_per_sqrt_s) ** 2, 100.0)

    assert gain_at(0.0) == gain_at(0.079) == pytest.approx(gain_at(0.08))
    assert gain_at(0.09) == pytest.approx(gain_at(0.08) * 0.09 / 0.08)
    assert gain_at(9.0) == gain_at(1.51) == pytest.approx(gain_at(0.1) * 1.5 / 0.1)
    assert gain_at(0.1) == pytest.approx(136.0 * math.radians(0.1) * (4.0 / 0.049) ** (3.0 / 7.0) / 10.0)


def test_correction_of_the_deadband_is_limited_to_0_01_and_1_5_deg_per_sqrt_s():
    for correction_deg_per_sqrt_s, limited_deg_per_sqrt_s in ((0.0, 0.01), (0.02, 0.02), (1.4, 1.4), (2.0, 1.5)):
        deadband_rad = deadband(math.radians(correction_deg_per_sqrt_s) ** 2, 1.0, 1.0)
        assert deadband_rad == pytest.approx(0.00469 + 1.94 * math.radians(limited_deg_per_sqrt_s))


def test_crossover_frequency_is_at_most_0_264_rad_s():
    assert proportional_gain(NOMINAL_SHIP, 1.0, 0.1) == pytest.approx(0.264 / 0.049)
    assert reduced_gain(100.0, 2.0, 0.049, 0.03) == pytest.approx(0.132 / 0.049)
    assert reduced_gain(100.0, 2.0, 0.03, 0.049) == pytest.approx(0.132 / 0.049)
