"""Search for the constants of the control law (firmware_py/control/law.py) in the compiled loop.

The goals are those of docs/explanation/steering.md. The cost of a run is the mean square of the heading error plus a
price for the rudder travel of its steady parts. The cost of a setting is the mean over the seas of the cost relative to
that of the present constants. The fish swarm searches in seas with some seeds; seas with other seeds check its result.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from hil.lab.compare.score import score_of
from hil.lab.compiled import compiling
from hil.lab.numeric_core import LawConstants, LawSettings
from hil.lab.swarm import SwarmProgress, SwarmSettings, minimise
from hil.lab.tune.loop_kernel import Floats
from hil.lab.tune.search import Bound, ProgressReport
from hil.lab.twin import sailing
from hil.lab.twin.plant import Sea
from hil.lab.twin.sea import sea_of
from hil.ship import scenarios
from hil.sim.goals import parse_goals

GOALS: Final = parse_goals("0:0,120:60,720:-30")
SECONDS: Final = 1320.0
# Seas of the proof tests, a ship with twice the gain, and a delay of two seconds.
SEAS: Final = (
    *("tank", "sea", "swell", "weak", "ocean-1", "ocean-3", "ocean-4", "tank+kt=2", "swell+delay=2"),
    *("sea+float=0.3:0.6", "weak+float=0.3:0.6", "swell+leeway=8", "swell+float=0.2:0.5,orbital=0.4,leeway=8"),
)
FIRST_SEED: Final = 100  # added to the seed, because the proof tests use the smaller ones
SEEDS, FRESH_SEEDS = 16, 16
PRICE: Final = 5e-4  # deg^2 per deg/h
MAX_RATIOS: Final = (1.0, 1.02)  # of rms error and rudder travel in any sea, relative to the present constants
BOUNDS: Final = (
    Bound("GAIN_FACTOR", "gain_factor", 70.0, 280.0, logarithmic=True),
    Bound("CROSSOVER_RAD_S", "crossover_rad_s", 0.13, 0.31, logarithmic=True),
    Bound("REST_RAD", "rest_rad", radians(0.05), radians(1.0), logarithmic=True),
    Bound("BAND_SQRT_S", "band_sqrt_s", 0.7, 6.0, logarithmic=True),
)
TRIES = 1
VISION, STEP = 0.2, 0.12  # relative to the diagonal of the box
START_STEP = 0.2  # change of the logarithm of a constant

Setting = tuple[float, ...]
DELIVERED_SETTING: Final[Setting] = tuple(LawConstants())


class LawTrials:
    """Trial runs in seas with some seeds; `results` (seas, seeds, 2) are rms error [deg] and rudder travel [deg/h]."""

    def __init__(self, names: Sequence[str], seeds: Sequence[int], price: float = PRICE) -> None:
        """Draw the seas and run them with the present constants."""
        self.names, self.seeds, self.price = tuple(names), tuple(seeds), price
        self.seas = [sea_of(scenarios.parse_scenario(name), seed, SECONDS) for name in names for seed in seeds]
        with compiling("the closed loop"):
            self.default_results = self.results(DELIVERED_SETTING)

    def results(self, setting: Setting) -> Floats:
        """Simulate all seas with a setting."""
        parameters = ParameterSet()
        boat, law = sailing.boat_of(parameters), LawSettings.of(parameters)._replace(constants=LawConstants(*setting))
        task = sailing.task_of(GOALS)

        def simulate(sea: Sea) -> tuple[float, float]:
            record, _ = sailing.sail(boat, law, sea, task, SECONDS, ticks=False)
            score = score_of(sailing.truth_of(record, GOALS))
            return score.rms_deg, score.travel_deg_per_h

        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:  # compiled code releases the global interpreter lock
            found = list(pool.map(simulate, self.seas))
        return np.array(found).reshape(len(self.names), len(self.seeds), 2)

    def costs(self, results: Floats) -> Floats:
        """Return the cost of each sea relative to that of the present constants."""
        costs_of_setting, costs_of_defaults = (self._run_costs(one) for one in (results, self.default_results))
        return costs_of_setting / costs_of_defaults

    def cost(self, results: Floats) -> float:
        """Return the cost of a setting; inf for NaN."""
        # Penalties: an improvement in one sea must not increase the error in another sea, or the rudder travel by much.
        ratios = self._rms_over_seeds(results) / self._rms_over_seeds(self.default_results)
        excess = np.maximum(ratios - np.array(MAX_RATIOS), 0.0)
        cost = float(np.mean(self.costs(results)) + np.sum(excess))
        return cost if np.isfinite(cost) else np.inf

    def _rms_over_seeds(self, results: Floats) -> Floats:
        means: Floats = np.sqrt(np.mean(np.square(results), axis=1))
        return means

    def _run_costs(self, results: Floats) -> Floats:
        cost: Floats = np.mean(np.square(results[:, :, 0]) + self.price * results[:, :, 1], axis=1)
        return cost


@dataclass(frozen=True, slots=True)
class LawSearchResult:
    """Result of the search: constants and their costs in the seas of the search and in the fresh seas."""

    setting: Setting
    cost: float
    fresh_cost: float
    fresh_results: Floats
    evaluations: int

    @property
    def is_better(self) -> bool:
        """Return whether the constants are better than the present ones in the fresh seas, too."""
        return self.setting != DELIVERED_SETTING and self.fresh_cost < 1.0


def search(
    trials: LawTrials, fresh: LawTrials, evaluations: int, seed: int, report_progress: ProgressReport
) -> LawSearchResult:
    """Search for the constants with the smallest cost, from the present ones."""
    costs_by_setting: dict[Setting, float] = {DELIVERED_SETTING: 1.0}

    def cost(point: Floats) -> float:
        # More than three digits have no effect in these seas.
        setting = tuple(float(f"{bound.value(float(x)):.3g}") for bound, x in zip(BOUNDS, point, strict=True))
        if setting not in costs_by_setting:
            costs_by_setting[setting] = trials.cost(trials.results(setting))
        return costs_by_setting[setting]

    def on_progress(progress: SwarmProgress) -> None:
        fraction = min(progress.evaluations / evaluations, 0.999)
        report_progress(f"{progress.evaluations} settings: {progress.best_value:.4f}", fraction)

    low, high = (np.array([bound.coordinate(end) for bound, end in _limits(number)]) for number in (0, 1))
    present = np.array([bound.coordinate(value) for bound, value in zip(BOUNDS, DELIVERED_SETTING, strict=True)])
    # The first fish starts at the present constants, each other fish with one of them changed.
    start_points = np.array([present, *(present + START_STEP * change for change in np.eye(len(BOUNDS)))])
    settings = SwarmSettings(
        fish=len(start_points),
        tries=TRIES,
        iterations=evaluations,
        vision=VISION,
        step=STEP,
        shrink=0.1,
        seed=seed,
        max_evaluations=evaluations,
    )
    minimise(
        lambda points: np.array([cost(point) for point in points]),
        low,
        high,
        settings,
        on_progress,
        start=np.clip(start_points, low, high),
    )
    best = min(costs_by_setting, key=lambda setting: costs_by_setting[setting])
    results = fresh.results(best)
    return LawSearchResult(best, costs_by_setting[best], fresh.cost(results), results, len(costs_by_setting))


def _limits(number: int) -> list[tuple[Bound, float]]:
    return [(bound, (bound.low, bound.high)[number]) for bound in BOUNDS]


def as_json(trials: LawTrials, fresh: LawTrials, found: LawSearchResult) -> dict[str, Any]:
    """Return the results for JSON."""
    names = [bound.field for bound in BOUNDS]
    costs = fresh.costs(found.fresh_results).tolist()
    seas = []
    for number, name in enumerate(fresh.names):
        row: dict[str, Any] = {"scenario": name, "cost": round(costs[number], 4)}
        for key, results in (("delivered", fresh.default_results), ("found", found.fresh_results)):
            rms_deg, travel_deg_per_h = _mean_figures(results[number])
            row[key] = {"rms_error_deg": round(rms_deg, 4), "rudder_travel_deg_per_h": round(travel_deg_per_h, 1)}
        seas.append(row)
    return {
        "seeds": list(trials.seeds),
        "fresh_seeds": list(fresh.seeds),
        "price_deg2_per_deg_h": trials.price,
        "delivered": dict(zip(names, DELIVERED_SETTING, strict=True)),
        "found": dict(zip(names, found.setting, strict=True)),
        "cost": round(found.cost, 5),
        "fresh_cost": round(found.fresh_cost, 5),
        "better": found.is_better,
        "evaluations": found.evaluations,
        "trial_runs": found.evaluations * len(trials.seas),
        "fresh_seas": seas,
    }


def _mean_figures(results: Floats) -> tuple[float, float]:
    return float(np.sqrt(np.mean(np.square(results[:, 0])))), float(np.mean(results[:, 1]))


def text(trials: LawTrials, fresh: LawTrials, found: LawSearchResult) -> str:
    """Return the text for the terminal: seeds, constants, and the results of each fresh sea."""
    lines = [
        f"seeds {' '.join(map(str, trials.seeds))}, fresh {' '.join(map(str, fresh.seeds))}",
        f"{found.evaluations} settings in {len(trials.seas)} runs each, {trials.price:g} deg^2 for each deg/h",
    ]
    for bound, default_value, value in zip(BOUNDS, DELIVERED_SETTING, found.setting, strict=True):
        lines.append(f"{bound.field}: {default_value:.4g} present, {value:.4g} found")
    lines.append(f"cost relative to the present constants: {found.cost:.4f}, in fresh seas {found.fresh_cost:.4f}")
    lines.append("the constants found are better" if found.is_better else "the present constants are kept")
    rows = [("sea", "present", "found", "cost")]
    costs = fresh.costs(found.fresh_results).tolist()
    for number, name in enumerate(fresh.names):
        results_of_both = (fresh.default_results[number], found.fresh_results[number])
        cells = ["{:.2f} deg, {:.0f} deg/h".format(*_mean_figures(results)) for results in results_of_both]
        rows.append((name, cells[0], cells[1], f"{costs[number]:.3f}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines += ["", *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)]
    return "\n".join(lines)
