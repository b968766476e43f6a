"""Detection of a heading that does not converge with the rudder at its limit."""

import math

import pytest

from firmware_py.safety.convergence import IDLE, update

DETECTION_TIME_S = 300.0

LIMIT_RAD = math.radians(30.0)


def report_times_s(error_deg, rudder_deg, seconds=900):
    """Return the times of the reports [s]; error and rudder are functions of time."""
    state, times = IDLE, []
    for t_s in range(seconds):
        previous = state
        error_rad, rudder_rad = math.radians(error_deg(t_s)), math.radians(rudder_deg(t_s))
        state = update(state, error_rad, rudder_rad, LIMIT_RAD, float(t_s))
        if state.not_converging and not previous.not_converging:
            times.append(t_s)
    return times


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_large_error_at_full_rudder_is_reported_once_after_5_min(side):
    assert report_times_s(lambda t: side * (70.0 + 4.0 * math.sin(t)), lambda _: side * 30.0) == [DETECTION_TIME_S]


@pytest.mark.parametrize(
    ("error_deg", "rudder_deg"),
    [
        (lambda _: 14.0, lambda _: 30.0),
        (lambda _: 70.0, lambda _: 27.0),
        (lambda _: 70.0, lambda _: -30.0),
        (lambda t: 180.0 - 0.03 * t, lambda _: 30.0),
        (lambda t: math.nan if t % 200 == 0 else 70.0, lambda _: 30.0),
    ],
    ids=["small error", "rudder below its limit", "rudder to the other side", "slow turn", "not steered for a tick"],
)
def test_converging_heading_is_not_reported(error_deg, rudder_deg):
    assert report_times_s(error_deg, rudder_deg) == []


def test_decrease_of_the_error_restarts_the_time():
    assert report_times_s(lambda t: 70.0 if t < 400 else 50.0, lambda _: 30.0) == [
        DETECTION_TIME_S,
        400 + DETECTION_TIME_S,
    ]
