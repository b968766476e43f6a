"""The trial runs that the delivered controller is tuned by, in the compiled loop (hil/lab/twin).

Each sea is sailed by the ship of the vehicle file and by ships whose K, T and alpha are 30 % off, each with several
seeds, while the autopilot keeps the model of the vehicle file. Every setting meets the same waves and the same noise.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN, clamp, degrees, radians
from firmware_py.common.parameter_row import to_single
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet, index_of
from firmware_py.model.kt import KtModel, steady_yaw_rate
from hil.lab.compiled import compiling
from hil.lab.numeric_core import LawSettings
from hil.lab.tune.cases import GOALS_DEG, LONGEST_LEG_S, SHORTEST_LEG_S, STEADY_PART
from hil.lab.tune.loop_kernel import ITAE, RESULTS, TRAVEL, Floats, Task, measure
from hil.lab.twin import sailing
from hil.lab.twin.plant import Record, Sea
from hil.lab.twin.sea import sea_of
from hil.ship import scenarios
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND

DEG_PER_H = DEGREES_PER_RADIAN * 3600.0
SHIPS = ((1.0, 1.0, 1.0), (0.7, 1.3, 1.3), (1.3, 0.7, 0.7))  # of K, T and alpha
SETTLING_S = 150.0  # before the first leg the estimate finds its feet, unjudged
SEEDS, FRESH_SEEDS = 2, 4
FRESH_SEED = 1_000_003  # added to the seed for the seas that the choice is checked in
# What is searched, with the bounds of the search and the steps that a value is rounded to; the helm's own come first.
SEARCHED = ("CTL_PRICE", "RUD_DBAND_DEG")

Setting = tuple[float, ...]


def default_setting() -> Setting:
    """Return what is searched as it is delivered."""
    return tuple(TABLE[index_of(name)].default for name in SEARCHED)


def parameters_of(setting: Setting) -> dict[str, float]:
    """Return name and value, as the autopilot keeps them."""
    return {name: to_single(value) for name, value in zip(SEARCHED, setting, strict=True)}


@dataclass(frozen=True, slots=True)
class Case:
    """A trial run: a sea and its seed, and by what the ship's K, T and alpha differ from the model's."""

    scenario: Scenario
    text: str
    ship: tuple[float, float, float]
    seed: int

    def model(self, model: KtModel) -> KtModel:
        """Return the ship of this case, at the model's speed."""
        ability, lag, norrbin = self.ship
        return model._replace(
            turning_ability_1_s=model.turning_ability_1_s * ability,
            turning_lag_s=model.turning_lag_s * lag,
            norrbin_s2=model.norrbin_s2 * norrbin,
        )


@dataclass(frozen=True, slots=True)
class Score:
    """What a setting comes to.

    error: root mean square over the cases of its ITAE by that of the delivered defaults, so 1 is as good as they;
    worst_error the largest of them. travel_deg_per_h: of the rudder, in the steady parts, mean over the cases.
    """

    setting: Setting
    error: float
    worst_error: float
    travel_deg_per_h: float


def cases_of(names: Sequence[str], seeds: Sequence[int]) -> tuple[Case, ...]:
    """Return the cases of seas like "swell+leeway=8"; UnknownScenarioError or DisturbanceError for one that is none."""
    seas = [(name, scenarios.sea_of(name)) for name in names]
    return tuple(Case(sea, name, ship, seed) for (name, sea), ship, seed in product(seas, SHIPS, seeds))


def task_of(model: KtModel, limit_rad: float) -> tuple[Task, tuple[Goal, ...], float]:
    """Return the legs that are judged, the goals and the seconds; legs are as long as such a ship needs to turn."""
    fastest_rad_s = steady_yaw_rate(limit_rad, model.turning_ability_1_s, model.norrbin_s2)
    turn_s = max(abs(GOALS_DEG[0]), abs(GOALS_DEG[1] - GOALS_DEG[0])) / degrees(fastest_rad_s)
    leg_s = clamp(3.0 * (turn_s + 5.0 * model.turning_lag_s), SHORTEST_LEG_S, LONGEST_LEG_S)
    ticks = round(leg_s * ROWS_PER_SECOND)
    legs = Task(
        np.array([radians(goal) for goal in GOALS_DEG]), ticks, round((1.0 - STEADY_PART) * ticks), 1 / ROWS_PER_SECOND
    )
    given = [Goal(0.0, 0.0)]
    given += [Goal(SETTLING_S + number * ticks / ROWS_PER_SECOND, goal) for number, goal in enumerate(GOALS_DEG)]
    return legs, tuple(given), SETTLING_S + len(GOALS_DEG) * ticks / ROWS_PER_SECOND


class Trials:
    """The trial runs of a vehicle; every score that was asked for is kept."""

    def __init__(self, model: KtModel, parameters: ParameterSet, names: Sequence[str], seeds: Sequence[int]) -> None:
        """Draw the seas and sail them as delivered; ValueError for a model that is no ship."""
        self.parameters = parameters
        self.seeds = tuple(seeds)
        self.cases = cases_of(names, seeds)
        self.legs, self.goals, self.seconds = task_of(model, radians(parameters["RUD_LIMIT_DEG"]))
        self.seas = [sea_of(case.scenario, case.seed, self.seconds, case.model(model)) for case in self.cases]
        self.archive: list[Score] = []
        with compiling("the closed loop"):
            self.reference = self.results(default_setting())
        self.delivered = self._keep(default_setting(), self.reference)

    def record(self, setting: Setting, sea: Sea) -> Record:
        """Sail a sea with a setting; return its rows."""
        told = self.parameters
        for name, value in parameters_of(setting).items():
            told = told.replaced(name, value)
        boat, law, task = sailing.boat_of(told), LawSettings.of(told), sailing.task_of(self.goals)
        return sailing.sail(boat, law, sea, task, self.seconds, ticks=False)[0]

    def results(self, setting: Setting) -> Floats:
        """Return the results (cases, RESULTS) in radians, as loop_kernel.measure defines them."""
        results = np.zeros((len(self.cases), RESULTS))
        first = round(SETTLING_S * ROWS_PER_SECOND)

        def sail(number: int) -> None:
            record = self.record(setting, self.seas[number])
            measure(self.legs, record.heading_rad[first:-1], record.rudder_rad[first:-1], results[number])

        # Compiled code lets go of the interpreter.
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            list(pool.map(sail, range(len(self.cases))))
        return results

    def score(self, setting: Setting) -> Score:
        """Return and keep the score of a setting; one that is kept is not sailed again."""
        known = next((score for score in self.archive if score.setting == setting), None)
        return known or self._keep(setting, self.results(setting))

    def _keep(self, setting: Setting, results: Floats) -> Score:
        ratio = results[:, ITAE] / self.reference[:, ITAE]
        score = Score(
            setting,
            float(np.sqrt(np.mean(np.square(ratio)))),
            float(np.max(ratio)),
            float(np.mean(results[:, TRAVEL])) * DEG_PER_H,
        )
        self.archive.append(score)
        return score

    def cost(self, score: Score, price: float) -> float:
        """Return error plus price times rudder travel, both in parts of the delivered; inf for what is no number."""
        cost = score.error + price * self.travel(score)
        return cost if math.isfinite(cost) else math.inf

    def travel(self, score: Score) -> float:
        """Return a score's rudder travel in parts of the delivered."""
        return score.travel_deg_per_h / max(self.delivered.travel_deg_per_h, 1e-9)
