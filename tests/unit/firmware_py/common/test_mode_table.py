"""Table of modes: titles, failsafes, requirements."""

import itertools

from firmware_py.common import mode_table
from firmware_py.common.mode_table import (
    BaseMode,
    Mode,
    Need,
    RudderBy,
    StandardMode,
    failsafe_ladder,
)
from support.stored_numbers import assert_mavlink_numbers, assert_stored_numbers


def test_modes_have_the_numbers_of_ardupilot_and_mavlink():
    assert_mavlink_numbers(Mode, "ROVER_MODE_{}")
    assert_mavlink_numbers(BaseMode, "MAV_MODE_FLAG_{}_ENABLED")
    assert_mavlink_numbers(StandardMode, "MAV_STANDARD_MODE_{}", NONE="NON_STANDARD")


def test_requirements_and_rudder_sources_keep_their_numbers():
    assert_stored_numbers(Need, "HEADING POSITION MISSION HOME")
    assert_stored_numbers(RudderBy, "NOTHING STICK HEADING")


def test_every_mode_has_a_title_of_at_most_34_characters():
    assert list(mode_table.MODES) == list(Mode)
    assert all(row.title.startswith(mode.name) and len(row.title) <= 34 for mode, row in mode_table.MODES.items())


def test_failsafe_parameters_keep_their_values():
    assert mode_table.FAILSAFE_MODES == {1: Mode.HOLD, 2: Mode.STEERING, 3: Mode.LOITER, 4: Mode.RTL}


def test_each_fallback_has_fewer_requirements():
    assert failsafe_ladder(Mode.RTL) == (Mode.RTL, Mode.LOITER, Mode.STEERING, Mode.HOLD)
    for mode in mode_table.FAILSAFE_MODES.values():
        ladder = failsafe_ladder(mode)
        assert mode_table.MODES[ladder[-1]].needs == ()
        for preferred, fallback in itertools.pairwise(ladder):
            assert set(mode_table.MODES[fallback].needs) < set(mode_table.MODES[preferred].needs)


def test_only_modes_with_heading_control_accept_goals_or_follow_tasks():
    for row in mode_table.MODES.values():
        goals = row.heading_goals or row.position_goals or row.follows_task
        assert goals == (row.rudder_by is RudderBy.HEADING)
