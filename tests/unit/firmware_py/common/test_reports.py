from firmware_py.common import reports
from firmware_py.common.reports import Activity, MissionState
from support.stored_numbers import assert_mavlink_numbers, assert_missing_values_are_empty, assert_stored_numbers


def test_mission_state_is_that_of_mavlink_and_activities_keep_their_numbers():
    assert_mavlink_numbers(MissionState, "MISSION_STATE_{}")
    assert_stored_numbers(Activity, "NOTHING HEADING LINE STATION CIRCLE")


def test_missing_values_of_a_report_are_empty():
    assert_missing_values_are_empty(reports, state=MissionState.NO_MISSION, prediction_square=1.0, gain_reduction=1.0)
