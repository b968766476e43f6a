"""White noise of the yaw acceleration: diffusion of the heading and yaw rate."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import degrees
from firmware_py.model.kt import KtModel
from hil.ship.kt_plant import KtPlant, inner_steps
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.yaw_noise import YawNoise, largest_rate_rad_s

STEP_S = 0.1
LAG_S = 4.0
LINEAR = KtModel(0.049, LAG_S, 0.0, 0.0, 0.4)


def simulate(diffusion_deg2_s, steps):
    """Return heading [deg] and yaw rate [deg/s] of a boat with the rudder amidships."""
    noise = YawNoise(diffusion_deg2_s, STEP_S, NormalNumbers(generator(1, Stream.YAW)))
    plant, rows = KtPlant(LINEAR, STEP_S), np.empty((2, steps))
    for step in range(steps):
        plant.step(0.0)
        plant.yaw_rate_rad_s += noise.jump_rad_s(LAG_S)
        rows[:, step] = degrees(plant.heading_rad), degrees(plant.yaw_rate_rad_s)
    return rows


def test_heading_diffuses_and_yaw_rate_is_of_first_order():
    assert not simulate(0.0, 100)[0].any()
    heading_deg, rate_deg_s = simulate(2.0, 100_000)
    assert np.var(rate_deg_s) == pytest.approx(2.0 / (2.0 * LAG_S), rel=0.1)
    lag = round(LAG_S / STEP_S)
    assert np.corrcoef(rate_deg_s[:-lag], rate_deg_s[lag:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.04)
    # Variance of the integral of a first-order process.
    for duration_s in (4.0, 20.0):
        steps = round(duration_s / STEP_S)
        variance = 2.0 * (duration_s - LAG_S * -math.expm1(-duration_s / LAG_S))
        assert np.var(heading_deg[steps:] - heading_deg[:-steps]) == pytest.approx(variance, rel=0.15)


def test_inner_steps_depend_on_the_disturbance():
    fast = LINEAR._replace(norrbin_s2=1e5)
    largest_rad_s = largest_rate_rad_s(10.0, LAG_S)
    assert largest_rad_s == pytest.approx(math.radians(6.0 * math.sqrt(10.0 / 8.0)))
    assert inner_steps(fast, STEP_S, disturbance_rad_s=largest_rad_s) > inner_steps(fast, STEP_S)
    plant = KtPlant(fast, STEP_S, disturbance_rad_s=largest_rad_s)
    plant.yaw_rate_rad_s = largest_rad_s
    plant.step(0.0)
    assert 0.0 < plant.yaw_rate_rad_s < largest_rad_s
