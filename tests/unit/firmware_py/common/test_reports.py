from firmware_py.common.reports import Activity, MissionState
from support.numbers import assert_mavlink_numbers, assert_stored_numbers


def test_mission_state_is_that_of_mavlink_and_activities_keep_their_numbers():
    assert_mavlink_numbers(MissionState, "MISSION_STATE_{}")
    assert_stored_numbers(Activity, "NOTHING HEADING LINE STATION CIRCLE")
