"""Compute the score of a run from its truth, for the task in docs/explanation/physics.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import degrees, radians
from hil.report.figures import (
    STEADY_AFTER_S,
    goal_spans,
    heading_error_rad,
    overshoot_rad,
    rudder_travel_deg_per_h,
    unwrapped_goal_rad,
)
from hil.sim.truth import Array, Truth

NEAR_RAD = radians(5.0)
SETTLED_S = 100.0  # a turn has settled if the error is within NEAR_RAD for this time
MIN_GOAL_S = STEADY_AFTER_S + 100.0  # shorter goals have no steady part


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a run, or mean over several runs: heading errors and rudder travel in the steady parts.

    `overshoot_deg` and `near_s`, the time until the heading is first within 5 deg of the goal, are those of the first
    turn; both are 0 without a turn, and `near_s` is inf if that heading is never reached.
    """

    rms_deg: float
    travel_deg_per_h: float
    mean_deg: float
    overshoot_deg: float
    near_s: float


def score_of(truth: Truth) -> Score:
    """Compute the score from the goals that last at least MIN_GOAL_S; raise ValueError without such a goal."""
    spans = [(first, last) for first, last in goal_spans(truth.goal_rad) if _length_s(truth, first, last) >= MIN_GOAL_S]
    if not spans:
        raise ValueError(f"no goal lasts for {MIN_GOAL_S:g} s")
    errors, travel_deg, hours = [], 0.0, 0.0
    for first, last in spans:
        steady_start = first + int(
            np.searchsorted(truth.time_s[first:last], truth.time_s[first] + STEADY_AFTER_S - 1e-9)
        )
        errors.append(heading_error_rad(truth.heading_low_rad[steady_start:last], truth.goal_rad[steady_start:last]))
        duration_h = _length_s(truth, steady_start, last) / 3600.0
        travel_deg += duration_h * rudder_travel_deg_per_h(
            truth.time_s[steady_start:last], truth.rudder_rad[steady_start:last]
        )
        hours += duration_h
    error_rad = np.concatenate(errors)
    turn = _first_turn(truth, spans)
    return Score(
        degrees(float(np.sqrt(np.mean(np.square(error_rad))))),
        travel_deg / hours,
        degrees(float(np.mean(error_rad))),
        *turn,
    )


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn; `settled_s` is the start of the first 100 s with an error within 5 deg, inf if there are none."""

    overshoot_deg: float
    settled_s: float


def turns_of(truth: Truth) -> tuple[Turn, ...]:
    """Return the turns of a run: goals that last at least MIN_GOAL_S and start more than 5 deg from the heading."""
    turns = []
    for first, last in goal_spans(truth.goal_rad):
        error_rad = _turn_error_rad(truth, first, last)
        if _length_s(truth, first, last) < MIN_GOAL_S or abs(error_rad[0]) <= NEAR_RAD:
            continue
        time_s = truth.time_s[first:last] - truth.time_s[first]
        steady_row = int(np.searchsorted(time_s, STEADY_AFTER_S - 1e-9))
        turns.append(Turn(degrees(overshoot_rad(error_rad[:steady_row])), _settling_time_s(time_s, error_rad)))
    return tuple(turns)


def _settling_time_s(time_s: Array, error_rad: Array) -> float:
    # Each interval inside the limit lies between two rows outside.
    outside = np.flatnonzero(np.abs(error_rad) > NEAR_RAD)
    begins = np.concatenate(([0], outside + 1))
    ends = np.concatenate((outside, [error_rad.size]))
    for begin, end in zip(begins, ends, strict=True):
        if end > begin and time_s[end - 1] - time_s[begin] >= SETTLED_S - 1e-9:
            return float(time_s[begin])
    return float("inf")


def _first_turn(truth: Truth, spans: Sequence[tuple[int, int]]) -> tuple[float, float]:
    for first, last in spans:
        error_rad = _turn_error_rad(truth, first, last)
        if abs(error_rad[0]) <= NEAR_RAD:
            continue
        steady_row = int(np.searchsorted(truth.time_s[first:last], truth.time_s[first] + STEADY_AFTER_S - 1e-9))
        near_rows = np.flatnonzero(np.abs(error_rad) <= NEAR_RAD)
        near_s = float(truth.time_s[first + near_rows[0]] - truth.time_s[first]) if near_rows.size else float("inf")
        return degrees(overshoot_rad(error_rad[:steady_row])), near_s
    return 0.0, 0.0


def _turn_error_rad(truth: Truth, first: int, last: int) -> Array:
    """Return heading minus goal during a goal, unwrapped in the direction of the turn."""
    heading_rad = truth.heading_low_rad[first:last]
    return np.asarray(heading_rad - unwrapped_goal_rad(float(truth.goal_rad[first]), float(heading_rad[-1])))


def _length_s(truth: Truth, first: int, last: int) -> float:
    return float(truth.time_s[last - 1] - truth.time_s[first])


def mean_of(scores: Sequence[Score]) -> Score:
    """Return the mean score of runs; the rms error is that over all steady parts."""
    return Score(
        float(np.sqrt(np.mean([score.rms_deg**2 for score in scores]))),
        float(np.mean([score.travel_deg_per_h for score in scores])),
        float(np.mean([score.mean_deg for score in scores])),
        float(np.mean([score.overshoot_deg for score in scores])),
        float(np.mean([score.near_s for score in scores])),
    )
