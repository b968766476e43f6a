"""Scores of a run of the task in physics.md, section 6, computed from its truth."""

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
SETTLED_S = 100.0  # settled: this time within 5 deg
MIN_GOAL_S = STEADY_AFTER_S + 100.0  # shorter goals have no steady part


@dataclass(frozen=True, slots=True)
class Score:
    """Scores of a run, or the mean over several: heading errors and rudder travel of the steady parts.

    `overshoot_deg` and `near_s`, the time until the heading is first within 5 deg of the goal, are those of the first
    turn.
    """

    rms_deg: float
    travel_deg_per_h: float
    mean_deg: float
    overshoot_deg: float
    near_s: float


def score_of(truth: Truth) -> Score:
    """Compute the scores of the goals that last at least 300 s; raise ValueError without such a goal."""
    spans = [(first, last) for first, last in goal_spans(truth.goal_rad) if _length_s(truth, first, last) >= MIN_GOAL_S]
    if not spans:
        raise ValueError(f"no goal lasts for {MIN_GOAL_S:g} s")
    errors, travel_deg, hours = [], 0.0, 0.0
    for first, last in spans:
        steady = first + int(np.searchsorted(truth.time_s[first:last], truth.time_s[first] + STEADY_AFTER_S - 1e-9))
        errors.append(heading_error_rad(truth.heading_low_rad[steady:last], truth.goal_rad[steady:last]))
        share_h = _length_s(truth, steady, last) / 3600.0
        travel_deg += share_h * rudder_travel_deg_per_h(truth.time_s[steady:last], truth.rudder_rad[steady:last])
        hours += share_h
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
    """A turn; `settled_s` is the time until the heading first stays within 5 deg for 100 s, inf for never."""

    overshoot_deg: float
    settled_s: float


def turns_of(truth: Truth) -> tuple[Turn, ...]:
    """Return the turns of a run: goals that last at least 300 s and start more than 5 deg from the heading."""
    turns = []
    for first, last in goal_spans(truth.goal_rad):
        error_rad = _turning_rad(truth, first, last)
        if _length_s(truth, first, last) < MIN_GOAL_S or abs(error_rad[0]) <= NEAR_RAD:
            continue
        time_s = truth.time_s[first:last] - truth.time_s[first]
        early = int(np.searchsorted(time_s, STEADY_AFTER_S - 1e-9))
        turns.append(Turn(degrees(overshoot_rad(error_rad[:early])), _settled_s(time_s, error_rad)))
    return tuple(turns)


def _settled_s(time_s: Array, error_rad: Array) -> float:
    # An interval inside the limit starts after each row outside and ends at the next one.
    outside = np.flatnonzero(np.abs(error_rad) > NEAR_RAD)
    begins = np.concatenate(([0], outside + 1))
    ends = np.concatenate((outside, [error_rad.size]))
    for begin, end in zip(begins, ends, strict=True):
        if end > begin and time_s[end - 1] - time_s[begin] >= SETTLED_S - 1e-9:
            return float(time_s[begin])
    return float("inf")


def _first_turn(truth: Truth, spans: Sequence[tuple[int, int]]) -> tuple[float, float]:
    for first, last in spans:
        error_rad = _turning_rad(truth, first, last)
        if abs(error_rad[0]) <= NEAR_RAD:
            continue
        early = int(np.searchsorted(truth.time_s[first:last], truth.time_s[first] + STEADY_AFTER_S - 1e-9))
        inside = np.flatnonzero(np.abs(error_rad) <= NEAR_RAD)
        near_s = float(truth.time_s[first + inside[0]] - truth.time_s[first]) if inside.size else float("inf")
        return degrees(overshoot_rad(error_rad[:early])), near_s
    return 0.0, 0.0


def _turning_rad(truth: Truth, first: int, last: int) -> Array:
    """Return heading minus goal over a goal, unwrapped in the direction of the turn."""
    heading_rad = truth.heading_low_rad[first:last]
    return np.asarray(heading_rad - unwrapped_goal_rad(float(truth.goal_rad[first]), float(heading_rad[-1])))


def _length_s(truth: Truth, first: int, last: int) -> float:
    return float(truth.time_s[last - 1] - truth.time_s[first])


def mean_of(scores: Sequence[Score]) -> Score:
    """Return the mean over runs; the rms is that of all steady parts."""
    return Score(
        float(np.sqrt(np.mean([one.rms_deg**2 for one in scores]))),
        float(np.mean([one.travel_deg_per_h for one in scores])),
        float(np.mean([one.mean_deg for one in scores])),
        float(np.mean([one.overshoot_deg for one in scores])),
        float(np.mean([one.near_s for one in scores])),
    )
