"""Table of modes: titles, failsafes, requirements."""

import itertools

from firmware_py.common.mode_table import (
    FAILSAFE_MODES,
    MODES,
    BaseMode,
    Mode,
    Need,
    RudderBy,
    StandardMode,
    failsafe_ladder,
)
from support.numbers import assert_mavlink_numbers, assert_stored_numbers


def test_modes_have_the_numbers_of_ardupilot_and_mavlink():
    assert_mavlink_numbers(Mode, "ROVER_MODE_{}")
    assert_mavlink_numbers(BaseMode, "MAV_MODE_FLAG_{}_ENABLED")
    assert_mavlink_numbers(StandardMode, "MAV_STANDARD_MODE_{}", NONE="NON_STANDARD")


def test_requirements_and_rudder_sources_keep_their_numbers():
    assert_stored_numbers(Need, "HEADING POSITION MISSION HOME")
    assert_stored_numbers(RudderBy, "NOTHING STICK HEADING")


def test_every_mode_has_a_title_of_at_most_34_characters():
    assert list(MODES) == list(Mode)
    assert all(row.title.startswith(mode.name) and len(row.title) <= 34 for mode, row in MODES.items())


def test_failsafe_values_are_consecutive_and_unique():
    assert list(FAILSAFE_MODES) == list(range(1, len(FAILSAFE_MODES) + 1))
    assert [mode for mode, row in MODES.items() if row.failsafe] == sorted(FAILSAFE_MODES.values())


def test_each_fallback_has_fewer_requirements():
    assert failsafe_ladder(Mode.RTL) == (Mode.RTL, Mode.LOITER, Mode.STEERING, Mode.HOLD)
    for mode in FAILSAFE_MODES.values():
        ladder = failsafe_ladder(mode)
        assert MODES[ladder[-1]].needs == ()
        for preferred, fallback in itertools.pairwise(ladder):
            assert set(MODES[fallback].needs) < set(MODES[preferred].needs)


def test_only_modes_with_heading_control_accept_goals_or_follow_tasks():
    for row in MODES.values():
        goals = row.heading_goals or row.position_goals or row.follows_task
        assert goals == (row.rudder_by is RudderBy.HEADING)
