"""Detection of a heading that does not converge with the rudder at its limit."""

import math

import pytest

from firmware_py.safety.convergence import DETECTION_TIME_S, IDLE, update

LIMIT_RAD = math.radians(30.0)


def reported_s(error_deg, rudder_deg, seconds=900):
    """Return the times [s] of the reports for an error and a rudder as functions of time."""
    state, times = IDLE, []
    for t_s in range(seconds):
        before = state
        error_rad, rudder_rad = math.radians(error_deg(t_s)), math.radians(rudder_deg(t_s))
        state = update(state, error_rad, rudder_rad, LIMIT_RAD, float(t_s))
        if state.not_converging and not before.not_converging:
            times.append(t_s)
    return times


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_is_reported_once_after_five_minutes_on_either_side(side):
    assert reported_s(lambda t: side * (70.0 + 4.0 * math.sin(t)), lambda _: side * 30.0) == [DETECTION_TIME_S]


@pytest.mark.parametrize(
    ("error_deg", "rudder_deg"),
    [
        (lambda _: 14.0, lambda _: 30.0),
        (lambda _: 70.0, lambda _: 27.0),
        (lambda _: 70.0, lambda _: -30.0),
        (lambda t: 180.0 - 0.03 * t, lambda _: 30.0),
        (lambda t: math.nan if t % 200 == 0 else 70.0, lambda _: 30.0),
    ],
    ids=["near", "rudder below its limit", "other side", "a turn of hours", "not steered meanwhile"],
)
def test_it_is_not_reported(error_deg, rudder_deg):
    assert reported_s(error_deg, rudder_deg) == []


def test_it_is_reported_again_after_the_error_decreased():
    assert reported_s(lambda t: 70.0 if t < 400 else 50.0, lambda _: 30.0) == [DETECTION_TIME_S, 400 + DETECTION_TIME_S]
