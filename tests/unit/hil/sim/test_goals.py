"""Reading goals."""

import pytest

from hil.sim.goals import MAX_GOALS, Goal, GoalError, parse_goals


def test_goals_are_read_in_order():
    assert parse_goals("0:0, 120:60,720.5:-90") == (Goal(0.0, 0.0), Goal(120.0, 60.0), Goal(720.5, -90.0))


@pytest.mark.parametrize(
    "text",
    [
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
    ],
)
def test_invalid_goals_are_rejected_with_the_syntax(text):
    with pytest.raises(GoalError, match="seconds:degrees"):
        parse_goals(text)


def test_goals_out_of_order_are_rejected():
    with pytest.raises(GoalError, match="order of time"):
        parse_goals("10:0,10:5")


def test_the_number_of_goals_is_bounded():
    text = ",".join(f"{k}:0" for k in range(MAX_GOALS + 1))
    with pytest.raises(GoalError, match="maximum"):
        parse_goals(text)
