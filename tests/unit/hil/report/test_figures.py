"""The figures of hand-made truths."""

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
    turned_goals_rad,
)
from hil.sim.truth import COLUMNS, Truth


def truth(heading_deg, goal_deg, rudder_deg=None) -> Truth:
    heading = np.radians(np.asarray(heading_deg, dtype=float))
    zero = np.zeros(heading.size)
    rudder = zero if rudder_deg is None else np.radians(np.asarray(rudder_deg, dtype=float))
    goal = np.radians(np.asarray(goal_deg, dtype=float))
    return Truth(np.arange(heading.size) / 10.0, heading, heading, zero, rudder, rudder, goal, zero, zero, zero)


def step_to(final_deg: float, past_deg: float, seconds: float, steady_deg: float) -> list[float]:
    """A ramp of 10 s past the goal, back to it in 10 s, then steady_deg off it."""
    rows = np.concatenate(
        (
            np.linspace(0.0, final_deg + past_deg, 101),
            np.linspace(final_deg + past_deg, final_deg, 100),
            np.full(int(seconds * 10) - 201, final_deg + steady_deg),
        )
    )
    return rows.tolist()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_and_steady_error(sign):
    heading = [sign * value for value in step_to(60.0, 4.0, 400.0, -1.5)]
    (figures,) = goal_figures((truth(heading, [sign * 60.0] * 4000),))
    assert figures.step_deg == pytest.approx(sign * 60.0)
    assert figures.overshoot_deg == pytest.approx(4.0)
    assert figures.mean_error_deg == pytest.approx(-1.5 * sign)
    assert figures.rms_error_deg == pytest.approx(1.5)
    assert figures.p95_error_deg == pytest.approx(1.5)
    assert figures.steady_from_s == 200.0
    assert figures.steady_to_s == pytest.approx(399.9)
    # 4 deg past at 10.0 s, inside of 3 deg a quarter of ten seconds later.
    assert figures.settling_s == pytest.approx(12.6, abs=0.11)


@pytest.mark.parametrize(("goal_deg", "sign"), [(180.0, -1.0), (-170.0, 1.0), (170.0, -1.0)])
def test_turn_in_the_other_direction(goal_deg, sign):
    """As by a compass that is off, where the goal lies about half a turn away."""
    round_deg = goal_deg + sign * 360.0
    heading = [math.copysign(value, sign) for value in step_to(abs(round_deg), 4.0, 400.0, 1.5)]
    whole = truth(heading, [goal_deg] * 4000)
    (figures,) = goal_figures((whole,))
    assert figures.step_deg == pytest.approx(round_deg)
    assert figures.overshoot_deg == pytest.approx(4.0)
    assert figures.mean_error_deg == pytest.approx(1.5 * sign)
    assert figures.rms_error_deg == pytest.approx(1.5)
    assert figures.settling_s == pytest.approx(12.6, abs=0.2)
    assert turned_goals_rad(whole) == pytest.approx(math.radians(round_deg))
    score = score_of(whole)
    assert (score.rms_deg, score.overshoot_deg) == pytest.approx((1.5, 4.0))
    assert score.near_s == pytest.approx(10.0, abs=1.0)
    assert [turn.overshoot_deg for turn in turns_of(whole)] == pytest.approx([4.0])


def test_no_overshoot_and_no_settling():
    (figures,) = goal_figures((truth(np.linspace(0.0, 50.0, 3000), [60.0] * 3000),))
    assert figures.overshoot_deg == 0.0
    assert figures.settling_s is None


def test_goal_without_a_step():
    heading = 1.0 + np.sin(np.arange(3000) / 50.0)
    (figures,) = goal_figures((truth(heading, [0.0] * 3000),))
    assert figures.overshoot_deg == 0.0
    assert figures.settling_s == 0.0


def test_spans_of_goals():
    goal = [math.nan] * 10 + [0.0] * 20 + [60.0] * 30 + [-90.0]
    assert goal_spans(np.radians(goal)) == [(10, 30), (30, 60), (60, 61)]
    figures = goal_figures((truth([0.0] * 61, goal),))
    assert [round(each.goal_deg) for each in figures] == [0, 60]
    assert [each.t_s for each in figures] == [1.0, 3.0]


def test_steady_part_of_a_short_goal():
    (figures,) = goal_figures((truth([0.0] * 901, [0.0] * 901),))
    assert figures.steady_from_s == pytest.approx(60.0)


def test_rudder_travel_of_the_steady_part():
    triangle = np.abs((np.arange(4001) % 20) - 10)  # 10 deg down and up every two seconds
    assert rudder_travel_deg_per_h(np.arange(4001) / 10.0, np.radians(triangle)) == pytest.approx(10.0 * 3600.0)
    moved_early = np.where(np.arange(4001) < 1000, triangle, 0.0)
    made = truth([0.0] * 4001, [0.0] * 4001, moved_early)
    assert steady_rudder_travel_deg_per_h(goal_figures((made,))) == 0.0
    assert rudder_travel_deg_per_h(made.time_s, made.rudder_rad) > 0.0


def test_empty_truth():
    assert goal_figures((truth([], []),)) == ()
    assert steady_rudder_travel_deg_per_h(goal_figures((truth([0.0], [math.nan]),))) is None


@pytest.mark.parametrize("rows", [1, 7, 64, 1001, 5000])
def test_figures_do_not_depend_on_the_pieces(rows):
    chances = np.random.default_rng(rows)
    goal = [math.nan] * 9 + [0.0] * 2300 + [40.0] * 1 + [60.0] * 31 + [-90.0] * 4000 + [0.0] * 2
    heading = np.asarray(goal) + 20.0 * np.exp(-np.arange(len(goal)) / 900.0) + chances.normal(0.0, 2.0, len(goal))
    whole = truth(np.nan_to_num(heading), goal, chances.normal(0.0, 5.0, len(goal)))
    cuts = range(0, len(goal), rows)
    pieces = [Truth(*(getattr(whole, name)[cut : cut + rows] for name in COLUMNS)) for cut in cuts]
    found = goal_figures(pieces)
    assert [round(one.goal_deg) for one in found] == [0, 60, -90, 0]
    for one, expected in zip(found, goal_figures((whole,)), strict=True):
        assert one.settling_s == expected.settling_s
        numbers, others = (list(asdict(replace(each, settling_s=0.0)).values()) for each in (one, expected))
        assert numbers == pytest.approx(others, rel=1e-12)
    steady = np.degrees(np.abs(whole.heading_low_rad - whole.goal_rad))[9 + 2332 + 2000 : 9 + 2332 + 4000]
    assert found[2].p95_error_deg == pytest.approx(np.percentile(steady, 95.0), rel=1e-12)
