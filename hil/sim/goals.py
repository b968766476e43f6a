"""The goals of a run: headings, with the times at which the operator sets them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from firmware_py.common.angles import radians

MAX_GOALS = 1000
MAX_TIME_S = 1e7


class GoalError(ValueError):
    """A goal is invalid; the text states the problem and the remedy."""


@dataclass(frozen=True, slots=True)
class Goal:
    """A heading from true north and the time at which it is set."""

    t_s: float
    heading_deg: float

    @property
    def heading_rad(self) -> float:
        """The heading in radians."""
        return radians(self.heading_deg)


def parse_goals(text: str) -> tuple[Goal, ...]:
    """Parse "0:0,120:60,720:-90" (seconds:degrees true); raise GoalError for an invalid text."""
    pieces = text.split(",")
    if len(pieces) > MAX_GOALS:
        raise GoalError(f"{len(pieces)} goals; the maximum is {MAX_GOALS}")
    goals = tuple(_parse_goal(piece.strip()) for piece in pieces)
    for earlier, later in pairwise(goals):
        if later.t_s <= earlier.t_s:
            raise GoalError(
                f"goal at {later.t_s:g} s follows one at {earlier.t_s:g} s; give the goals in order of time"
            )
    return goals


def _parse_goal(text: str) -> Goal:
    remedy = 'write seconds:degrees, as in "0:0,120:60,720:-90"'
    seconds, colon, heading = text.partition(":")
    try:
        goal = Goal(float(seconds), float(heading))
    except ValueError:
        raise GoalError(f"goal {text[:40]!r} is not a time and a heading; {remedy}") from None
    if not colon or not math.isfinite(goal.t_s) or not 0.0 <= goal.t_s <= MAX_TIME_S:
        raise GoalError(f"goal {text[:40]!r}: the time must be 0 to {MAX_TIME_S:g} s; {remedy}")
    if not math.isfinite(goal.heading_deg) or abs(goal.heading_deg) > 360.0:
        raise GoalError(f"goal {text[:40]!r}: the heading must be -360 to 360 degrees true; {remedy}")
    return goal
