"""Slew model of a rudder that is not measured."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate.rudder_slew import SlewSettings, begin, update

SETTINGS = SlewSettings(rate_rad_s=0.5, delay_s=0.25)


def run(state, commands, *, period_s=0.1, settings=SETTINGS, is_driven=True):
    """Return the angles after each tick; a command is sent at the end of the tick before."""
    angles = []
    for command_rad in commands:
        state = update(settings, state, command_rad, state.t_s + period_s, is_driven=is_driven)
        angles.append(state.angle_rad)
    return state, angles


def test_settings_of_the_parameters():
    settings = SlewSettings.of(ParameterSet())
    assert (settings.rate_rad_s, settings.delay_s) == pytest.approx((math.radians(60.0), 0.1))


def test_rudder_waits_for_the_dead_time_and_turns_at_the_rate():
    """The command of time 0 acts from 0.25 s on: 0.05 s of motion at 0.3 s."""
    _, angles = run(begin(0.0, 0.0, 0.0), [0.2] * 8)
    assert angles == pytest.approx([0.0, 0.0, 0.025, 0.075, 0.125, 0.175, 0.2, 0.2])


def test_turn_to_the_other_side():
    _, angles = run(begin(0.1, 0.1, 0.0), [-0.1] * 7)
    assert angles == pytest.approx([0.1, 0.1, 0.075, 0.025, -0.025, -0.075, -0.1])


def test_commands_within_a_tick_act_one_after_the_other():
    """Two commands act within one long tick: the first for 0.1 s."""
    settings = SlewSettings(rate_rad_s=0.5, delay_s=0.2)
    state, angles = run(begin(0.0, 0.0, 0.0), [1.0, -1.0], settings=settings)
    assert angles == [0.0, pytest.approx(0.0)]
    state = update(settings, state, -1.0, 1.0, is_driven=True)
    assert state.angle_rad == pytest.approx(0.05 - 0.5 * 0.7)


def test_rudder_that_is_not_driven_keeps_its_angle_and_then_follows_the_present_command():
    state, _ = run(begin(0.0, 0.0, 0.0), [0.2] * 4)
    state, angles = run(state, [0.3] * 5, is_driven=False)
    assert angles == [pytest.approx(0.075)] * 5
    assert state.pending == ()
    state, angles = run(state, [0.3] * 2)
    assert angles == pytest.approx([0.125, 0.175])


def test_no_dead_time():
    _, angles = run(begin(0.0, 0.0, 0.0), [0.2, 0.2], settings=SlewSettings(0.5, 0.0))
    assert angles == pytest.approx([0.05, 0.1])


def test_begin_is_at_the_angle_and_moves_to_the_command():
    _, angles = run(begin(0.2, 0.0, 5.0), [0.0] * 2)
    assert angles == pytest.approx([0.15, 0.1])


def test_number_of_delayed_commands_is_limited():
    settings = SlewSettings(rate_rad_s=10.0, delay_s=1.0)
    state, _ = run(
        begin(0.0, 0.0, 0.0), [0.001 * number for number in range(1, 200)], settings=settings, period_s=0.001
    )
    assert len(state.pending) == 64
    assert state.target_rad == pytest.approx(0.001 * (199 - 64))


@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 0.3)), max_size=60),
    st.floats(0.01, 5.0),
    st.floats(0.0, 1.0),
)
def test_angle_stays_between_the_commands_and_within_the_rate(steps, rate_rad_s, delay_s):
    settings, state = SlewSettings(rate_rad_s, delay_s), begin(0.0, 0.0, 0.0)
    low_rad = high_rad = 0.0
    for command_rad, step_s in steps:
        low_rad, high_rad = min(low_rad, command_rad), max(high_rad, command_rad)
        previous = state
        state = update(settings, state, command_rad, state.t_s + step_s, is_driven=True)
        assert low_rad <= state.angle_rad <= high_rad
        assert abs(state.angle_rad - previous.angle_rad) <= rate_rad_s * step_s + 1e-9
    last_rad = steps[-1][0] if steps else 0.0
    for _ in range(400):
        state = update(settings, state, last_rad, state.t_s + 1.0, is_driven=True)
    assert state.angle_rad == last_rad
    assert state.pending == ()
