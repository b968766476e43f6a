"""The figures of constructed truths."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from hil.lab.compare.score import score_of, turns_of
from hil.report.figures import (
    goal_figures,
    goal_spans,
    rudder_travel_deg_per_h,
    steady_rudder_travel_deg_per_h,
    unwrapped_goals_rad,
)
from hil.sim.truth import COLUMNS, Truth


def truth(heading_deg, goal_deg, rudder_deg=None) -> Truth:
    heading = np.radians(np.asarray(heading_deg, dtype=float))
    zero = np.zeros(heading.size)
    rudder = zero if rudder_deg is None else np.radians(np.asarray(rudder_deg, dtype=float))
    goal = np.radians(np.asarray(goal_deg, dtype=float))
    return Truth(np.arange(heading.size) / 10.0, heading, heading, zero, rudder, rudder, goal, zero, zero, zero)


def step_to(final_deg: float, past_deg: float, seconds: float, steady_deg: float) -> list[float]:
    """Return a ramp of 10 s beyond the goal and one back to it, then a constant error of steady_deg."""
    rows = np.concatenate(
        (
            np.linspace(0.0, final_deg + past_deg, 101),
            np.linspace(final_deg + past_deg, final_deg, 100),
            np.full(int(seconds * 10) - 201, final_deg + steady_deg),
        )
    )
    return rows.tolist()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_and_steady_error_are_measured(sign):
    heading = [sign * value for value in step_to(60.0, 4.0, 400.0, -1.5)]
    (figures,) = goal_figures((truth(heading, [sign * 60.0] * 4000),))
    assert figures.step_deg == pytest.approx(sign * 60.0)
    assert figures.overshoot_deg == pytest.approx(4.0)
    assert figures.mean_error_deg == pytest.approx(-1.5 * sign)
    assert figures.rms_error_deg == pytest.approx(1.5)
    assert figures.p95_error_deg == pytest.approx(1.5)
    assert figures.steady_from_s == 200.0
    assert figures.steady_to_s == pytest.approx(399.9)
    # 4 deg beyond the goal at 10.0 s, within 3 deg 2.5 s later.
    assert figures.settling_s == pytest.approx(12.6, abs=0.11)


@pytest.mark.parametrize(("goal_deg", "sign"), [(180.0, -1.0), (-170.0, 1.0), (170.0, -1.0)])
def test_turn_of_half_a_circle_in_the_other_direction_is_no_error(goal_deg, sign):
    step_deg = goal_deg + sign * 360.0
    heading = [math.copysign(value, sign) for value in step_to(abs(step_deg), 4.0, 400.0, 1.5)]
    whole = truth(heading, [goal_deg] * 4000)
    (figures,) = goal_figures((whole,))
    assert figures.step_deg == pytest.approx(step_deg)
    assert figures.overshoot_deg == pytest.approx(4.0)
    assert figures.mean_error_deg == pytest.approx(1.5 * sign)
    assert figures.rms_error_deg == pytest.approx(1.5)
    assert figures.settling_s == pytest.approx(12.6, abs=0.2)
    assert unwrapped_goals_rad(whole) == pytest.approx(math.radians(step_deg))
    score = score_of(whole)
    assert (score.rms_deg, score.overshoot_deg) == pytest.approx((1.5, 4.0))
    assert score.near_s == pytest.approx(10.0, abs=1.0)
    assert [turn.overshoot_deg for turn in turns_of(whole)] == pytest.approx([4.0])


def test_goal_that_is_not_reached_has_no_overshoot_and_no_settling():
    (figures,) = goal_figures((truth(np.linspace(0.0, 50.0, 3000), [60.0] * 3000),))
    assert figures.overshoot_deg == 0.0
    assert figures.settling_s is None


def test_goal_without_a_step_is_settled_at_once():
    heading = 1.0 + np.sin(np.arange(3000) / 50.0)
    (figures,) = goal_figures((truth(heading, [0.0] * 3000),))
    assert figures.overshoot_deg == 0.0
    assert figures.settling_s == 0.0


def test_each_constant_goal_is_a_span():
    goal = [math.nan] * 10 + [0.0] * 20 + [60.0] * 30 + [-90.0]
    assert goal_spans(np.radians(goal)) == [(10, 30), (30, 60), (60, 61)]
    figures = goal_figures((truth([0.0] * 61, goal),))
    assert [(round(figure.goal_deg), figure.t_s) for figure in figures] == [(0, 1.0), (60, 3.0)]


def test_steady_part_of_a_short_goal_is_its_last_third():
    (figures,) = goal_figures((truth([0.0] * 901, [0.0] * 901),))
    assert figures.steady_from_s == pytest.approx(60.0)


def test_rudder_travel_is_that_of_the_steady_part():
    triangle = np.abs((np.arange(4001) % 20) - 10)  # 10 deg down and up every two seconds
    assert rudder_travel_deg_per_h(np.arange(4001) / 10.0, np.radians(triangle)) == pytest.approx(10.0 * 3600.0)
    early_travel = np.where(np.arange(4001) < 1000, triangle, 0.0)
    run = truth([0.0] * 4001, [0.0] * 4001, early_travel)
    assert steady_rudder_travel_deg_per_h(goal_figures((run,))) == 0.0
    assert rudder_travel_deg_per_h(run.time_s, run.rudder_rad) > 0.0


def test_empty_truth_has_no_figures():
    assert goal_figures((truth([], []),)) == ()
    assert steady_rudder_travel_deg_per_h(goal_figures((truth([0.0], [math.nan]),))) is None


@pytest.mark.parametrize("rows", [1, 7, 64, 1001, 5000])
def test_figures_do_not_depend_on_the_pieces(rows):
    rng = np.random.default_rng(rows)
    goal = [math.nan] * 9 + [0.0] * 2300 + [40.0] * 1 + [60.0] * 31 + [-90.0] * 4000 + [0.0] * 2
    heading = np.asarray(goal) + 20.0 * np.exp(-np.arange(len(goal)) / 900.0) + rng.normal(0.0, 2.0, len(goal))
    whole = truth(np.nan_to_num(heading), goal, rng.normal(0.0, 5.0, len(goal)))
    cuts = range(0, len(goal), rows)
    pieces = [Truth(*(getattr(whole, name)[cut : cut + rows] for name in COLUMNS)) for cut in cuts]
    figures = goal_figures(pieces)
    assert [round(figure.goal_deg) for figure in figures] == [0, 60, -90, 0]
    for figure, expected in zip(figures, goal_figures((whole,)), strict=True):
        assert figure.settling_s == expected.settling_s
        numbers, others = (list(asdict(replace(each, settling_s=0.0)).values()) for each in (figure, expected))
        assert numbers == pytest.approx(others, rel=1e-12)
    steady = np.degrees(np.abs(whole.heading_low_rad - whole.goal_rad))[9 + 2332 + 2000 : 9 + 2332 + 4000]
    assert figures[2].p95_error_deg == pytest.approx(np.percentile(steady, 95.0), rel=1e-12)
