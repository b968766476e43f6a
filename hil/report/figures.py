"""The figures of a run from its truth, which is read in pieces so that memory does not grow with its length.

An error is heading minus goal: a boat that a rudder bias pushes to port of its goal has a negative mean error. Headings
are those of the hull without wave yaw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from firmware_py.common.angles import TWO_PI, degrees, radians
from hil.sim.truth import Array, Truth

SETTLED_RAD = radians(3.0)
STEADY_AFTER_S = 200.0
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class GoalFigures:
    """Figures of one goal, from its time until the next goal or the end.

    `step_deg` is the turn that the boat made. `overshoot_deg` is the largest angle beyond the goal, in the direction of
    the turn, before `steady_from_s`; 0 for a step smaller than 3 deg. `settling_s` is the last time, from the start of
    the goal, at which the error exceeded 3 deg; None if it does at the end. The errors and the rudder travel are those
    of the steady part, which begins 200 s after the goal, or with the last third of a shorter goal.
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


@dataclass(frozen=True, slots=True)
class _Span:
    """Rows [first, last) of a truth with the same goal, with their times and the last heading."""

    first: int
    last: int
    goal_rad: float
    start_s: float
    end_s: float
    end_heading_rad: float


def heading_error_rad(heading_rad: Array, goal_rad: Array) -> Array:
    """Return heading minus goal, wrapped to half a turn."""
    error_rad = heading_rad - goal_rad
    return np.asarray(error_rad - TWO_PI * np.floor(error_rad / TWO_PI + 0.5))


def unwrapped_goal_rad(goal_rad: float, end_heading_rad: float) -> float:
    """Return a goal within half a turn of the unwrapped heading at its end.

    In the truth it is within half a turn of the heading at its start; for a step of about half a turn the boat may turn
    in the other direction.
    """
    return goal_rad + TWO_PI * math.floor((end_heading_rad - goal_rad) / TWO_PI + 0.5)


def unwrapped_goals_rad(truth: Truth) -> Array:
    """Return the goals of a truth, each within half a turn of the heading at its end."""
    goals_rad = truth.goal_rad.copy()
    for first, last in goal_spans(truth.goal_rad):
        goals_rad[first:last] = unwrapped_goal_rad(float(goals_rad[first]), float(truth.heading_low_rad[last - 1]))
    return goals_rad


def goal_figures(truth: Iterable[Truth]) -> tuple[GoalFigures, ...]:
    """Return the figures of every goal with at least two rows; the pieces are iterated twice."""
    statistics = [_GoalStatistics(span) for span in _spans(truth) if span.last - span.first >= 2]
    row = 0
    for piece in truth:
        for statistic in statistics:
            statistic.add(piece, row)
        row += piece.time_s.size
    return tuple(statistic.figures() for statistic in statistics)


def goal_spans(goal_rad: Array) -> list[tuple[int, int]]:
    """Return [first, last) rows of each period with a constant goal; rows without a goal are skipped."""
    if goal_rad.size == 0:
        return []
    # NaN differs from itself; these spans are removed below.
    changes = np.flatnonzero(goal_rad[1:] != goal_rad[:-1]) + 1
    bounds = [0, *changes.tolist(), goal_rad.size]
    return [(first, last) for first, last in pairwise(bounds) if not np.isnan(goal_rad[first])]


def _spans(truth: Iterable[Truth]) -> list[_Span]:
    spans: list[_Span] = []
    row = 0
    for piece in truth:
        for first, last in goal_spans(piece.goal_rad):
            goal_rad = float(piece.goal_rad[first])
            start_row, start_s = row + first, float(piece.time_s[first])
            if spans and (spans[-1].last, spans[-1].goal_rad) == (start_row, goal_rad):
                previous = spans.pop()
                start_row, start_s = previous.first, previous.start_s
            end_s, end_rad = float(piece.time_s[last - 1]), float(piece.heading_low_rad[last - 1])
            spans.append(_Span(start_row, row + last, goal_rad, start_s, end_s, end_rad))
        row += piece.time_s.size
    return spans


class RudderTravel:
    """Sum of absolute rudder movement."""

    def __init__(self) -> None:
        """Start before the first row."""
        self._travel_rad = self._start_s = self._end_s = 0.0
        self._last_rad: Array | None = None  # of one element

    def add(self, time_s: Array, rudder_rad: Array) -> None:
        """Add rows."""
        if time_s.size == 0:
            return
        if self._last_rad is None:
            self._start_s = float(time_s[0])
        else:
            rudder_rad = np.concatenate((self._last_rad, rudder_rad))
        self._travel_rad += float(np.sum(np.abs(np.diff(rudder_rad))))
        self._last_rad, self._end_s = rudder_rad[-1:].copy(), float(time_s[-1])

    def deg_per_h(self) -> float:
        """Return the travel per hour; 0 for fewer than two rows."""
        if self._end_s <= self._start_s:
            return 0.0
        return degrees(self._travel_rad) * SECONDS_PER_HOUR / (self._end_s - self._start_s)


def rudder_travel_deg_per_h(time_s: Array, rudder_rad: Array) -> float:
    """Return the sum of absolute rudder movement per hour; 0 for fewer than two rows."""
    travel = RudderTravel()
    travel.add(time_s, rudder_rad)
    return travel.deg_per_h()


