"""Scores of a run of a campaign, defined like the figures of a run (hil/report/figures.py)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN, TWO_PI
from hil.lab.compiled import compiled
from hil.lab.twin.ship import Floats
from hil.report.figures import SECONDS_PER_HOUR, SETTLED_RAD, STEADY_AFTER_S
from hil.sim.truth import ROWS_PER_SECOND

RMS, MEAN, WORST, TRAVEL, OVERSHOOT, SETTLING = range(6)
STEADY_ROWS = round(STEADY_AFTER_S * ROWS_PER_SECOND)


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of a run: errors (heading minus goal) and rudder travel in the steady parts of all goals.

    `overshoot_deg` and `settling_s` are the maxima over all goals; `settling_s` is inf if a heading did not settle.
    """

    rms_deg: float
    mean_deg: float
    worst_deg: float
    travel_deg_per_h: float
    overshoot_deg: float
    settling_s: float


SCORE_NAMES = tuple(score_field.name for score_field in fields(Scores))


def scores_of(heading_rad: Floats, rudder_rad: Floats, goal_rad: Floats) -> Scores | None:
    """Compute the scores from ten rows per second; the goal is NaN before the first one. None without a steady goal."""
    results = np.zeros(6)
    if not _compute_scores(heading_rad, rudder_rad, goal_rad, results):
        return None
    rms, mean, worst, travel, overshoot, settling = results.tolist()
    return Scores(
        math.sqrt(rms) * DEGREES_PER_RADIAN,
        mean * DEGREES_PER_RADIAN,
        worst * DEGREES_PER_RADIAN,
        travel * DEGREES_PER_RADIAN * SECONDS_PER_HOUR * ROWS_PER_SECOND,
        overshoot * DEGREES_PER_RADIAN,
        settling / ROWS_PER_SECOND,
    )


@compiled
def _compute_scores(heading_rad: Floats, rudder_rad: Floats, goal_rad: Floats, results: Floats) -> bool:
    """Compute the scores in radians and rows into `results`, RMS as a mean square; return whether a goal is steady.

    A steady goal lasts at least two rows.
    """
    steady_rows, travel_rows, first = 0, 0, 0
    while first < goal_rad.size:
        last = first + 1
        while last < goal_rad.size and goal_rad[last] == goal_rad[first]:
            last += 1
        if last - first >= 2 and not math.isnan(goal_rad[first]):
            steady = _steady_from(first, last)
            _judge_goal(heading_rad, goal_rad[first], first, steady, last, results)
            for row in range(steady + 1, last):
                results[TRAVEL] += abs(rudder_rad[row] - rudder_rad[row - 1])
            steady_rows += last - steady
            travel_rows += last - steady - 1
        first = last
    if steady_rows == 0:
        return False
    results[RMS] /= steady_rows
    results[MEAN] /= steady_rows
    results[TRAVEL] /= travel_rows
    return True


@compiled
def _steady_from(first: int, last: int) -> int:
    """Return the first row of the steady part of the goal in rows [first, last); that part has at least two rows."""
    length = last - 1 - first
    steady = first + STEADY_ROWS if length > STEADY_ROWS else last - 1 - length // 3
    return min(steady, last - 2)


@compiled
def _judge_goal(heading_rad: Floats, goal_rad: float, first: int, steady: int, last: int, results: Floats) -> None:
    """Add the figures of one goal, rows [first, last) with the steady part from `steady`, to the results."""
    final_goal_rad = goal_rad + TWO_PI * math.floor((heading_rad[last - 1] - goal_rad) / TWO_PI + 0.5)
    step_rad = final_goal_rad - heading_rad[first]
    side, settled_row, overshoot_rad = math.copysign(1.0, step_rad), first, 0.0
    for row in range(first, last):
        error_rad = heading_rad[row] - goal_rad
        error_rad -= TWO_PI * math.floor(error_rad / TWO_PI + 0.5)
        if abs(error_rad) > SETTLED_RAD:
            settled_row = row + 1
        if row < steady:
            overshoot_rad = max(overshoot_rad, side * (heading_rad[row] - final_goal_rad))
        else:
            results[RMS] += error_rad * error_rad
            results[MEAN] += error_rad
            results[WORST] = max(results[WORST], abs(error_rad))
    if abs(step_rad) >= SETTLED_RAD:
        results[OVERSHOOT] = max(results[OVERSHOOT], overshoot_rad)
    results[SETTLING] = max(results[SETTLING], np.inf if settled_row == last else float(settled_row - first))
