"""Scores of a run, compared with the figures of the run report."""

import math

import numpy as np
import pytest

from hil.lab.campaign.scores import scores_of
from hil.report.figures import goal_figures, steady_rudder_travel_deg_per_h
from hil.sim.truth import Truth


def truth_of(heading_rad, rudder_rad, goal_rad):
    zeros = np.zeros(heading_rad.size)
    time_s = np.arange(heading_rad.size) / 10
    return Truth(time_s, heading_rad, zeros, zeros, rudder_rad, zeros, goal_rad, zeros, zeros, zeros)


@pytest.mark.parametrize("lengths", [(4000, 2500), (900, 700), (3, 2), (2001, 2002, 2003), (2, 5000)])
@pytest.mark.parametrize("rows_before", [0, 37])
@pytest.mark.parametrize("turn_rad", [0.0, -2.0 * math.pi, 4.0 * math.pi])
def test_scores_equal_the_figures_of_a_run(lengths, rows_before, turn_rad):
    random = np.random.default_rng(sum(lengths))
    goal_rad = np.concatenate([np.full(rows_before, np.nan), *(np.full(n, 0.4 * k) for k, n in enumerate(lengths))])
    heading_rad = np.nan_to_num(goal_rad) + np.cumsum(random.normal(0.0, 0.002, goal_rad.size))
    heading_rad[rows_before + lengths[0] + 1 :] += turn_rad  # changes the direction of the later turns
    rudder_rad = random.normal(0.0, 0.1, goal_rad.size)
    scores = scores_of(heading_rad, rudder_rad, goal_rad)
    figures = goal_figures([truth_of(heading_rad, rudder_rad, goal_rad)])
    counts = np.array([round((goal.steady_to_s - goal.steady_from_s) * 10) + 1 for goal in figures])
    rms = math.sqrt(np.average([goal.rms_error_deg**2 for goal in figures], weights=counts))
    assert scores.rms_deg == pytest.approx(rms)
    assert scores.worst_deg < 30.0
    assert scores.mean_deg == pytest.approx(np.average([goal.mean_error_deg for goal in figures], weights=counts))
    assert scores.travel_deg_per_h == pytest.approx(steady_rudder_travel_deg_per_h(figures))
    assert scores.overshoot_deg == pytest.approx(max(goal.overshoot_deg for goal in figures))
    settling = max(math.inf if goal.settling_s is None else goal.settling_s for goal in figures)
    assert scores.settling_s == pytest.approx(settling)


def test_worst_error_is_that_of_the_steady_part():
    goal_rad, heading_rad = np.zeros(3000), np.full(3000, 0.1)
    heading_rad[100], heading_rad[2500] = 2.0, -0.5
    assert scores_of(heading_rad, goal_rad, goal_rad).worst_deg == pytest.approx(math.degrees(0.5))


def test_run_without_a_goal_has_no_scores():
    assert scores_of(np.zeros(50), np.zeros(50), np.full(50, np.nan)) is None
    assert scores_of(np.zeros(1), np.zeros(1), np.zeros(1)) is None
