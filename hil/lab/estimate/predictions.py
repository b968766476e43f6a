"""Predict headings with the recorded rudder, by the filter's own step (firmware_py/estimate/heading_model.py).

From each row the filter's state is predicted in short steps, each with its mean rudder angle and the noise levels of
that row. The recorded rudder angle is constant between samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.estimate.tick import Estimates
from hil.lab.identify.recording import Floats
from hil.lab.numeric_core import heading_model, kt

AHEAD_S: Final = (5, 10, 30, 60)  # prediction times
MAX_STEP_S: Final = 0.5
MIN_STEPS_PER_LAG: Final = 4.0
MAX_SAMPLE_AGE_S: Final = 5.0  # after this time a rudder sample is no longer valid
MIN_KNOWN_FRACTION: Final = 0.95  # of the prediction time, with a known rudder angle


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted heading and standard deviation for each row; NaN without a known rudder angle."""

    heading_rad: Floats
    sd_rad: Floats


def predict(estimates: Estimates) -> dict[int, Prediction]:
    """Return the predictions of all rows by prediction time [s]."""
    rows = estimates.time_s.size
    predictions = {seconds: Prediction(np.full(rows, np.nan), np.full(rows, np.nan)) for seconds in AHEAD_S}
    if not estimates.rudder_s.size or not np.isfinite(estimates.motions).any():
        return predictions
    knots = _rudder_integral(estimates.rudder_s, estimates.rudder_rad)
    lag_s = float(np.nanmin(estimates.models[:, 1]))
    step_s = max(min(MAX_STEP_S, lag_s / MIN_STEPS_PER_LAG), float(np.median(np.diff(estimates.time_s))) / 2.0)
    ahead_s = np.array(AHEAD_S, dtype=np.float64)
    heading, sd = np.full((rows, ahead_s.size), np.nan), np.full((rows, ahead_s.size), np.nan)
    fill_predictions(
        estimates.time_s, estimates.motions, estimates.levels, estimates.models, *knots, ahead_s, step_s, heading, sd
    )
    for index, seconds in enumerate(AHEAD_S):
        predictions[seconds] = Prediction(heading[:, index], sd[:, index] * estimates.inflation)
    return predictions


def _rudder_integral(time_s: Floats, rudder_rad: Floats) -> tuple[Floats, Floats, Floats]:
    """Return knots [s] and two piecewise linear integrals: of the rudder angle and of the time with a known angle."""
    is_later = np.concatenate(([True], np.diff(time_s) > 0.0))
    time_s, rudder_rad = time_s[is_later], rudder_rad[is_later]
    usual_interval_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else MAX_SAMPLE_AGE_S
    intervals_s = np.append(np.diff(time_s), min(usual_interval_s, MAX_SAMPLE_AGE_S))
    valid_s = np.minimum(intervals_s, MAX_SAMPLE_AGE_S)
    knots = np.stack((time_s, time_s + valid_s), axis=1).ravel()
    durations_s = np.stack((valid_s, intervals_s - valid_s), axis=1).ravel()
    values = np.stack((rudder_rad, rudder_rad), axis=1).ravel()
    known_s = np.stack((valid_s, np.zeros_like(valid_s)), axis=1).ravel()
    integral = np.concatenate(([0.0], np.cumsum(values * durations_s)))[:-1]
    return knots, integral, np.concatenate(([0.0], np.cumsum(known_s)))[:-1]


@compiled
def fill_predictions(
    at_s: Floats,
    motions: Floats,
    levels: Floats,
    models: Floats,
    knots_s: Floats,
    integral: Floats,
    known_s: Floats,
    ahead_s: Floats,
    step_s: float,
    heading_rad: Floats,
    sd_rad: Floats,
) -> None:
    """Compute heading and standard deviation (rows, prediction times); times must increase."""
    first = 0
    for row in range(at_s.shape[0]):
        if not math.isfinite(motions[row, 0]):
            continue
        motion = heading_model.read_row(motions[row])
        level = levels[row]
        noise = heading_model.NoiseLevels(level[0], level[1], level[2], level[3], level[4], level[5])
        model = kt.KtModel(models[row, 0], models[row, 1], models[row, 2], 0.0, 1.0)
        begin_s = at_s[row]
        while first + 1 < knots_s.shape[0] and knots_s[first + 1] <= begin_s:
            first += 1
        index = first
        begin_area, begin_known = (
            value_at(knots_s, integral, index, begin_s),
            value_at(knots_s, known_s, index, begin_s),
        )
        now_s, area = begin_s, begin_area
        for ahead_index in range(ahead_s.shape[0]):
            end_s = begin_s + ahead_s[ahead_index]
            steps = max(1, math.ceil((end_s - now_s) / step_s - 1e-9))
            from_s = now_s
            for step in range(steps):
                next_s = from_s + (end_s - from_s) * (step + 1) / steps
                while index + 1 < knots_s.shape[0] and knots_s[index + 1] <= next_s:
                    index += 1
                next_area = value_at(knots_s, integral, index, next_s)
                motion = heading_model.predict(
                    motion, noise, model, (next_area - area) / (next_s - now_s), next_s - now_s
                )
                now_s, area = next_s, next_area
            if (
                begin_s < knots_s[0]
                or value_at(knots_s, known_s, index, end_s) - begin_known < MIN_KNOWN_FRACTION * ahead_s[ahead_index]
            ):
                break
            heading_rad[row, ahead_index] = motion.heading_rad
            sd_rad[row, ahead_index] = math.sqrt(motion.p00)


@compiled
def value_at(knots_s: Floats, values: Floats, index: int, t_s: float) -> float:
    """Return the value at a time after knot `index`, interpolated to the next knot; constant after the last one."""
    value: float = values[index]
    if index + 1 < knots_s.shape[0] and knots_s[index] < t_s and knots_s[index] < knots_s[index + 1]:
        fraction = (t_s - knots_s[index]) / (knots_s[index + 1] - knots_s[index])
        value += fraction * (values[index + 1] - values[index])
    return value
