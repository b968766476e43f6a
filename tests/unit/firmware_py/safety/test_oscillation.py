import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from firmware_py.safety.oscillation import (
    DETECTION_EVIDENCE,
    HOLD_S,
    MAX_EVIDENCE,
    MAX_HOLD_S,
    MAX_REDUCTION,
    NO_HALF,
    REDUCTION_STEP,
    WAIT_HALF_CYCLES,
    OscillationInput,
    OscillationState,
    update,
)

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
        speed_m_s=0.4,
        wave_s=4.0,
        ratio_1_s=2.0,
    ):
        """Update with errors [deg] by time and a rudder that follows them; `reports` are the changes of the verdict.

        `ratio_1_s` is by how much the evidence of a delay grows in a second.
        """
        begun_s = self.t_s
        for _ in range(round(10 * seconds)):
            now_s = self.t_s - begun_s
            error, goal = error_deg(now_s), goal_deg(now_s)
            rudder_rad = rad(gain * (0.0 if math.isnan(error) else error)) + 0.1
            given = OscillationInput(
                rad(error), rad(goal), rad(sd_deg), rudder_rad, 0.1, speed_m_s, wave_s, 0.1 * ratio_1_s
            )
            was, self.state = self.state.oscillating, update(MODEL, self.state, given, self.t_s)
            if self.state.oscillating is not was:
                self.reports.append((self.t_s, self.state.oscillating))
            self.t_s += 0.1
        return self


def swings(amplitude_deg, period_s):
    return lambda t_s: amplitude_deg * math.sin(2.0 * math.pi * t_s / period_s)


def test_a_cycle_of_a_boat_that_responds_late_is_a_limit_cycle_and_reduces_the_gain():
    watch = Watch().see(200.0, swings(5.0, 30.0))
    assert [oscillates for _, oscillates in watch.reports] == [True]
    assert 15.0 < watch.reports[0][0] < 30.0  # the first half cycle counts as a turn
    assert watch.state.gain_reduction == MAX_REDUCTION


@pytest.mark.parametrize("ratio_1_s", [-1.0, 0.0, 0.02])
def test_without_evidence_of_a_delay_no_cycle_is_detected(ratio_1_s):
    watch = Watch().see(1200.0, swings(5.0, 30.0), ratio_1_s=ratio_1_s)
    assert watch.reports == []
    assert watch.state.evidence == pytest.approx(max(0.0, 1200.0 * ratio_1_s))


def test_the_evidence_is_bounded_and_counter_evidence_lowers_it_again():
    watch = Watch().see(100.0, lambda _t_s: 0.1)
    assert watch.state.evidence == MAX_EVIDENCE
    assert (
        watch.see((MAX_EVIDENCE - DETECTION_EVIDENCE) / 2.0 + 1.0, lambda _t_s: 0.1, ratio_1_s=-2.0).state.evidence
        < DETECTION_EVIDENCE
    )
    assert watch.see(16.0, swings(5.0, 30.0), ratio_1_s=0.0).reports == []


def test_an_oscillation_that_continues_reduces_the_gain_by_a_second_step():
    """With 8 as the maximum, a boat with a very slow float continued to oscillate by 10 to 40 deg."""
    assert Watch().see((1.0 + WAIT_HALF_CYCLES) * 15.0, swings(5.0, 30.0)).state.gain_reduction == REDUCTION_STEP
    watch = Watch().see((3.0 + WAIT_HALF_CYCLES) * 15.0, swings(5.0, 30.0))
    assert watch.state.gain_reduction == MAX_REDUCTION
    assert [oscillates for _, oscillates in watch.reports] == [True]


def test_with_a_reduced_gain_one_half_cycle_beyond_a_turn_is_no_limit_cycle():
    watch = Watch().see(25.0, swings(5.0, 30.0)).see(60.0, lambda _t_s: 0.1)
    assert [oscillates for _, oscillates in watch.reports] == [True, False]
    watch.see(30.0, lambda t_s: 60.0 - 2.0 * t_s, goal_deg=lambda _t_s: 60.0)
    watch.see(15.0, swings(-7.0, 30.0), goal_deg=lambda _t_s: 60.0)
    watch.see(15.0, lambda _t_s: 0.5, goal_deg=lambda _t_s: 60.0)
    assert len(watch.reports) == 2
    assert watch.state.gain_reduction == REDUCTION_STEP


def test_a_goal_that_alternates_is_no_limit_cycle():
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
    gain_reduction = watch.state.gain_reduction
    assert gain_reduction == REDUCTION_STEP
    assert watch.see(HOLD_S - 120.0, lambda _t_s: 0.1).state.gain_reduction == gain_reduction
    assert 2.0 < watch.see(1320.0, lambda _t_s: 0.1).state.gain_reduction < 3.0
    assert watch.see(1320.0, lambda _t_s: 0.1).state.gain_reduction == 1.0


def test_the_hold_time_doubles_with_each_return_of_the_limit_cycle():
    watch, holds_s = Watch(), []
    for _ in range(12):
        watch.see(50.0, swings(5.0, 30.0))
        holds_s.append(watch.state.hold_s)
        watch.see(100.0, lambda _t_s: 0.1)
        # Hours are skipped: only that the gain has begun to rise matters.
        watch.state = watch.state._replace(gain_reduction=2.0, half=NO_HALF)
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
        ("the rudder has no part in it", swings(5.0, 30.0), {"gain": 0.2}),
        ("all to one side", lambda t_s: 5.0 + 5.0 * math.sin(t_s / 5.0), {}),
        ("a goal that is moved to and fro", swings(5.0, 30.0), {"goal_deg": swings(5.0, 30.0)}),
        ("no heading to steer for", lambda _t_s: math.nan, {}),
    ],
)
def test_no_limit_cycle(why, error_deg, more):
    watch = Watch().see(1200.0, error_deg, **more)
    assert watch.reports == [], why
    assert watch.state.gain_reduction == 1.0


def test_a_pause_in_steering_ends_it_and_keeps_the_gain_reduction():
    watch = Watch().see(50.0, swings(5.0, 30.0)).see(1.0, lambda _t_s: math.nan)
    assert not watch.state.oscillating
    assert watch.state.gain_reduction == REDUCTION_STEP


def test_an_error_of_nan_clears_the_half_cycle():
    watch = Watch().see(80.0, swings(5.0, 30.0)).see(1.0, lambda _t_s: math.nan)
    assert watch.state.half == NO_HALF