def steady_rudder_travel_deg_per_h(goals: Sequence[GoalFigures]) -> float | None:
    """Return the rudder travel over the steady parts of all goals; None without any."""
    travel_deg = hours = 0.0
    for goal in goals:
        steady_h = (goal.steady_to_s - goal.steady_from_s) / SECONDS_PER_HOUR
        travel_deg += goal.rudder_travel_deg_per_h * steady_h
        hours += steady_h
    return travel_deg / hours if hours > 0.0 else None


class _GoalStatistics:
    """Accumulates the figures of one goal."""

    def __init__(self, span: _Span) -> None:
        self._span = span
        length_s = span.end_s - span.start_s
        self._steady_s = span.start_s + STEADY_AFTER_S if length_s > STEADY_AFTER_S else span.end_s - length_s / 3.0
        self._step_rad = self._overshoot_rad = self._sum_rad = self._sum_squares = 0.0
        self._settled_s: float | None = span.start_s  # None while the boat is outside
        self._steady_from_s = span.end_s
        self._magnitudes = _LargestValues(span.last - span.first)
        self._travel = RudderTravel()

    def add(self, piece: Truth, row: int) -> None:
        """Add the rows of the goal in a piece that begins at a row of the truth."""
        first, last = max(self._span.first - row, 0), min(self._span.last - row, piece.time_s.size)
        if first >= last:
            return
        time_s = piece.time_s[first:last]
        heading_rad = piece.heading_low_rad[first:last]
        error_rad = heading_error_rad(heading_rad, piece.goal_rad[first:last])
        goal_rad = unwrapped_goal_rad(self._span.goal_rad, self._span.end_heading_rad)
        if row + first == self._span.first:
            self._step_rad = goal_rad - float(heading_rad[0])
        if self._settled_s is None:
            self._settled_s = float(time_s[0])
        unsettled = np.flatnonzero(np.abs(error_rad) > SETTLED_RAD)
        if unsettled.size:
            self._settled_s = float(time_s[unsettled[-1] + 1]) if unsettled[-1] + 1 < time_s.size else None
        # At least the last two rows belong to the steady part.
        steady = int(np.searchsorted(time_s, self._steady_s - 1e-9))
        steady = min(steady, max(self._span.last - 2 - row - first, 0))
        self._overshoot_rad = max(
            self._overshoot_rad, _max_beyond_goal_rad(heading_rad[:steady] - goal_rad, -self._step_rad)
        )
        if steady < time_s.size:
            self._add_steady(time_s[steady:], error_rad[steady:], piece.rudder_rad[first + steady : last])

    def _add_steady(self, time_s: Array, error_rad: Array, rudder_rad: Array) -> None:
        if self._magnitudes.count == 0:
            self._steady_from_s = float(time_s[0])
        self._sum_rad += float(np.sum(error_rad))
        self._sum_squares += float(np.sum(np.square(error_rad)))
        self._magnitudes.add(np.abs(error_rad))
        self._travel.add(time_s, rudder_rad)

    def figures(self) -> GoalFigures:
        """Return the figures after all rows."""
        span, count = self._span, self._magnitudes.count
        return GoalFigures(
            t_s=span.start_s,
            goal_deg=degrees(span.goal_rad),
            step_deg=degrees(self._step_rad),
            steady_from_s=self._steady_from_s,
            steady_to_s=span.end_s,
            overshoot_deg=degrees(self._overshoot_rad),
            settling_s=None if self._settled_s is None else self._settled_s - span.start_s,
            mean_error_deg=degrees(self._sum_rad / count),
            rms_error_deg=degrees(math.sqrt(self._sum_squares / count)),
            p95_error_deg=degrees(self._magnitudes.percentile()),
            rudder_travel_deg_per_h=self._travel.deg_per_h(),
        )


class _LargestValues:
    """The 95th percentile of at most `max_count` values; only the largest twentieth is stored."""

    FRACTION = 0.95

    def __init__(self, max_count: int) -> None:
        self.count = 0
        self._max_stored = math.ceil((1.0 - self.FRACTION) * max_count) + 2
        self._stored: Array = np.empty(0)

    def add(self, values: Array) -> None:
        """Add values."""
        self.count += values.size
        self._stored = np.concatenate((self._stored, values))
        if (surplus := self._stored.size - self._max_stored) > 0:
            self._stored = np.partition(self._stored, surplus)[surplus:]

    def percentile(self) -> float:
        """Return the percentile, linear between neighbours."""
        removed = self.count - self._stored.size
        ordered = np.sort(self._stored)
        position = (self.count - 1) * self.FRACTION
        below = math.floor(position)
        low, high = (float(ordered[min(index, self.count - 1) - removed]) for index in (below, below + 1))
        return low + (high - low) * (position - below)


def overshoot_rad(error_rad: Array) -> float:
    """Return the largest error beyond zero, opposite to the initial one; 0 for a small step."""
    return _max_beyond_goal_rad(error_rad, float(error_rad[0])) if error_rad.size else 0.0


def _max_beyond_goal_rad(error_rad: Array, start_rad: float) -> float:
    if error_rad.size == 0 or abs(start_rad) < SETTLED_RAD:
        return 0.0
    return max(0.0, float(np.max(-math.copysign(1.0, start_rad) * error_rad)))
