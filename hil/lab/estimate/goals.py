"""The heading that the autopilot is ordered to steer while it watches a recording.

That which was recorded, where there is one. Elsewhere what the boat was steered for is not known: the goal is the mean
heading of about a minute, and stands until that mean has moved away from it, so that it changes in a few steps where
the boat turns, and hardly ever on a course. Unlike a goal that follows all the time, one that stands leaves the
monitors of the heading error something to judge.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_py.common.angles import TWO_PI, radians, wrap_pi
from hil.lab.estimate.recording import Recording
from hil.lab.identify.recording import Floats

MEAN_S: Final = 60.0  # many waves, and shorter than most courses are held
MOVED_RAD: Final = radians(10.0)  # more than waves and gusts move such a mean


def goals_at(recording: Recording, times_s: Floats) -> Floats:
    """Return the goal at times since the recording's begin, from the heading around each where none was recorded."""
    goals = _mean_headings(recording, times_s)
    if recording.goal_s.size:
        place = np.searchsorted(recording.goal_s, times_s, side="right") - 1
        recorded = np.where(place >= 0, recording.goal_rad[np.maximum(place, 0)], np.nan)
        goals = np.where(np.isfinite(recorded), recorded, goals)
    return np.asarray(goals % TWO_PI)


def _mean_headings(recording: Recording, times_s: Floats) -> Floats:
    samples = [sample for sample in recording.headings if sample.source == recording.source]
    time_s = np.array([sample.t_s for sample in samples])
    heading = np.unwrap([sample.heading_rad for sample in samples])
    area = np.concatenate(([0.0], np.cumsum(0.5 * (heading[1:] + heading[:-1]) * np.diff(time_s))))
    low, high = (np.clip(times_s + side * MEAN_S / 2, time_s[0], time_s[-1]) for side in (-1.0, 1.0))
    spans = np.maximum(high - low, 1e-9)
    means = (np.interp(high, time_s, area) - np.interp(low, time_s, area)) / spans
    goal, goals = float(means[0]), []
    for mean in means.tolist():
        if abs(wrap_pi(mean - goal)) > MOVED_RAD:
            goal = mean
        goals.append(goal)
    return np.array(goals)
