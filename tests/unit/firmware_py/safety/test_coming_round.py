"""Whether she comes to her heading with her rudder hard over."""

import math

import pytest

from firmware_py.safety.coming_round import PATIENCE_S, update

LIMIT_RAD = math.radians(30.0)


def told_s(error_deg, rudder_deg, seconds=900):
    """When it is told, each second, of an error and a rudder by the time."""
    state, found = None, []
    for t_s in range(seconds):
        error = error_deg(t_s)
        before = state
        state = update(
            state, None if error is None else math.radians(error), math.radians(rudder_deg(t_s)), LIMIT_RAD, float(t_s)
        )
        if state is not None and state.told and not (before is not None and before.told):
            found.append(t_s)
    return found


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_is_told_once_after_five_minutes_on_either_side(side):
    assert told_s(lambda t: side * (70.0 + 4.0 * math.sin(t)), lambda _: side * 30.0) == [PATIENCE_S]


@pytest.mark.parametrize(
    ("error_deg", "rudder_deg"),
    [
        (lambda _: 14.0, lambda _: 30.0),
        (lambda _: 70.0, lambda _: 27.0),
        (lambda _: 70.0, lambda _: -30.0),
        (lambda t: 180.0 - 0.03 * t, lambda _: 30.0),
        (lambda t: None if t % 200 == 0 else 70.0, lambda _: 30.0),
    ],
    ids=["near", "rudder to spare", "other side", "a turn of hours", "not steered meanwhile"],
)
def test_it_is_not_told(error_deg, rudder_deg):
    assert told_s(error_deg, rudder_deg) == []


def test_it_is_told_anew_after_she_came_nearer():
    assert told_s(lambda t: 70.0 if t < 400 else 50.0, lambda _: 30.0) == [PATIENCE_S, 400 + PATIENCE_S]
