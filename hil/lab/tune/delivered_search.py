"""Tunes the delivered controller: the fish swarm searches, and keeps what is better in seas that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_py.common.parameters import ParameterSet
from hil.lab.swarm import SwarmProgress, SwarmSettings, minimise
from hil.lab.tune.delivered import SEARCHED, Score, Setting, Trials, default_setting
from hil.lab.tune.loop_kernel import Floats
from hil.lab.tune.search import WORTH, Bound, Tell

# In the order of SEARCHED; a price beyond these steers no boat well.
BOUNDS = (
    Bound("CTL_PRICE", "CTL_PRICE", 0.25, 4.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "RUD_DBAND_DEG", 0.0, 3.0),
)
FISH, TRIES = 6, 2
EVEN = 1.0  # what a part of the travel costs against as much of the error, when nothing else is asked for
FULL = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class Tuned:
    """What was found: the choice in the seas of the search and in fresh ones, and the delivered beside it."""

    chosen: Score
    fresh: Score
    kept: bool  # the delivered defaults are: nothing better was found, or not better in fresh seas
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
    tell: Tell = lambda _text, _part: None,
) -> Tuned:
    """Search, and return the setting of least error + price x travel; ValueError for bounds that are none.

    Without a price both weigh the same, and neither may be more than as delivered. A choice that the fresh seas
    do not bear out is dropped for the delivered defaults.
    """
    weight = EVEN if price is None else price
    free = price is not None
    _search(trials, trials.score(_present(parameters)), weight, evaluations, seed, tell, free=free)
    eligible = [score for score in trials.archive if free or no_worse(trials, score)]
    best = min(eligible, key=lambda score: trials.cost(score, weight))
    chosen = _simplified(trials, best, weight, free=free)
    checked = fresh.score(chosen.setting)
    if chosen.setting == default_setting():
        return Tuned(trials.delivered, fresh.delivered, True, "nothing better was found", len(trials.archive))
    borne_out = fresh.cost(checked, weight) < fresh.cost(fresh.delivered, weight)
    if not borne_out or not (free or no_worse(fresh, checked)):
        why = f"{_words(chosen.setting)} was better in the seas of the search, and not in fresh ones"
        return Tuned(trials.delivered, fresh.delivered, True, why, len(trials.archive))
    why = f"the least error + {weight:g} x rudder travel"
    why += "" if free else ", neither of them more than as delivered"
    return Tuned(chosen, checked, False, why, len(trials.archive))


def no_worse(trials: Trials, score: Score) -> bool:
    """Whether neither error nor rudder travel is more than as delivered."""
    return score.error <= FULL and trials.travel(score) <= FULL


def _present(parameters: ParameterSet) -> Setting:
    """Return the vehicle's own setting, moved into what is searched."""
    return tuple(min(max(parameters[bound.name], bound.low), bound.high) for bound in BOUNDS)


def _search(
    trials: Trials, present: Score, weight: float, evaluations: int, seed: int, tell: Tell, *, free: bool
) -> None:
    def cost(point: Floats) -> float:
        score = trials.score(tuple(bound.value(float(x)) for bound, x in zip(BOUNDS, point, strict=True)))
        found = trials.cost(score, weight)
        # Beyond the fence it rises, so that the fish see where the way back is.
        return found if free else found + 10.0 * (max(score.error - 1.0, 0.0) + max(trials.travel(score) - 1.0, 0.0))

    def costs(points: Floats) -> Floats:
        return np.array([cost(point) for point in points])

    def told(progress: SwarmProgress) -> None:
        part = min(progress.evaluations / evaluations, 0.999)
        tell(f"{progress.evaluations} settings: {progress.best_value:.3f}", part)

    low = np.array([bound.coordinate(bound.low) for bound in BOUNDS])
    high = np.array([bound.coordinate(bound.high) for bound in BOUNDS])
    # A vehicle that is as delivered leaves one fish more to start at random.
    begin = np.array([_point(setting) for setting in dict.fromkeys((default_setting(), present.setting))])
    settings = SwarmSettings(
        fish=FISH, tries=TRIES, iterations=evaluations, shrink=0.02, seed=seed, most_evaluations=evaluations
    )
    minimise(costs, low, high, settings, told, start=np.clip(begin, low, high))


def _point(setting: Setting) -> list[float]:
    return [bound.coordinate(max(value, bound.low)) for bound, value in zip(BOUNDS, setting, strict=True)]


def _simplified(trials: Trials, best: Score, weight: float, *, free: bool) -> Score:
    """Round to what can be told apart, and put back what need not change."""
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
        worth = trials.cost(simpler, weight) - trials.cost(chosen, weight)
        if worth <= WORTH * trials.cost(chosen, weight) and (free or no_worse(trials, simpler)):
            chosen = simpler
    return chosen


def _words(setting: Setting) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in zip(SEARCHED, setting, strict=True))
