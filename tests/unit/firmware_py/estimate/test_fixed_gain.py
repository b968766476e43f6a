"""Fixed-gain observer: gains, limit of the yaw rate, prediction."""

import math

import pytest

from firmware_py.estimate import fixed_gain


@pytest.mark.parametrize(
    ("heading_rad", "measured_rad", "step_s", "limit_rad_s", "expected"),
    [
        (1.0, 1.3, 0.5, 9.0, (1.0 + 0.64 * 0.3, 0.02 + 0.16 * 0.3 / 0.5)),
        (1.3, 1.0, 0.5, 9.0, (1.3 - 0.64 * 0.3, 0.02 - 0.16 * 0.3 / 0.5)),
        (6.2, 0.1, 0.5, 9.0, (6.2 + 0.64 * (2.0 * math.pi - 6.1) - 2.0 * math.pi, 0.02 + 0.32 * (2.0 * math.pi - 6.1))),
        (1.0, 1.3, 0.5, 0.1, (1.0 + 0.64 * 0.3, 0.1)),
        (1.3, 1.0, 0.5, 0.05, (1.3 - 0.64 * 0.3, -0.05)),
        (1.0, 1.3, 0.0, 9.0, (1.0 + 0.64 * 0.3, 0.02)),
    ],
)
def test_correction_has_the_gains_of_a_double_pole(heading_rad, measured_rad, step_s, limit_rad_s, expected):
    result = fixed_gain.correct(heading_rad, 0.02, measured_rad, step_s, 0.6, limit_rad_s)
    wrapped_rad = result[0] if expected[0] >= 0.0 else result[0] - 2.0 * math.pi
    assert (wrapped_rad, result[1]) == pytest.approx(expected)
    assert 0.0 <= result[0] < 2.0 * math.pi


def test_prediction_is_the_solution_of_the_linear_model():
    decay, steady = math.exp(-3.0 / 4.0), 0.049 * 0.4
    heading_rad, rate_rad_s = fixed_gain.predict(6.27, 0.05, 0.4, 3.0, decay, 0.049, 4.0)
    assert rate_rad_s == pytest.approx(steady + (0.05 - steady) * decay)
    turned_rad = steady * 3.0 + (0.05 - steady) * 4.0 * (1.0 - decay)
    assert heading_rad == pytest.approx(6.27 + turned_rad - 2.0 * math.pi)
