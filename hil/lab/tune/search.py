"""Tuner of fixed gains in simulated seas: fish swarm searches for several prices of rudder travel."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.common.angles import clamp
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import index_of
from hil.lab.swarm import SwarmProgress, SwarmSettings, minimise
from hil.lab.tune import paper
from hil.lab.tune.loop_kernel import Floats
from hil.lab.tune.trials import Score, Setting, Trials, knee_of, pareto_front


@dataclass(frozen=True, slots=True)
class Bound:
    """Limits of a searched parameter; `logarithmic`: the search coordinate is its logarithm."""

    name: str
    field: str
    low: float
    high: float
    logarithmic: bool = False

    def coordinate(self, value: float) -> float:
        """Return the search coordinate of a value."""
        return math.log(value) if self.logarithmic else value

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate, limited to the bounds."""
        return clamp(math.exp(coordinate) if self.logarithmic else coordinate, self.low, self.high)


# The first two are the gains, with the paper's box.
BOUNDS = (
    Bound("CTL_K1", "k1", paper.BOX_LOW[0], paper.BOX_HIGH[0]),
    Bound("CTL_K2", "k2", paper.BOX_LOW[1], paper.BOX_HIGH[1]),
    Bound("EST_TAU_S", "tau_s", 0.5, 30.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "deadband_deg", 0.0, 5.0),
)
PRICES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
FISH_COUNT, TRIES = 12, 2
# A parameter that reduces the cost by a smaller fraction is not changed.
MIN_GAIN = 0.01
GAINS = ("CTL_K1", "CTL_K2")

ProgressReport = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class TuningResult:
    """Result of a tuning: the Pareto front, the chosen point, and the reason for the choice."""

    front: tuple[Score, ...]
    chosen: Score
    reason: str
    changed_names: tuple[str, ...]  # parameters to be written: the gains, and others that differ from the vehicle's
    limit_texts: tuple[str, ...]  # names and values of parameters at a limit of the search
    evaluations: int


def tune(
    trials: Trials,
    present: Setting,
    *,
    price: float | None = None,
    only_gains: bool = False,
    evaluations: int = 400,
    seed: int = 1,
    report_progress: ProgressReport = lambda _text, _part: None,
) -> TuningResult:
    """Search with every price, and choose the knee of the front, or the optimum at `price`.

    Args:
        trials: trial runs.
        present: the vehicle's setting; parameters that do not reduce the cost keep these values.
        price: weight of rudder travel against error, both relative to the paper's gains; None for the knee.
        only_gains: search k1 and k2 only, without observer and deadband.
        evaluations: maximum number for each price.
        seed: seed of the swarm.
        report_progress: progress callback with a text and a part from 0 to 1.
    """
    box = Box(present, only_gains=only_gains)
    prices = PRICES if price is None else tuple(sorted({*PRICES, price}))
    trials.scores([present])
    for number, current_price in enumerate(prices):
        _search(
            trials,
            box,
            current_price,
            evaluations,
            seed + number,
            _progress_callback(report_progress, number, current_price, (len(prices), evaluations)),
        )
    # The paper's gains have another observer constant than the vehicle may have.
    eligible = [score for score in trials.archive if box.has_present_values(score.setting)]
    found = pareto_front(eligible)
    if price is not None:
        best = min(eligible, key=lambda score: trials.cost(score, price))
        reason = f"smallest error + {price:g} x rudder travel"
        choice_price = price
    else:
        no_worse_scores = [score for score in found if score.error <= trials.paper.error]
        best = knee_of(no_worse_scores) if no_worse_scores else found[-1]
        reason = "knee of the front, among settings with no larger error than the paper's gains"
        choice_price = _fitting_price(trials, best, prices)
    chosen = _simplify(trials, best, present, choice_price)
    return TuningResult(
        tuple(pareto_front([score for score in trials.archive if box.has_present_values(score.setting)])),
        chosen,
        reason,
        _changed_names(chosen, present),
        box.limit_texts(chosen.setting),
        len(trials.archive),
    )


