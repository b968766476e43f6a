"""The figures of a run, from the truth alone: pure functions on arrays.

An error is heading less goal, so a boat that a rudder offset pushes to port of its goal
has a negative mean. Headings are the hull's, without the yaw of the waves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from firmware_py.common.angles import degrees, radians
from hil.sim.truth import Array, Truth

SETTLED_RAD = radians(3.0)
STEADY_AFTER_S = 200.0
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class GoalFigures:
    """One goal, from when it was due until the next one or the end.

    `overshoot_deg` is how far past the goal the boat goes, in the direction of the step, before
    `steady_from_s`; 0 for a step smaller than 3 deg. `settling_s` is when, counted from the
    goal's start, the boat was outside of +-3 deg for the last time; None when it still is at the
    end. The errors and the rudder travel are of the steady part, which begins 200 s after
    the goal, or with the last third of a goal that does not last that long.
    """

    t_s: float
    goal_deg: float
    step_deg: float
    steady_from_s: float
    steady_to_s: float
    overshoot_deg: float
    settling_s: float | None
    mean_error_deg: float
    rms_error_deg: float
    p95_error_deg: float
    rudder_travel_deg_per_h: float


def goal_figures(truth: Truth) -> tuple[GoalFigures, ...]:
    """Return the figures of every goal in the truth that lasts for at least two rows."""
    spans = goal_spans(truth.goal_rad)
    return tuple(_figures_of(truth, first, last) for first, last in spans if last - first >= 2)


def goal_spans(goal_rad: Array) -> list[tuple[int, int]]:
    """Return [first, last) rows of each stretch of a constant goal; rows without a goal are left out."""
    if goal_rad.size == 0:
        return []
    changes = np.flatnonzero(goal_rad[1:] != goal_rad[:-1]) + 1  # NaN differs from itself: split, then dropped
    bounds = [0, *changes.tolist(), goal_rad.size]
    return [(first, last) for first, last in pairwise(bounds) if not np.isnan(goal_rad[first])]


def rudder_travel_deg_per_h(time_s: Array, rudder_rad: Array) -> float:
    """Return how far the rudder turned, up and down, by the hour; 0 for fewer than two rows."""
    if time_s.size < 2:
        return 0.0
    travel_rad = float(np.sum(np.abs(np.diff(rudder_rad))))
    return degrees(travel_rad) * SECONDS_PER_HOUR / float(time_s[-1] - time_s[0])


def steady_rudder_travel_deg_per_h(truth: Truth) -> float | None:
    """Return the rudder travel over the steady parts of all goals together; None without any."""
    travel_deg = hours = 0.0
    for goal in goal_figures(truth):
        share_h = (goal.steady_to_s - goal.steady_from_s) / SECONDS_PER_HOUR
        travel_deg += goal.rudder_travel_deg_per_h * share_h
        hours += share_h
    return travel_deg / hours if hours > 0.0 else None


def _figures_of(truth: Truth, first: int, last: int) -> GoalFigures:
    time_s = truth.time_s[first:last]
    error_rad = truth.heading_low_rad[first:last] - truth.goal_rad[first:last]
    start_s, end_s = float(time_s[0]), float(time_s[-1])
    length_s = end_s - start_s
    steady_s = start_s + STEADY_AFTER_S if length_s > STEADY_AFTER_S else end_s - length_s / 3.0
    steady = int(np.searchsorted(time_s, steady_s - 1e-9))
    steady = min(steady, time_s.size - 2)
    steady_rad = error_rad[steady:]
    return GoalFigures(
        t_s=start_s,
        goal_deg=degrees(float(truth.goal_rad[first])),
        step_deg=degrees(float(truth.goal_rad[first] - truth.heading_low_rad[first])),
        steady_from_s=float(time_s[steady]),
        steady_to_s=end_s,
        overshoot_deg=degrees(overshoot_rad(error_rad[:steady])),
        settling_s=settling_s(time_s, error_rad),
        mean_error_deg=degrees(float(np.mean(steady_rad))),
        rms_error_deg=degrees(float(np.sqrt(np.mean(np.square(steady_rad))))),
        p95_error_deg=degrees(float(np.percentile(np.abs(steady_rad), 95.0))),
        rudder_travel_deg_per_h=rudder_travel_deg_per_h(time_s[steady:], truth.rudder_rad[first + steady : last]),
    )


def overshoot_rad(error_rad: Array) -> float:
    """Return how far the error goes beyond zero, away from where it started; 0 for hardly any step."""
    if error_rad.size == 0 or abs(error_rad[0]) < SETTLED_RAD:
        return 0.0
    past_rad = -np.sign(error_rad[0]) * error_rad
    return max(0.0, float(np.max(past_rad)))


def settling_s(time_s: Array, error_rad: Array) -> float | None:
    """Return when the error was outside of 3 deg for the last time, from the first row; None when it still is."""
    outside = np.flatnonzero(np.abs(error_rad) > SETTLED_RAD)
    if outside.size == 0:
        return 0.0
    if outside[-1] == error_rad.size - 1:
        return None
    return float(time_s[outside[-1] + 1] - time_s[0])
