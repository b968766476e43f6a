"""Detection of a heading that does not converge with the rudder at its limit."""

import math

import pytest

from firmware_py.safety.convergence import IDLE, update

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
    assert report_times_s(lambda t: side * (70.0 + 4.0 * math.sin(t)), lambda _: side * 30.0) == [300]


@pytest.mark.parametrize(
    ("error_deg", "rudder_deg"),
    [
        (lambda _: 14.9, lambda _: 30.0),
        (lambda _: 70.0, lambda _: 28.4),
        (lambda _: 70.0, lambda _: -30.0),
        (lambda t: 180.0 - 0.03 * t, lambda _: 30.0),
        (lambda t: math.nan if t % 200 == 0 else 70.0, lambda _: 30.0),
    ],
    ids=["small error", "rudder below its limit", "rudder to the other side", "slow turn", "not steered for a tick"],
)
def test_no_report_unless_all_conditions_are_met(error_deg, rudder_deg):
    assert report_times_s(error_deg, rudder_deg) == []


@pytest.mark.parametrize("error_deg", [15.1, 70.0, 180.0])
def test_rudder_is_at_its_limit_from_95_percent(error_deg):
    assert report_times_s(lambda _: error_deg, lambda _: 28.6) == [300]


@pytest.mark.parametrize(("decrease_deg", "restart_s"), [(4.9, 0), (5.1, 200)])
def test_decrease_of_the_error_by_5_deg_restarts_the_time(decrease_deg, restart_s):
    times_s = report_times_s(lambda t: 70.0 if t < 200 else 70.0 - decrease_deg, lambda _: 30.0, seconds=600)
    assert times_s == [restart_s + 300]


def test_convergence_after_a_report_ends_it():
    assert report_times_s(lambda t: 70.0 if t < 400 else 50.0, lambda _: 30.0) == [300, 400 + 300]
