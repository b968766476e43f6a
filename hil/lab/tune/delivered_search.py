"""Tuning of the default controller: a fish swarm search whose result must also be better in fresh seas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_py.common.parameters import ParameterSet
from hil.lab.swarm import SwarmProgress, SwarmSettings, minimise
from hil.lab.tune.delivered import SEARCHED_NAMES, Score, Setting, Trials, default_setting
from hil.lab.tune.loop_kernel import Floats
from hil.lab.tune.search import MIN_GAIN, Bound, ProgressReport

# In the order of SEARCHED_NAMES; with a CTL_PRICE outside these limits no boat steers well.
BOUNDS = (
    Bound("CTL_PRICE", "CTL_PRICE", 0.25, 4.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "RUD_DBAND_DEG", 0.0, 3.0),
)
FISH_COUNT, TRIES = 6, 2
DEFAULT_PRICE = 1.0  # relative travel has the same weight as relative error
MAX_RATIO = 1.0 + 1e-9  # of error or rudder travel relative to the defaults


@dataclass(frozen=True, slots=True)
class TuningResult:
    """The chosen setting with its scores in the seas of the search and in the fresh seas."""

    chosen: Score
    fresh_score: Score
    keeps_defaults: bool  # no other setting was better, or not in fresh seas
    reason: str
    evaluations: int


def tune(
    trials: Trials,
    fresh_trials: Trials,
    parameters: ParameterSet,
    *,
    price: float | None = None,
    evaluations: int = 60,
    seed: int = 1,
    report_progress: ProgressReport = lambda _text, _part: None,
) -> TuningResult:
    """Search for the setting with the smallest error + price x rudder travel.

    Without a price both have the same weight, and neither may be larger than with the defaults. If the choice is not
    better in the fresh seas, the defaults are kept.
    """
    weight = DEFAULT_PRICE if price is None else price
    is_unlimited = price is not None
    _search(
        trials,
        trials.score(_present_setting(parameters)),
        weight,
        evaluations,
        seed,
        report_progress,
        is_unlimited=is_unlimited,
    )
    eligible = [score for score in trials.archive if is_unlimited or is_no_worse(trials, score)]
    best = min(eligible, key=lambda score: trials.cost(score, weight))
    chosen = _simplify(trials, best, weight, is_unlimited=is_unlimited)
    fresh_score = fresh_trials.score(chosen.setting)
    if chosen.setting == default_setting():
        return TuningResult(
            trials.default_score, fresh_trials.default_score, True, "nothing better was found", len(trials.archive)
        )
    is_confirmed = fresh_trials.cost(fresh_score, weight) < fresh_trials.cost(fresh_trials.default_score, weight)
    if not is_confirmed or not (is_unlimited or is_no_worse(fresh_trials, fresh_score)):
        reason = f"{_setting_text(chosen.setting)} is better in the seas of the search, but not in fresh seas"
        return TuningResult(trials.default_score, fresh_trials.default_score, True, reason, len(trials.archive))
    reason = f"smallest error + {weight:g} x rudder travel"
    reason += "" if is_unlimited else ", neither larger than with the defaults"
    return TuningResult(chosen, fresh_score, False, reason, len(trials.archive))


def is_no_worse(trials: Trials, score: Score) -> bool:
    """Return whether neither error nor rudder travel exceeds that of the defaults."""
    return score.error <= MAX_RATIO and trials.travel(score) <= MAX_RATIO


def _present_setting(parameters: ParameterSet) -> Setting:
    """Return the present setting of the vehicle, limited to the bounds of the search."""
    return tuple(min(max(parameters[bound.name], bound.low), bound.high) for bound in BOUNDS)


def _search(
    trials: Trials,
    present: Score,
    weight: float,
    evaluations: int,
    seed: int,
    report_progress: ProgressReport,
    *,
    is_unlimited: bool,
) -> None:
    def cost(point: Floats) -> float:
        score = trials.score(tuple(bound.value(float(x)) for bound, x in zip(BOUNDS, point, strict=True)))
        value = trials.cost(score, weight)
        # The penalty increases outside the limits, so that the fish return.
        return (
            value
            if is_unlimited
            else value + 10.0 * (max(score.error - 1.0, 0.0) + max(trials.travel(score) - 1.0, 0.0))
        )

    def costs(points: Floats) -> Floats:
        return np.array([cost(point) for point in points])

    def on_progress(progress: SwarmProgress) -> None:
        fraction = min(progress.evaluations / evaluations, 0.999)
        report_progress(f"{progress.evaluations} settings: {progress.best_value:.3f}", fraction)

    low = np.array([bound.coordinate(bound.low) for bound in BOUNDS])
    high = np.array([bound.coordinate(bound.high) for bound in BOUNDS])
    # If the vehicle has the defaults, only one fish starts there.
    start_points = np.array([_point(setting) for setting in dict.fromkeys((default_setting(), present.setting))])
    settings = SwarmSettings(
        fish=FISH_COUNT, tries=TRIES, iterations=evaluations, shrink=0.02, seed=seed, max_evaluations=evaluations
    )
    minimise(costs, low, high, settings, on_progress, start=np.clip(start_points, low, high))


def _point(setting: Setting) -> list[float]:
    return [bound.coordinate(max(value, bound.low)) for bound, value in zip(BOUNDS, setting, strict=True)]


def _simplify(trials: Trials, best: Score, weight: float, *, is_unlimited: bool) -> Score:
    """Round the setting, and restore the default of each parameter that does not reduce the cost by MIN_GAIN."""
    default = default_setting()
    rounded = tuple(
        value if value == default_value else float(f"{value:.3g}")
        for value, default_value in zip(best.setting, default, strict=True)
    )
    chosen = best if rounded == best.setting else trials.score(rounded)
    if not is_unlimited and not is_no_worse(trials, chosen):
        chosen = best
    for number, default_value in enumerate(default):
        if chosen.setting[number] == default_value:
            continue
        restored = trials.score((*chosen.setting[:number], default_value, *chosen.setting[number + 1 :]))
        gain = trials.cost(restored, weight) - trials.cost(chosen, weight)
        if gain <= MIN_GAIN * trials.cost(chosen, weight) and (is_unlimited or is_no_worse(trials, restored)):
            chosen = restored
    return chosen


def _setting_text(setting: Setting) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in zip(SEARCHED_NAMES, setting, strict=True))
