"""Tuning of the default controller: a fish swarm search, whose result must also be better in fresh seas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_py.common.parameters import ParameterSet
from hil.lab.swarm import SwarmProgress, SwarmSettings, minimise
from hil.lab.tune.delivered import SEARCHED, Score, Setting, Trials, default_setting
from hil.lab.tune.loop_kernel import Floats
from hil.lab.tune.search import MIN_GAIN, Bound, ProgressReport

# In the order of SEARCHED; no boat steers well with prices outside these limits.
BOUNDS = (
    Bound("CTL_PRICE", "CTL_PRICE", 0.25, 4.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "RUD_DBAND_DEG", 0.0, 3.0),
)
FISH, TRIES = 6, 2
DEFAULT_PRICE = 1.0  # relative travel has the same weight as relative error
MAX_RATIO = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class Tuned:
    """The choice with its scores in the seas of the search and in fresh ones."""

    chosen: Score
    fresh: Score
    kept: bool  # whether the defaults are kept: nothing better was found, or not better in fresh seas
    why: str
    evaluations: int


def tune(
    trials: Trials,
    fresh: Trials,
    parameters: ParameterSet,
    *,
    price: float | None = None,
    evaluations: int = 60,
    seed: int = 1,
    report_progress: ProgressReport = lambda _text, _part: None,
) -> Tuned:
    """Search the setting with the smallest error + price x travel.

    Without a price both have the same weight, and neither may exceed that of the defaults. If the choice is not better
    in the fresh seas, the defaults are kept.
    """
    weight = DEFAULT_PRICE if price is None else price
    free = price is not None
    _search(trials, trials.score(_present(parameters)), weight, evaluations, seed, report_progress, free=free)
    eligible = [score for score in trials.archive if free or no_worse(trials, score)]
    best = min(eligible, key=lambda score: trials.cost(score, weight))
    chosen = _simplified(trials, best, weight, free=free)
    checked = fresh.score(chosen.setting)
    if chosen.setting == default_setting():
        return Tuned(trials.delivered, fresh.delivered, True, "nothing better was found", len(trials.archive))
    confirmed = fresh.cost(checked, weight) < fresh.cost(fresh.delivered, weight)
    if not confirmed or not (free or no_worse(fresh, checked)):
        why = f"{_words(chosen.setting)} is better in the seas of the search, but not in fresh seas"
        return Tuned(trials.delivered, fresh.delivered, True, why, len(trials.archive))
    why = f"smallest error + {weight:g} x rudder travel"
    why += "" if free else ", neither larger than with the defaults"
    return Tuned(chosen, checked, False, why, len(trials.archive))


def no_worse(trials: Trials, score: Score) -> bool:
    """Return whether neither error nor rudder travel exceeds that of the defaults."""
    return score.error <= MAX_RATIO and trials.travel(score) <= MAX_RATIO


def _present(parameters: ParameterSet) -> Setting:
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
    free: bool,
) -> None:
    def cost(point: Floats) -> float:
        score = trials.score(tuple(bound.value(float(x)) for bound, x in zip(BOUNDS, point, strict=True)))
        value = trials.cost(score, weight)
        # A penalty that grows outside the limits leads the fish back.
        return value if free else value + 10.0 * (max(score.error - 1.0, 0.0) + max(trials.travel(score) - 1.0, 0.0))

    def costs(points: Floats) -> Floats:
        return np.array([cost(point) for point in points])

    def on_progress(progress: SwarmProgress) -> None:
        part = min(progress.evaluations / evaluations, 0.999)
        report_progress(f"{progress.evaluations} settings: {progress.best_value:.3f}", part)

    low = np.array([bound.coordinate(bound.low) for bound in BOUNDS])
    high = np.array([bound.coordinate(bound.high) for bound in BOUNDS])
    # If the vehicle has the defaults, one more fish starts at random.
    begin = np.array([_point(setting) for setting in dict.fromkeys((default_setting(), present.setting))])
    settings = SwarmSettings(
        fish=FISH, tries=TRIES, iterations=evaluations, shrink=0.02, seed=seed, max_evaluations=evaluations
    )
    minimise(costs, low, high, settings, on_progress, start=np.clip(begin, low, high))


def _point(setting: Setting) -> list[float]:
    return [bound.coordinate(max(value, bound.low)) for bound, value in zip(BOUNDS, setting, strict=True)]


def _simplified(trials: Trials, best: Score, weight: float, *, free: bool) -> Score:
    """Round the setting, and restore parameters that bring no gain."""
    default = default_setting()
    rounded = tuple(
        value if value == usual else float(f"{value:.3g}") for value, usual in zip(best.setting, default, strict=True)
    )
    chosen = best if rounded == best.setting else trials.score(rounded)
    if not free and not no_worse(trials, chosen):
        chosen = best
    for number, usual in enumerate(default):
        if chosen.setting[number] == usual:
            continue
        simpler = trials.score((*chosen.setting[:number], usual, *chosen.setting[number + 1 :]))
        gain = trials.cost(simpler, weight) - trials.cost(chosen, weight)
        if gain <= MIN_GAIN * trials.cost(chosen, weight) and (free or no_worse(trials, simpler)):
            chosen = simpler
    return chosen


def _words(setting: Setting) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in zip(SEARCHED, setting, strict=True))
