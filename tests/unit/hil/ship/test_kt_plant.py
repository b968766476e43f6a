"""Steady turns, transients and limits of the K-T plant."""

import math

import pytest

from firmware_py.common.angles import degrees, radians
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.ship.kt_plant import KtPlant, inner_steps

STEP_S = 0.02


def steady_rate_deg_s(model: KtModel, rudder_deg: float) -> float:
    plant = KtPlant(model, STEP_S)
    for _ in range(int(20 * model.turning_lag_s / STEP_S)):
        plant.step(radians(rudder_deg))
    return degrees(plant.yaw_rate_rad_s)


@pytest.mark.parametrize(("rudder_deg", "rate_deg_s"), [(10, 0.4894), (20, 0.9752), (30, 1.4541), (35, 1.6900)])
def test_steady_turn_equals_the_equation(rudder_deg, rate_deg_s):
    assert steady_rate_deg_s(OCEAN_RAMBLER, rudder_deg) == pytest.approx(rate_deg_s, abs=5e-5)
    assert steady_rate_deg_s(OCEAN_RAMBLER, -rudder_deg) == pytest.approx(-rate_deg_s, abs=5e-5)


def test_rudder_at_the_offset_keeps_the_heading():
    plant = KtPlant(KtModel(0.049, 4.0, 17.0, radians(4.0), 0.4), STEP_S)
    for _ in range(1000):
        plant.step(radians(5.0), drift_rad=radians(1.0))
    assert plant.heading_rad == 0.0


def test_linear_model_has_an_exponential_response():
    plant = KtPlant(KtModel(0.049, 4.0, 0.0, 0.0, 0.4), STEP_S)
    for _ in range(200):
        plant.step(0.5)
    exact_rad_s = 0.049 * 0.5 * (1.0 - math.exp(-1.0))
    assert plant.yaw_rate_rad_s == pytest.approx(exact_rad_s, rel=1e-9)


def test_fast_model_takes_more_steps_and_is_stable():
    fast = KtModel(0.3, 0.2, 1e4, 0.0, 0.4)
    assert inner_steps(fast, STEP_S) > inner_steps(OCEAN_RAMBLER, STEP_S)
    plant = KtPlant(fast, STEP_S, yaw_rate_rad_s=0.2)
    for _ in range(50):
        plant.step(1.0)
        assert abs(plant.yaw_rate_rad_s) <= 0.2
    rate = plant.yaw_rate_rad_s
    assert rate + 1e4 * rate**3 == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize(
    "model",
    [
        KtModel(0.049, 0.0, 17.0, 0.0, 0.4),
        KtModel(0.049, -4.0, 17.0, 0.0, 0.4),
        KtModel(math.nan, 4.0, 17.0, 0.0, 0.4),
        KtModel(0.049, 4.0, -1.0, 0.0, 0.4),
        KtModel(20.0, 1e-6, 1e6, 0.0, 0.4),
    ],
)
def test_invalid_model_is_rejected(model):
    with pytest.raises(ValueError):
        KtPlant(model, STEP_S)