class Box:
    """The box of the search in search coordinates."""

    def __init__(self, present: Setting, *, only_gains: bool) -> None:
        """Store the present setting, which determines the parameters that are not searched."""
        self._present = present
        self._bounds = BOUNDS[:2] if only_gains else BOUNDS
        self.low = np.array([bound.coordinate(bound.low) for bound in self._bounds])
        self.high = np.array([bound.coordinate(bound.high) for bound in self._bounds])

    def has_present_values(self, setting: Setting) -> bool:
        """Return whether the parameters that are not searched have their present values."""
        searched = {bound.field for bound in self._bounds}
        fixed_fields = {bound.field for bound in BOUNDS} - searched
        return all(getattr(setting, field) == getattr(self._present, field) for field in fixed_fields)

    def setting(self, point: Floats) -> Setting:
        """Return the setting at a point."""
        values = {bound.field: bound.value(float(number)) for bound, number in zip(self._bounds, point, strict=True)}
        return replace(self._present, **values)

    def point(self, setting: Setting) -> Floats:
        """Return the point of a setting, limited to the box."""
        numbers = [bound.coordinate(max(getattr(setting, bound.field), bound.low)) for bound in self._bounds]
        return np.array(np.minimum(numbers, self.high), np.float64)

    def limit_texts(self, setting: Setting) -> tuple[str, ...]:
        """Return parameters within 1 % of a limit of the search that is not the limit of the parameter."""
        texts = []
        for bound in self._bounds:
            value = getattr(setting, bound.field)
            row = TABLE[index_of(bound.name)]
            at_low = value <= 1.01 * bound.low and bound.low > row.minimum
            at_high = value >= 0.99 * bound.high and bound.high < row.maximum
            if at_low or at_high:
                texts.append(f"{bound.name} {value:g}")
        return tuple(texts)


def _search(
    trials: Trials,
    box: Box,
    price: float,
    evaluations: int,
    seed: int,
    report_progress: Callable[[SwarmProgress], None],
) -> None:
    """Search with one price; three fish start at the best points of the other prices."""

    def costs(points: Floats) -> Floats:
        return np.array([trials.cost(score, price) for score in trials.scores([box.setting(p) for p in points])])

    best_scores = sorted(trials.archive, key=lambda score: trials.cost(score, price))[:3]
    start = np.array([box.point(score.setting) for score in best_scores])
    settings = SwarmSettings(
        fish=FISH_COUNT,
        tries=TRIES,
        iterations=evaluations,
        shrink=0.02,
        seed=seed,
        max_evaluations=evaluations,
    )
    minimise(costs, box.low, box.high, settings, report_progress, start=start)


def _progress_callback(
    report_progress: ProgressReport, number: int, price: float, totals: tuple[int, int]
) -> Callable[[SwarmProgress], None]:
    """Return a progress callback; `totals` contains the number of prices and the evaluations for each."""
    prices, evaluations = totals

    def on_progress(progress: SwarmProgress) -> None:
        fraction = min(progress.evaluations / evaluations, 1.0)
        report_progress(f"price {price:g}: {progress.best_value:.3f}", min((number + fraction) / prices, 0.999))

    return on_progress


def _fitting_price(trials: Trials, chosen: Score, prices: Sequence[float]) -> float:
    """Return the price for which the cost of a point is closest to the minimum."""

    def regret(price: float) -> float:
        return trials.cost(chosen, price) / min(trials.cost(score, price) for score in trials.archive)

    return min(prices, key=regret)


def _simplify(trials: Trials, best: Score, present: Setting, price: float) -> Score:
    """Round the setting, and restore the present value of each parameter that does not reduce the cost by MIN_GAIN."""
    setting = best.setting
    rounded = Setting(
        k1=float(f"{setting.k1:.3g}"),
        k2=round(setting.k2, 2),
        tau_s=setting.tau_s if setting.tau_s == present.tau_s else float(f"{setting.tau_s:.2g}"),
        deadband_deg=setting.deadband_deg
        if setting.deadband_deg == present.deadband_deg
        else round(setting.deadband_deg, 1),
    )
    chosen = trials.scores([rounded])[0]
    for restored_values in ({"deadband_deg": present.deadband_deg}, {"tau_s": present.tau_s}):
        restored = trials.scores([replace(chosen.setting, **restored_values)])[0]
        if trials.cost(restored, price) <= (1.0 + MIN_GAIN) * trials.cost(chosen, price):
            chosen = restored
    return chosen


def _changed_names(chosen: Score, present: Setting) -> tuple[str, ...]:
    """Return the names of the gains and of the other parameters that differ from the vehicle's."""
    present_values, chosen_values = present.parameters(), chosen.setting.parameters()
    return tuple(name for name in chosen_values if name in GAINS or chosen_values[name] != present_values[name])
