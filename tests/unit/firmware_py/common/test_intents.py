from firmware_py.common.intents import Verdict
from support.numbers import assert_mavlink_numbers


def test_verdicts_are_the_results_of_mavlink():
    assert_mavlink_numbers(Verdict, "MAV_RESULT_{}")
