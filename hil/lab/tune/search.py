"""The practical tuner: the artificial fish swarm weighs error against rudder travel, at one price after another."""

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
    """Between which values a parameter is searched, and whether by its logarithm."""

    name: str
    field: str
    low: float
    high: float
    logarithmic: bool = False

    def coordinate(self, value: float) -> float:
        """Return where a value lies in the search."""
        return math.log(value) if self.logarithmic else value

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate, within the bounds however it rounds."""
        return clamp(math.exp(coordinate) if self.logarithmic else coordinate, self.low, self.high)


# The paper's box for k1 and k2; the gains come first.
BOUNDS = (
    Bound("CTL_K1", "k1", paper.LOW[0], paper.HIGH[0]),
    Bound("CTL_K2", "k2", paper.LOW[1], paper.HIGH[1]),
    Bound("EST_TAU_S", "tau_s", 0.5, 30.0, logarithmic=True),
    Bound("RUD_DBAND_DEG", "deadband_deg", 0.0, 5.0),
)
PRICES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0)
FISH, TRIES = 12, 2
# A parameter that brings less than this part of the cost is left as it is.
WORTH = 0.01
GAINS = ("CTL_K1", "CTL_K2")

Tell = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Tuned:
    """What the tuner found: the front, the chosen point, and why it is that one."""

    front: tuple[Score, ...]
    chosen: Score
    why: str
    changed: tuple[str, ...]  # parameters to be written: the gains, and what else differs from the vehicle's
    edges: tuple[str, ...]  # parameters that ended at a bound of the search
    evaluations: int


def tune(
    trials: Trials,
    present: Setting,
    *,
    price: float | None = None,
    only_gains: bool = False,
    evaluations: int = 400,
    seed: int = 1,
    tell: Tell = lambda _text, _part: None,
) -> Tuned:
    """Search at every price, and choose the knee of the front, or what is best at `price`.

    Args:
        trials: the trial runs.
        present: the vehicle's own setting; what is not worth changing stays as it is there.
        price: of rudder travel, against error, both in parts of the paper's gains'; None for the knee.
        only_gains: search k1 and k2 and leave the observer and the deadband alone.
        evaluations: the most for each price.
        seed: of the swarm.
        tell: is told of the progress, a text and a part from 0 to 1.
    """
    box = Box(present, only_gains=only_gains)
    prices = PRICES if price is None else tuple(sorted({*PRICES, price}))
    trials.scores([present])
    for number, each in enumerate(prices):
        _search(trials, box, each, evaluations, seed + number, _teller(tell, number, each, (len(prices), evaluations)))
    # The paper's gains come with an observer of their own, which may not be what is to be kept.
    eligible = [score for score in trials.archive if box.holds(score.setting)]
    found = front(eligible)
    if price is not None:
        best = min(eligible, key=lambda score: trials.cost(score, price))
        why = f"the least error + {price:g} x rudder travel"
        weigh = price
    else:
        good = [score for score in found if score.error <= trials.paper.error]
        best = knee(good) if good else found[-1]
        why = "the knee of the front, among settings that steer no worse than the paper's gains"
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
    """The coordinates of the search: the bounded parameters, those searched by their logarithm as that."""

    def __init__(self, present: Setting, *, only_gains: bool) -> None:
        """Take what stays as it is."""
        self._present = present
        self._bounds = BOUNDS[:2] if only_gains else BOUNDS
        self.low = np.array([bound.coordinate(bound.low) for bound in self._bounds])
        self.high = np.array([bound.coordinate(bound.high) for bound in self._bounds])

    def holds(self, setting: Setting) -> bool:
        """Whether a setting has what is not searched as it is to stay."""
        searched = {bound.field for bound in self._bounds}
        kept = {bound.field for bound in BOUNDS} - searched
        return all(getattr(setting, field) == getattr(self._present, field) for field in kept)

    def setting(self, point: Floats) -> Setting:
        """Return the setting at a point."""
        values = {bound.field: bound.value(float(number)) for bound, number in zip(self._bounds, point, strict=True)}
        return replace(self._present, **values)

    def point(self, setting: Setting) -> Floats:
        """Return the point of a setting, moved into the box."""
        numbers = [bound.coordinate(max(getattr(setting, bound.field), bound.low)) for bound in self._bounds]
        return np.array(np.minimum(numbers, self.high), np.float64)

    def edges(self, setting: Setting) -> tuple[str, ...]:
        """Return the parameters that end at a bound, within a hundredth, though their own range goes on."""
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
    trials: Trials, box: Box, price: float, evaluations: int, seed: int, tell: Callable[[SwarmProgress], None]
) -> None:
    """Let the fish swim at one price; where the other prices' best are, some of them start."""

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
        most_evaluations=evaluations,
    )
    minimise(costs, box.low, box.high, settings, tell, start=start)


def _teller(tell: Tell, number: int, price: float, most: tuple[int, int]) -> Callable[[SwarmProgress], None]:
    """Return a callback; most: how many prices there are, and how many evaluations each may take."""
    prices, evaluations = most

    def told(progress: SwarmProgress) -> None:
        part = min(progress.evaluations / evaluations, 1.0)
        tell(f"price {price:g}: {progress.best_value:.3f}", min((number + part) / prices, 0.999))

    return told


def _price_at(trials: Trials, chosen: Score, prices: Sequence[float]) -> float:
    """Return the price of the list at which a point of the front comes closest to being the best."""

    def regret(price: float) -> float:
        return trials.cost(chosen, price) / min(trials.cost(score, price) for score in trials.archive)

    return min(prices, key=regret)


def _simplified(trials: Trials, best: Score, present: Setting, price: float) -> Score:
    """Round to what can be told apart, and put back what need not change."""
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
        if trials.cost(simpler, price) <= (1.0 + WORTH) * trials.cost(chosen, price):
            chosen = simpler
    return chosen


def _changed(chosen: Score, present: Setting) -> tuple[str, ...]:
    """Return the gains, and what else is not as the vehicle has it."""
    kept, wanted = present.parameters(), chosen.setting.parameters()
    return tuple(name for name in wanted if name in GAINS or wanted[name] != kept[name])
