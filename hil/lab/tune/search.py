"""The practical tuner of fixed gains: fish swarm searches for several prices of rudder travel."""

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
from hil.lab.tune.trials import Score, Setting, Trials, front, knee


@dataclass(frozen=True, slots=True)
class Bound:
    """Limits of a searched parameter, and whether its logarithm is searched."""

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


# The paper's box for k1 and k2; the gains come first.
BOUNDS = (
    Bound("CTL_K1", "k1", paper.BOX_LOW[0], paper.BOX_HIGH[0]),
    Bound("CTL_K2", "k2", paper.BOX_LOW[1], paper.BOX_HIGH[1]),
    Bound("EST_TAU_S", "tau_s", 0.5, 30.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "deadband_deg", 0.0, 5.0),
)
PRICES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
FISH, TRIES = 12, 2
# A parameter that reduces the cost by less than this part is not changed.
MIN_GAIN = 0.01
GAINS = ("CTL_K1", "CTL_K2")

ProgressReport = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Tuned:
    """Result: the front, the chosen point, and the reason of the choice."""

    front: tuple[Score, ...]
    chosen: Score
    why: str
    changed: tuple[str, ...]  # parameters to be written: the gains, and others that differ from the vehicle's
    edges: tuple[str, ...]  # parameters at a limit of the search
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
) -> Tuned:
    """Search with every price, and choose the knee of the front, or the optimum at `price`.

    Args:
        trials: trial runs.
        present: the vehicle's setting; parameters that bring no gain keep these values.
        price: weight of rudder travel against error, both relative to the paper's gains; None for the knee.
        only_gains: search k1 and k2 only, without observer and deadband.
        evaluations: maximum for each price.
        seed: seed of the swarm.
        report_progress: progress callback with a text and a part from 0 to 1.
    """
    box = Box(present, only_gains=only_gains)
    prices = PRICES if price is None else tuple(sorted({*PRICES, price}))
    trials.scores([present])
    for number, each in enumerate(prices):
        _search(
            trials,
            box,
            each,
            evaluations,
            seed + number,
            _progress_callback(report_progress, number, each, (len(prices), evaluations)),
        )
    # The paper's gains have their own observer constant, which may differ from the vehicle's.
    eligible = [score for score in trials.archive if box.holds(score.setting)]
    found = front(eligible)
    if price is not None:
        best = min(eligible, key=lambda score: trials.cost(score, price))
        why = f"smallest error + {price:g} x rudder travel"
        weigh = price
    else:
        good = [score for score in found if score.error <= trials.paper.error]
        best = knee(good) if good else found[-1]
        why = "knee of the front, among settings with no larger error than the paper's gains"
        weigh = _price_at(trials, best, prices)
    chosen = _simplified(trials, best, present, weigh)
    return Tuned(
        tuple(front([score for score in trials.archive if box.holds(score.setting)])),
        chosen,
        why,
        _changed(chosen, present),
        box.edges(chosen.setting),
        len(trials.archive),
    )


class Box:
    """The box of the search, in its coordinates."""

    def __init__(self, present: Setting, *, only_gains: bool) -> None:
        """Store the values of parameters that are not searched."""
        self._present = present
        self._bounds = BOUNDS[:2] if only_gains else BOUNDS
        self.low = np.array([bound.coordinate(bound.low) for bound in self._bounds])
        self.high = np.array([bound.coordinate(bound.high) for bound in self._bounds])

    def holds(self, setting: Setting) -> bool:
        """Return whether the parameters that are not searched have their present values."""
        searched = {bound.field for bound in self._bounds}
        kept = {bound.field for bound in BOUNDS} - searched
        return all(getattr(setting, field) == getattr(self._present, field) for field in kept)

    def setting(self, point: Floats) -> Setting:
        """Return the setting at a point."""
        values = {bound.field: bound.value(float(number)) for bound, number in zip(self._bounds, point, strict=True)}
        return replace(self._present, **values)

    def point(self, setting: Setting) -> Floats:
        """Return the point of a setting, limited to the box."""
        numbers = [bound.coordinate(max(getattr(setting, bound.field), bound.low)) for bound in self._bounds]
        return np.array(np.minimum(numbers, self.high), np.float64)

    def edges(self, setting: Setting) -> tuple[str, ...]:
        """Return parameters within 1 % of a limit of the search that is not the limit of the parameter."""
        ends = []
        for bound in self._bounds:
            value = getattr(setting, bound.field)
            row = TABLE[index_of(bound.name)]
            at_low = value <= 1.01 * bound.low and bound.low > row.minimum
            at_high = value >= 0.99 * bound.high and bound.high < row.maximum
            if at_low or at_high:
                ends.append(f"{bound.name} {value:g}")
        return tuple(ends)


def _search(
    trials: Trials,
    box: Box,
    price: float,
    evaluations: int,
    seed: int,
    report_progress: Callable[[SwarmProgress], None],
) -> None:
    """Search with one price; some fish start at the best points of the other prices."""

    def costs(points: Floats) -> Floats:
        return np.array([trials.cost(score, price) for score in trials.scores([box.setting(p) for p in points])])

    known = sorted(trials.archive, key=lambda score: trials.cost(score, price))[:3]
    start = np.array([box.point(score.setting) for score in known])
    settings = SwarmSettings(
        fish=FISH,
        tries=TRIES,
        iterations=evaluations,
        shrink=0.02,
        seed=seed,
        max_evaluations=evaluations,
    )
    minimise(costs, box.low, box.high, settings, report_progress, start=start)


def _progress_callback(
    report_progress: ProgressReport, number: int, price: float, most: tuple[int, int]
) -> Callable[[SwarmProgress], None]:
    """Return a progress callback; `most` has the number of prices and the evaluations of each."""
    prices, evaluations = most

    def on_progress(progress: SwarmProgress) -> None:
        part = min(progress.evaluations / evaluations, 1.0)
        report_progress(f"price {price:g}: {progress.best_value:.3f}", min((number + part) / prices, 0.999))

    return on_progress


def _price_at(trials: Trials, chosen: Score, prices: Sequence[float]) -> float:
    """Return the price for which a point of the front is closest to the optimum."""

    def regret(price: float) -> float:
        return trials.cost(chosen, price) / min(trials.cost(score, price) for score in trials.archive)

    return min(prices, key=regret)


def _simplified(trials: Trials, best: Score, present: Setting, price: float) -> Score:
    """Round the setting, and restore parameters that bring no gain."""
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
    for back in ({"deadband_deg": present.deadband_deg}, {"tau_s": present.tau_s}):
        simpler = trials.scores([replace(chosen.setting, **back)])[0]
        if trials.cost(simpler, price) <= (1.0 + MIN_GAIN) * trials.cost(chosen, price):
            chosen = simpler
    return chosen


def _changed(chosen: Score, present: Setting) -> tuple[str, ...]:
    """Return the gains, and the other parameters that differ from the vehicle's."""
    kept, wanted = present.parameters(), chosen.setting.parameters()
    return tuple(name for name in wanted if name in GAINS or wanted[name] != kept[name])
