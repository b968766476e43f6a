import math

import pytest

from firmware_py.common.angles import radians
from firmware_py.safety.turn_order import is_enough, is_order, ordered_s

OVER_RAD, OFF_RAD = radians(20.0), radians(60.0)


@pytest.mark.parametrize(
    ("over_deg", "error_deg", "orders"),
    [
        (12.5, 15.5, True),
        (-12.5, -15.5, True),
        (11.5, 60.0, False),
        (30.0, 14.5, False),
        (30.0, -60.0, False),  # it stops a turn
        (12.5, math.nan, True),  # by hand
        (11.5, math.nan, False),
    ],
)
def test_a_rudder_far_over_toward_a_far_goal_commands_a_turn(over_deg, error_deg, orders):
    assert is_order(radians(over_deg), radians(error_deg)) is orders


def test_a_command_is_timed_to_its_side_and_again_to_the_other():
    assert ordered_s(0.0, OVER_RAD, OFF_RAD, 2.0) == 2.0
    assert ordered_s(6.0, OVER_RAD, OFF_RAD, 2.0) == 8.0
    assert ordered_s(6.0, -OVER_RAD, -OFF_RAD, 2.0) == -2.0
    assert ordered_s(-6.0, -OVER_RAD, -OFF_RAD, 2.0) == -8.0
    assert ordered_s(6.0, 0.0, OFF_RAD, 2.0) == 0.0


@pytest.mark.parametrize(
    ("telling_s", "expected_deg", "sd_deg", "lag_s", "enough"),
    [
        (21.0, 15.5, 1.0, 4.0, True),
        (19.0, 90.0, 1.0, 4.0, False),
        (21.0, 14.5, 1.0, 4.0, False),
        (21.0, 32.5, 4.0, 4.0, True),
        (21.0, 31.5, 4.0, 4.0, False),
        (31.0, 90.0, 1.0, 10.0, True),
        (29.0, 90.0, 1.0, 10.0, False),
        (math.inf, 90.0, math.inf, 4.0, False),
    ],
)
def test_it_takes_time_and_a_turn_that_the_heading_could_not_have_missed(
    telling_s, expected_deg, sd_deg, lag_s, enough
):
    assert is_enough(telling_s, radians(expected_deg), radians(sd_deg), lag_s) is enough
