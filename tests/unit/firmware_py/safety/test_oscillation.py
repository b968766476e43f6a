import math
import random

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from firmware_py.safety.oscillation import (
    HOLD_S,
    MAX_HOLD_S,
    MAX_REDUCTION,
    NO_HALF,
    PATIENT_HALVES,
    REDUCTION_STEP,
    OscillationInput,
    OscillationState,
    update,
)
from firmware_py.safety.turn_delay import MAX_EVIDENCE, MIN_EVIDENCE

MODEL = KtModel.of(ParameterSet())
LAG_S = 4.0  # of the model at its own speed


def rad(degrees):
    return math.radians(degrees)


class Watch:
    """The monitor, tick by tick."""

    def __init__(self):
        self.state, self.t_s, self.reports = OscillationState(), 0.0, []

    def see(
        self,
        seconds,
        error_deg,
        sd_deg=0.5,
        goal_deg=lambda _t_s: 0.0,
        gain=4.0,
        pushed=0.6,
        speed_m_s=0.4,
        wave_s=4.0,
        diffusion_rad2_s=0.0,
    ):
        """Update with errors [deg] by time and a rudder that follows them; `reports` are the changes of the verdict.

        `pushed` is the part of the rudder that the estimate takes for a bias.
        """
        begun_s = self.t_s
        for _ in range(round(10 * seconds)):
            now_s = self.t_s - begun_s
            error, goal = error_deg(now_s), goal_deg(now_s)
            beside_rad = rad(gain * (0.0 if math.isnan(error) else error))
            given = OscillationInput(
                rad(error), rad(goal), rad(sd_deg), beside_rad + 0.1, 0.1,
                pushed * beside_rad, speed_m_s, wave_s, diffusion_rad2_s,
            )  # fmt: skip
            was, self.state = self.state.oscillating, update(MODEL, self.state, given, self.t_s)
            if self.state.oscillating is not was:
                self.reports.append((self.t_s, self.state.oscillating))
            self.t_s += 0.1
        return self


def swings(amplitude_deg, period_s):
    return lambda t_s: amplitude_deg * math.sin(2.0 * math.pi * t_s / period_s)


def test_a_plain_cycle_is_a_limit_cycle_and_reduces_the_gain():
    watch = Watch().see(200.0, swings(5.0, 30.0))
    assert [oscillates for _, oscillates in watch.reports] == [True]
    assert 30.0 < watch.reports[0][0] < 1.5 * 30.0  # in the second complete half cycle
    assert watch.state.gain_reduction == MAX_REDUCTION


def test_an_oscillation_that_continues_reduces_the_gain_by_a_second_step():
    """With 8 as the maximum, a boat with a very slow float continued to oscillate by 10 to 40 deg."""
    assert REDUCTION_STEP < MAX_REDUCTION
    assert Watch().see(45.0, swings(5.0, 30.0)).state.gain_reduction == REDUCTION_STEP
    assert Watch().see((2.4 + PATIENT_HALVES) * 15.0, swings(5.0, 30.0)).state.gain_reduction == REDUCTION_STEP
    watch = Watch().see((4.4 + PATIENT_HALVES) * 15.0, swings(5.0, 30.0))
    assert watch.state.gain_reduction == MAX_REDUCTION
    assert [oscillates for _, oscillates in watch.reports] == [True]


@pytest.mark.parametrize(("amplitude_deg", "sd_deg", "gain"), [(5.0, 0.5, 1.5), (2.9, 1.4, 4.0)])
def test_smaller_half_cycles_take_more_of_them(amplitude_deg, sd_deg, gain):
    watch = Watch().see(400.0, swings(amplitude_deg, 30.0), sd_deg=sd_deg, gain=gain)
    assert 3.0 * 30.0 < watch.reports[0][0] < 7.0 * 30.0


def test_a_goal_that_jumps_to_and_fro_is_no_limit_cycle():
    """Each jump changes the side of the error at once, and the half cycle that it begins is a turn."""
    watch, at_s = Watch(), 0
    while at_s < 600:
        side = 1 if at_s // 30 % 2 else -1
        ahead = lambda t_s, side=side: side * max(8.0 - 0.8 * t_s, -1.0)  # noqa: E731 - as the others
        watch.see(30.0, ahead, goal_deg=lambda _t_s, side=side: 4.0 * side)
        at_s += 30
    assert watch.reports == []


def test_it_ends_with_the_oscillation_and_the_gain_rises_over_tens_of_minutes():
    watch = Watch().see(50.0, swings(5.0, 30.0)).see(60.0, lambda _t_s: 0.1)
    assert [oscillates for _, oscillates in watch.reports] == [True, False]
    softness = watch.state.gain_reduction
    assert softness == REDUCTION_STEP
    assert watch.see(HOLD_S - 120.0, lambda _t_s: 0.1).state.gain_reduction == softness
    assert 2.0 < watch.see(1320.0, lambda _t_s: 0.1).state.gain_reduction < 3.0
    assert watch.see(1320.0, lambda _t_s: 0.1).state.gain_reduction == 1.0


