import math

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from firmware_py.safety.oscillation import (
    NO_HALF,
    OscillationInput,
    OscillationState,
    is_large,
    update,
    with_reduced_gain,
    with_relaxation,
)

DETECTION_EVIDENCE = 25.0
HOLD_S = 600.0
MAX_EVIDENCE = 50.0
MAX_HOLD_S = 86400.0
MAX_REDUCTION = 16.0
REDUCTION_STEP = 8.0
WAIT_HALF_CYCLES = 2.0

MODEL = KtModel.of(ParameterSet())


def rad(degrees):
    return math.radians(degrees)


class Monitor:
    """The monitor; `reports`: (time [s], new value) of each change of `oscillating`."""

    def __init__(self):
        self.state, self.t_s, self.reports = OscillationState(), 0.0, []

    def run(
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
        """Run with errors [deg] as a function of time, and a rudder proportional to them.

        `ratio_1_s` is the growth of the evidence of a delay per second.
        """
        start_s = self.t_s
        for _ in range(round(10 * seconds)):
            now_s = self.t_s - start_s
            error, goal = error_deg(now_s), goal_deg(now_s)
            rudder_rad = rad(gain * (0.0 if math.isnan(error) else error)) + 0.1
            inputs = OscillationInput(
                rad(error), rad(goal), rad(sd_deg), rudder_rad, 0.1, speed_m_s, wave_s, 0.1 * ratio_1_s
            )
            previous, self.state = self.state.oscillating, update(MODEL, self.state, inputs, self.t_s)
            if self.state.oscillating is not previous:
                self.reports.append((self.t_s, self.state.oscillating))
            self.t_s += 0.1
        return self


def sine(amplitude_deg, period_s):
    return lambda t_s: amplitude_deg * math.sin(2.0 * math.pi * t_s / period_s)


def test_cycle_with_evidence_of_a_delay_is_a_limit_cycle_and_reduces_the_gain():
    monitor = Monitor().run(200.0, sine(5.0, 30.0))
    assert [is_oscillating for _, is_oscillating in monitor.reports] == [True]
    assert 15.0 < monitor.reports[0][0] < 30.0  # the first half cycle counts as a turn
    assert monitor.state.gain_reduction == MAX_REDUCTION


@pytest.mark.parametrize("ratio_1_s", [-1.0, 0.0, 0.02])
def test_cycle_without_evidence_of_a_delay_is_not_detected(ratio_1_s):
    monitor = Monitor().run(1200.0, sine(5.0, 30.0), ratio_1_s=ratio_1_s)
    assert monitor.reports == []
    assert monitor.state.evidence == pytest.approx(max(0.0, 1200.0 * ratio_1_s))


def test_evidence_is_limited_and_decreases_with_negative_ratios():
    monitor = Monitor().run(100.0, lambda _t_s: 0.1)
    assert monitor.state.evidence == MAX_EVIDENCE
    monitor.run((MAX_EVIDENCE - DETECTION_EVIDENCE) / 2.0 + 1.0, lambda _t_s: 0.1, ratio_1_s=-2.0)
    assert monitor.state.evidence < DETECTION_EVIDENCE
    assert monitor.run(16.0, sine(5.0, 30.0), ratio_1_s=0.0).reports == []


def test_oscillation_that_continues_reduces_the_gain_by_a_second_step():
    """With 8 as the maximum, a boat with a very slow float continued to oscillate by 10 to 40 deg."""
    assert Monitor().run((1.0 + WAIT_HALF_CYCLES) * 15.0, sine(5.0, 30.0)).state.gain_reduction == REDUCTION_STEP
    monitor = Monitor().run((3.0 + WAIT_HALF_CYCLES) * 15.0, sine(5.0, 30.0))
    assert monitor.state.gain_reduction == MAX_REDUCTION
    assert [is_oscillating for _, is_oscillating in monitor.reports] == [True]


def test_single_half_cycle_after_a_turn_with_reduced_gain_is_no_limit_cycle():
    monitor = Monitor().run(25.0, sine(5.0, 30.0)).run(60.0, lambda _t_s: 0.1)
    assert [is_oscillating for _, is_oscillating in monitor.reports] == [True, False]
    monitor.run(30.0, lambda t_s: 60.0 - 2.0 * t_s, goal_deg=lambda _t_s: 60.0)
    monitor.run(15.0, sine(-7.0, 30.0), goal_deg=lambda _t_s: 60.0)
    monitor.run(15.0, lambda _t_s: 0.5, goal_deg=lambda _t_s: 60.0)
    assert len(monitor.reports) == 2
    assert monitor.state.gain_reduction == REDUCTION_STEP


def test_alternating_goal_is_no_limit_cycle():
    """Each change of the goal changes the side of the error, and begins a half cycle that is a turn."""
    monitor = Monitor()
    for side in (-1, 1) * 10:
        error_deg = lambda t_s, side=side: side * max(8.0 - 0.8 * t_s, -1.0)  # noqa: E731
        monitor.run(30.0, error_deg, goal_deg=lambda _t_s, side=side: 4.0 * side)
    assert monitor.reports == []


def test_limit_cycle_ends_with_the_oscillation_and_the_reduction_decays_over_tens_of_minutes():
    monitor = Monitor().run(50.0, sine(5.0, 30.0)).run(60.0, lambda _t_s: 0.1)
    assert [is_oscillating for _, is_oscillating in monitor.reports] == [True, False]
    gain_reduction = monitor.state.gain_reduction
    assert gain_reduction == REDUCTION_STEP
    assert monitor.run(HOLD_S - 120.0, lambda _t_s: 0.1).state.gain_reduction == gain_reduction
    assert 2.0 < monitor.run(1320.0, lambda _t_s: 0.1).state.gain_reduction < 3.0
    assert monitor.run(1320.0, lambda _t_s: 0.1).state.gain_reduction == 1.0


def test_hold_time_doubles_with_each_return_of_the_limit_cycle():
    monitor, holds_s = Monitor(), []
    for _ in range(12):
        monitor.run(50.0, sine(5.0, 30.0))
        holds_s.append(monitor.state.hold_s)
        monitor.run(100.0, lambda _t_s: 0.1)
        # Skip the hold time, to the start of the decay.
        monitor.state = monitor.state._replace(gain_reduction=2.0, half=NO_HALF)
        monitor.t_s += monitor.state.hold_s
    assert holds_s[:3] == [HOLD_S, 2.0 * HOLD_S, 4.0 * HOLD_S]
    assert holds_s[-1] == MAX_HOLD_S
    monitor.t_s += 9.0 * MAX_HOLD_S
    assert monitor.run(50.0, sine(5.0, 30.0)).state.hold_s == HOLD_S


def test_oscillation_at_the_lowest_gain_keeps_the_hold_time():
    monitor = Monitor().run(300.0, sine(5.0, 30.0))
    assert (monitor.state.gain_reduction, monitor.state.hold_s) == (MAX_REDUCTION, HOLD_S)


@pytest.mark.parametrize(
    ("error_deg", "options"),
    [
        pytest.param(sine(2.0, 30.0), {"sd_deg": 2.0}, id="within the heading uncertainty"),
        pytest.param(sine(1.2, 30.0), {"sd_deg": 0.1}, id="amplitude of about a degree"),
        pytest.param(sine(5.0, 8.0), {"wave_s": 8.0, "speed_m_s": 0.9}, id="period of the waves"),
        pytest.param(sine(5.0, 8.0), {}, id="faster than possible for the boat"),
        pytest.param(sine(5.0, 30.0), {"gain": 0.2}, id="small rudder"),
        pytest.param(lambda t_s: 5.0 + 5.0 * math.sin(t_s / 5.0), {}, id="error of one sign"),
        pytest.param(sine(5.0, 30.0), {"goal_deg": sine(5.0, 30.0)}, id="oscillating goal"),
        pytest.param(lambda _t_s: math.nan, {}, id="not steered to a heading"),
    ],
)
def test_no_limit_cycle(error_deg, options):
    monitor = Monitor().run(1200.0, error_deg, **options)
    assert monitor.reports == []
    assert monitor.state.gain_reduction == 1.0


LAG_S = MODEL.turning_lag_s
INPUTS = OscillationInput(0.0, 0.0, rad(0.5), 0.1, 0.1, MODEL.speed_m_s, 4.0, 0.0)


@pytest.mark.parametrize(
    ("error_deg", "time_s", "changes", "expected"),
    [
        (1.51, 60.0, {}, True),
        (1.49, 60.0, {}, False),
        (4.01, 60.0, {"heading_sd_rad": rad(2.0)}, True),
        (3.99, 60.0, {"heading_sd_rad": rad(2.0)}, False),
        (5.0, 1.51 * LAG_S, {}, True),
        (5.0, 1.49 * LAG_S, {}, False),
        (5.0, 3.01 * LAG_S, {"speed_m_s": 0.5 * MODEL.speed_m_s}, True),
        (5.0, 2.99 * LAG_S, {"speed_m_s": 0.5 * MODEL.speed_m_s}, False),
        (5.0, 15.1 * LAG_S, {"speed_m_s": 0.0}, True),  # at least a tenth of the speed of the model
        (5.0, 14.9 * LAG_S, {"speed_m_s": 0.0}, False),
        (5.0, 15.1, {"wave_period_s": 20.0}, True),
        (5.0, 14.9, {"wave_period_s": 20.0}, False),
    ],
)
def test_half_cycle_counts_if_it_is_larger_and_longer_than_by_other_causes(error_deg, time_s, changes, expected):
    assert is_large(MODEL, INPUTS._replace(**changes), rad(error_deg), time_s) is expected


@pytest.mark.parametrize(
    ("now_s", "oscillating", "gain_reduction"),
    [
        (114.9, True, 8.0),
        (115.1, False, 8.0),  # 1.5 half cycles without one that counts
        (699.9, False, 8.0),
        (700.1, False, 8.0 * math.exp(-0.5 / 1200.0)),
    ],
)
def test_limit_cycle_ends_and_the_gain_reduction_decays_after_the_hold_time(now_s, oscillating, gain_reduction):
    state = OscillationState(
        length_s=10.0, oscillating=True, gain_reduction=8.0, hold_s=600.0, last_cycle_s=100.0, updated_s=now_s - 0.5
    )
    later = with_relaxation(state, 3.0, now_s)
    assert (later.oscillating, later.evidence, later.updated_s) == (oscillating, 3.0, now_s)
    assert later.gain_reduction == pytest.approx(gain_reduction, rel=1e-9)
    skipped = with_relaxation(state._replace(updated_s=now_s - 60.0), 3.0, now_s).gain_reduction
    assert skipped == pytest.approx(8.0 * math.exp(-1.0 / 1200.0) if now_s > 700.0 else 8.0, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "gain_reduction", "hold_s"),
    [
        ({}, 8.0, 600.0),
        ({"reduced_s": 980.1}, 1.0, 0.0),  # the last step has not had two half cycles of 10 s
        ({"reduced_s": 979.9}, 8.0, 600.0),
        ({"gain_reduction": 7.9}, 8.0, 600.0),
        ({"gain_reduction": 8.0}, 16.0, 600.0),
        ({"gain_reduction": 16.0, "hold_s": 700.0}, 16.0, 700.0),
        ({"hold_s": 120.0, "last_cycle_s": 45.1}, 8.0, 240.0),  # it has returned within eight hold times
        ({"hold_s": 120.0, "last_cycle_s": 44.9}, 8.0, 600.0),
        ({"hold_s": 120.0, "last_cycle_s": 45.1, "oscillating": True}, 8.0, 120.0),
        ({"hold_s": 50_000.0, "last_cycle_s": 45.1}, 8.0, 86_400.0),
    ],
)
def test_step_of_the_gain_reduction_and_its_hold_time(changes, gain_reduction, hold_s):
    half = NO_HALF._replace(begun_s=1000.0)
    state = OscillationState(half, length_s=10.0, evidence=30.0)._replace(**changes)
    later = with_reduced_gain(state, half, 1005.0)
    assert (later.gain_reduction, later.hold_s, later.oscillating) == (gain_reduction, hold_s, True)
    assert (later.length_s, later.last_cycle_s) == (10.0, 1005.0)  # twice the time to the peak
    has_stepped = gain_reduction != state.gain_reduction
    assert (later.evidence, later.reduced_s) == ((0.0, 1005.0) if has_stepped else (30.0, state.reduced_s))


