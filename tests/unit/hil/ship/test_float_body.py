"""Transition matrix and responses of the float that follows the glider."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from hil.ship.float_body import FollowingFloat, transition


@pytest.mark.parametrize("damping", [0.05, 0.6, 1.0, 2.5])
@pytest.mark.parametrize("natural_rad_s", [0.2, 1.0])
def test_transition_is_the_matrix_exponential(natural_rad_s, damping):
    companion = np.array([[0.0, 1.0], [-(natural_rad_s**2), -2.0 * damping * natural_rad_s]])
    assert np.array(transition(natural_rad_s, damping, 0.02)) == pytest.approx(expm(0.02 * companion), abs=1e-12)


@pytest.mark.parametrize("natural_rad_s", [0.3, 0.8])
@pytest.mark.parametrize("share", [0.3, 1.0, 3.0])
def test_frequency_response_equals_the_transfer_function(natural_rad_s, share):
    damping, step_s = 0.6, 0.02
    omega = share * natural_rad_s
    body = FollowingFloat(natural_rad_s, damping, step_s)
    transient = round(60.0 / natural_rad_s / step_s)
    count = round(3.0 * 2.0 * math.pi / omega / step_s)
    total = 0.0j
    for number in range(transient + count):
        body.step(math.sin(omega * (number + 0.5) * step_s))
        if number >= transient:
            total += body.heading_rad * np.exp(-1j * omega * (number + 1) * step_s) * step_s
    response = 2.0j * total / (count * step_s)
    expected = 1.0 / complex(1.0 - share**2, 2.0 * damping * share)
    assert abs(response) == pytest.approx(abs(expected), rel=0.01)
    assert np.angle(response / expected) == pytest.approx(0.0, abs=0.02)


def test_step_response_has_the_overshoot_of_the_damping():
    body = FollowingFloat(0.3, 0.6, 0.02)
    headings = []
    for _ in range(5000):
        body.step(1.0)
        headings.append(body.heading_rad)
    assert max(headings) - 1.0 == pytest.approx(math.exp(-math.pi * 0.6 / math.sqrt(1.0 - 0.36)), rel=0.01)
    assert headings[-1] == pytest.approx(1.0, abs=1e-6)


def test_float_lags_in_a_steady_turn():
    body, rate = FollowingFloat(0.3, 0.6, 0.02), 0.02
    for number in range(5000):
        body.step(rate * (number + 0.5) * 0.02)
    glider_rad = rate * 5000 * 0.02
    assert glider_rad - body.heading_rad == pytest.approx(rate * 2.0 * 0.6 / 0.3, rel=1e-3)
    assert body.yaw_rate_rad_s == pytest.approx(rate, rel=1e-4)
    assert body.yaw_acceleration(glider_rad) == pytest.approx(0.0, abs=1e-5)
