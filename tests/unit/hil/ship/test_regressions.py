"""Regressions of Zhou and Clarke equal values calculated by hand; warnings outside their range."""

import math

import pytest

from hil.ship.regressions import (
    FLOAT,
    HullForm,
    envelope_warnings,
    surge_added_mass_ratio,
    sway_acceleration_derivative,
    sway_model,
    sway_velocity_derivative,
)

# A merchant ship with L/B = 6, B/D = 2.5, Cb = 0.6.
SHIP = HullForm(length_m=150.0, beam_m=25.0, draft_m=10.0, mass_kg=999_999.0, block_coefficient=0.6)


def test_surge_added_mass_equals_zhou():
    # 0.398 + 7.182 * 2.492 - 10.404 * 1.452 + 3.78 * 1.2164 - 2.6568
    assert surge_added_mass_ratio(SHIP) == pytest.approx(0.01 * 5.130128, rel=1e-6)


def test_sway_derivatives_equal_clarke():
    slender = math.pi / 225.0
    assert sway_acceleration_derivative(SHIP) == pytest.approx(-slender * (1.0 + 0.24 - 5.1 / 36.0))
    assert sway_velocity_derivative(SHIP) == pytest.approx(-slender * 1.6)


def test_merchant_ship_has_dimensional_masses_without_warning():
    assert envelope_warnings(SHIP) == sway_model(SHIP).warnings == ()
    hull, model = SHIP, sway_model(SHIP, density_kg_m3=1000.0)
    assert model.surge_mass_kg == pytest.approx(hull.mass_kg * (1.0 + surge_added_mass_ratio(hull)))
    assert model.sway_mass_kg == pytest.approx(hull.mass_kg - 500.0 * 150.0**3 * sway_acceleration_derivative(hull))
    assert model.sway_damping_kg_s(2.0) == pytest.approx(500.0 * 150.0**2 * 2.0 * sway_velocity_derivative(hull))


def test_float_outside_the_envelope_has_warnings():
    model = sway_model(FLOAT)
    assert pytest.approx(0.3434, abs=1e-4) == FLOAT.block_coefficient
    assert [warning.split(" is outside")[0] for warning in model.warnings] == [
        "length / beam 3.77",
        "block coefficient 0.343",
    ]
    assert model.surge_mass_kg == pytest.approx(207.4, abs=0.1)
    assert model.sway_mass_kg > model.surge_mass_kg
    assert model.sway_damping_kg_m < 0.0


def test_negative_added_masses_become_zero_with_a_warning():
    thin = sway_model(HullForm(20.0, 2.0, 2.0, 1000.0, 0.01))
    broad = sway_model(HullForm(2.0, 2.0, 0.5, 100.0, 0.1))
    assert any("Zhou gives a negative" in warning for warning in thin.warnings)
    assert thin.surge_mass_kg == 1000.0
    assert any("Clarke gives a negative" in warning for warning in broad.warnings)
    assert broad.sway_mass_kg == 100.0


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, 1e300])
@pytest.mark.parametrize("index", range(5))
def test_particulars_must_be_positive_and_finite(value, index):
    numbers = [3.05, 0.81, 0.23, 200.0, 0.4]
    numbers[index] = value
    with pytest.raises(ValueError, match="must be positive"):
        HullForm(*numbers)


@pytest.mark.parametrize(
    ("length_m", "mass_kg", "error"),
    [(3.05, 900.0, "check the mass and the draft"), *[(x, 200.0, "length_m") for x in (0.0, -3.0, math.nan)]],
)
def test_mass_must_give_a_possible_block_coefficient(length_m, mass_kg, error):
    with pytest.raises(ValueError, match=error):
        HullForm.from_mass(length_m, 0.81, 0.23, mass_kg)