@pytest.mark.parametrize(
    ("error_deg", "sd_deg", "goal_deg", "half"),
    [
        (-0.29, 0.1, 0.0, None),
        (-0.31, 0.1, 0.0, NO_HALF._replace(begun_s=50.0, side=-1.0, follows=True)),
        (-0.79, 2.0, 0.0, None),
        (-0.81, 2.0, 1.4, NO_HALF._replace(begun_s=50.0, side=-1.0, goal_rad=rad(1.4), follows=True)),
        (-0.81, 2.0, 1.6, NO_HALF._replace(begun_s=50.0, side=-1.0, goal_rad=rad(1.6), is_turn=True, follows=True)),
    ],
)
def test_half_cycle_begins_at_a_fifth_of_the_smallest_error_on_the_other_side(error_deg, sd_deg, goal_deg, half):
    present = NO_HALF._replace(begun_s=40.0, side=1.0, peak_rad=rad(5.0), rudder_rad=0.1, counts=True)
    inputs = INPUTS._replace(error_rad=rad(error_deg), heading_sd_rad=rad(sd_deg), goal_rad=rad(goal_deg))
    later = update(MODEL, OscillationState(present, updated_s=49.9), inputs, 50.0)
    assert later.half == (present if half is None else half)


@pytest.mark.parametrize(("error_deg", "side"), [(0.0, 1.0), (0.1, 1.0), (-0.1, -1.0)])
def test_first_half_cycle_is_a_turn_to_the_side_of_the_error(error_deg, side):
    inputs = INPUTS._replace(error_rad=rad(error_deg), goal_rad=1.0)
    later = update(MODEL, OscillationState(), inputs, 50.0)
    assert later.half == NO_HALF._replace(begun_s=50.0, side=side, goal_rad=1.0, is_turn=True)
    assert (later.goal_rad, later.updated_s) == (1.0, 50.0)


@pytest.mark.parametrize(
    ("rudder_deg", "goal_deg", "counts"), [(2.1, 0.7, True), (1.9, 0.7, False), (2.1, 0.8, False), (2.1, -0.8, False)]
)
def test_half_cycle_counts_with_a_rudder_to_its_side_and_a_constant_goal(rudder_deg, goal_deg, counts):
    half = NO_HALF._replace(begun_s=0.0, side=1.0, peak_rad=rad(4.0))
    inputs = INPUTS._replace(error_rad=rad(5.0), goal_rad=rad(goal_deg), rudder_rad=0.1 + rad(rudder_deg))
    later = update(MODEL, OscillationState(half, updated_s=49.9), inputs, 50.0)
    assert (later.half.counts, later.half.peak_rad) == (counts, rad(5.0))
    assert later.half.rudder_rad == pytest.approx(rad(rudder_deg))


def test_error_of_nan_ends_the_limit_cycle_and_keeps_the_gain_reduction():
    monitor = Monitor().run(50.0, sine(5.0, 30.0)).run(1.0, lambda _t_s: math.nan)
    assert not monitor.state.oscillating
    assert monitor.state.gain_reduction == REDUCTION_STEP
    assert monitor.state.half == NO_HALF
