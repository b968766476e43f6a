"""Deviation, heel error and lag of an uncorrected compass."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import degrees, radians
from hil.ship.compass_error import CompassErrors
from hil.ship.disturbances import Compass
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.waves import WaveYaw

STEP_S = 0.02


def compass(a=0.0, b=0.0, c=0.0, d=0.0, e=0.0, heel=0.0, lag=0.0):
    roll = WaveYaw(radians(heel), 6.0, STEP_S, NormalNumbers(generator(1, Stream.ROLL)))
    return CompassErrors(Compass(a, b, c, d, e, heel, lag), STEP_S, roll)


@pytest.mark.parametrize(
    ("coefficient", "headings_deg"), [("a", (0, 90, 200)), ("b", (90,)), ("c", (0,)), ("d", (45, 225)), ("e", (0, 180))]
)
def test_compass_reads_less_where_the_deviation_is_largest(coefficient, headings_deg):
    for heading_deg in headings_deg:
        output = compass(**{coefficient: 4.0}).output_rad(radians(heading_deg), 0.0)
        assert degrees(output) == pytest.approx(heading_deg - 4.0)


def test_deviation_is_the_sum_of_the_coefficients():
    device = compass(1.0, 4.0, -3.0, 1.5, 0.5)
    for heading_deg in range(0, 360, 7):
        x = radians(heading_deg)
        deviation = 1 + 4 * math.sin(x) - 3 * math.cos(x) + 1.5 * math.sin(2 * x) + 0.5 * math.cos(2 * x)
        assert degrees(device.output_rad(x, 0.01)) == pytest.approx(heading_deg - deviation)


def test_output_lags_in_a_turn():
    device, rate = compass(lag=2.0), 0.05
    for number in range(2000):
        extrapolated = device.output_rad(rate * (number + 1) * STEP_S, STEP_S)
        device.step(rate * (number + 1) * STEP_S)
        # The output is linear within a step; the error is of second order in the ratio of step and lag.
        assert device.output_rad(rate * (number + 1) * STEP_S, 0.0) == pytest.approx(extrapolated, abs=2e-5)
    assert rate * 2000 * STEP_S - device.output_rad(rate * 2000 * STEP_S, 0.0) == pytest.approx(rate * 2.0, rel=0.02)


def test_heel_error_is_largest_on_north_and_zero_on_east():
    device = compass(heel=3.0)
    output = np.empty((30_000, 2))
    for row in output:
        for _ in range(10):
            device.step(0.0)
        row[:] = device.output_rad(0.0, 0.0), device.output_rad(math.pi / 2, 0.0) - math.pi / 2
    assert degrees(np.std(output[:, 0])) == pytest.approx(3.0, rel=0.1)
    assert np.max(np.abs(output[:, 1])) < 1e-12
