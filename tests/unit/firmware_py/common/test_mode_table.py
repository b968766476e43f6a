import itertools

from firmware_py.common.mode_table import FAILSAFE_MODES, MODES, Mode, RudderBy, failsafe_ladder


def test_every_mode_has_a_row_and_a_title_that_fits_the_message_that_lists_it():
    assert list(MODES) == list(Mode)
    assert all(row.title.startswith(mode.name) and len(row.title) <= 34 for mode, row in MODES.items())


def test_the_values_of_failsafes_are_without_a_gap_and_each_leads_to_one_mode():
    assert list(FAILSAFE_MODES) == list(range(1, len(FAILSAFE_MODES) + 1))
    assert [mode for mode, row in MODES.items() if row.failsafe] == sorted(FAILSAFE_MODES.values())


def test_failsafe_ladders_need_less_at_each_step():
    assert failsafe_ladder(Mode.RTL) == (Mode.RTL, Mode.LOITER, Mode.STEERING, Mode.HOLD)
    for mode in FAILSAFE_MODES.values():
        ladder = failsafe_ladder(mode)
        assert MODES[ladder[-1]].needs == ()
        for better, worse in itertools.pairwise(ladder):
            assert set(MODES[worse].needs) < set(MODES[better].needs)


def test_only_a_mode_that_steers_takes_goals_or_follows_a_task():
    for row in MODES.values():
        goals = row.heading_goals or row.position_goals or row.follows_task
        assert goals == (row.rudder_by is RudderBy.HEADING)
