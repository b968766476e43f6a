from firmware_py.common import intents
from support.stored_numbers import assert_mavlink_numbers, assert_missing_values_are_empty


def test_verdicts_are_the_results_of_mavlink():
    assert_mavlink_numbers(intents.Verdict, "MAV_RESULT_{}")


def test_missing_values_of_a_request_are_empty():
    assert_missing_values_are_empty(intents)