def test_the_hold_time_doubles_with_each_return_of_the_limit_cycle():
    watch, holds_s = Watch(), []
    for _ in range(12):
        watch.see(50.0, swings(5.0, 30.0))
        holds_s.append(watch.state.hold_s)
        watch.see(100.0, lambda _t_s: 0.1)
        # Hours are skipped: only that the gain has begun to rise matters.
        watch.state = watch.state._replace(gain_reduction=2.0, half=NO_HALF, weight=0.0)
        watch.t_s += watch.state.hold_s
    assert holds_s[:3] == [HOLD_S, 2.0 * HOLD_S, 4.0 * HOLD_S]
    assert holds_s[-1] == MAX_HOLD_S
    watch.t_s += 9.0 * MAX_HOLD_S
    assert watch.see(50.0, swings(5.0, 30.0)).state.hold_s == HOLD_S


def test_an_oscillation_at_the_lowest_gain_keeps_the_hold_time():
    watch = Watch().see(300.0, swings(5.0, 30.0))
    assert (watch.state.gain_reduction, watch.state.hold_s) == (MAX_REDUCTION, HOLD_S)


@pytest.mark.parametrize(
    ("why", "error_deg", "more"),
    [
        ("as small as the estimate is uncertain", swings(2.0, 30.0), {"sd_deg": 2.0}),
        ("no more than a degree", swings(1.2, 30.0), {"sd_deg": 0.1}),
        ("as fast as the waves", swings(5.0, 8.0), {"wave_s": 8.0, "speed_m_s": 0.9}),
        ("faster than the boat can", swings(5.0, 8.0), {}),
        ("slower than a limit cycle: trim and wind", swings(5.0, 150.0), {}),
        ("the rudder has no part in it", swings(5.0, 30.0), {"gain": 0.2}),
        ("the rudder turns the boat as it should", swings(5.0, 30.0), {"pushed": 0.02}),
        ("all to one side", lambda t_s: 5.0 + 5.0 * math.sin(t_s / 5.0), {}),
        ("a goal that is moved to and fro", swings(5.0, 30.0), {"goal_deg": swings(5.0, 30.0)}),
        ("an oscillation that dies away", lambda t_s: 20.0 * math.exp(-t_s / 15.0) * math.cos(t_s / 5.0), {}),
        ("no heading to steer for", lambda _t_s: math.nan, {}),
    ],
)
def test_no_limit_cycle(why, error_deg, more):
    watch = Watch().see(1200.0, error_deg, **more)
    assert watch.reports == [], why
    assert watch.state.gain_reduction == 1.0


def test_irregular_errors_are_the_sea():
    source, at_s, sign, halves = random.Random(4), 0.0, 1, []
    while at_s < 3600.0:
        at_s, sign = at_s + source.choice((8.0, 20.0, 35.0)), -sign
        halves.append((at_s, sign * source.choice((2.0, 5.0, 9.0))))

    def error_deg(t_s):
        return next(peak for until_s, peak in halves if t_s < until_s)

    assert Watch().see(3590.0, error_deg, sd_deg=1.4, gain=1.5).reports == []


def test_a_commanded_turn_clears_the_sum():
    watch = Watch()
    for turn in range(12):
        goal_deg = 60.0 * turn
        watch.see(33.0, swings(5.0, 30.0), goal_deg=lambda _t_s, goal_deg=goal_deg: goal_deg)
    assert watch.reports == []


def test_a_pause_in_steering_ends_it_and_keeps_the_gain_reduction():
    watch = Watch().see(50.0, swings(5.0, 30.0)).see(1.0, lambda _t_s: math.nan)
    assert not watch.state.oscillating
    assert watch.state.gain_reduction == REDUCTION_STEP


@pytest.mark.parametrize(("late_s", "evidence", "reported"), [(1.0, MIN_EVIDENCE, []), (16.0, MAX_EVIDENCE, [True])])
def test_after_a_late_turn_one_plain_half_cycle_is_enough(late_s, evidence, reported):
    """The boat turns by 60 deg after late_s, with the rudder over, and overshoots."""
    watch = Watch().see(20.0, lambda _t_s: 0.0)
    sails = lambda t_s: min(60.0, 60.0 - 1.4 * (t_s - late_s))  # noqa: E731 - as the others
    watch.see(43.0 + late_s, sails, goal_deg=lambda _t_s: 60.0, gain=0.5)
    watch.see(18.0, swings(-7.0, 36.0), goal_deg=lambda _t_s: 60.0)
    watch.see(2.0, lambda _t_s: 1.0, goal_deg=lambda _t_s: 60.0)
    assert [oscillates for _, oscillates in watch.reports] == reported
    assert watch.state.turn_delay.evidence == (0.0 if reported else evidence)


def test_an_error_of_nan_clears_the_half_cycle():
    watch = Watch().see(80.0, swings(5.0, 30.0)).see(1.0, lambda _t_s: math.nan)
    assert watch.state.half == NO_HALF
    assert watch.state.weight == 0.0


def test_the_error_that_disturbances_explain_is_no_limit_cycle():
    assert Watch().see(400.0, swings(5.0, 30.0), diffusion_rad2_s=0.1 * rad(1.0) ** 2).reports
    assert not Watch().see(400.0, swings(5.0, 30.0), diffusion_rad2_s=6.0 * rad(1.0) ** 2).reports
