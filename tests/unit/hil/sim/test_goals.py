"""Parsing of goals."""

import pytest

from hil.sim.goals import MAX_GOALS, Goal, GoalError, parse_goals


def test_goals_are_parsed_in_order():
    assert parse_goals("0:0, 120:60,720.5:-90") == (Goal(0.0, 0.0), Goal(120.0, 60.0), Goal(720.5, -90.0))


INVALID = (
    "",
    "60",
    "a:b",
    "1:",
    ":1",
    "0:0,,5:5",
    "-1:0",
    "nan:0",
    "inf:0",
    "0:nan",
    "0:inf",
    "0:361",
    "0:1e300",
    "1e300:0",
)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        *[(text, "seconds:degrees") for text in INVALID],
        ("10:0,10:5", "order of time"),
        (",".join(f"{k}:0" for k in range(MAX_GOALS + 1)), "maximum"),
    ],
)
def test_invalid_goals_are_rejected(text, error):
    with pytest.raises(GoalError, match=error):
        parse_goals(text)
