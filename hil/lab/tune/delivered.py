"""Trial runs of the default controller in the compiled loop (hil/lab/twin).

Each sea is simulated with the ship of the vehicle file and with two ships whose K, T and alpha differ by 30 %, with
several seeds each. The autopilot uses the model of the vehicle file, and all settings have the same waves and noise.
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
from hil.lab.tune.cases import GOALS_DEG, MAX_LEG_S, MIN_LEG_S, STEADY_FRACTION
from hil.lab.tune.loop_kernel import ITAE, RESULTS, TRAVEL, Floats, Task, measure
from hil.lab.twin import sailing
from hil.lab.twin.plant import Record, Sea
from hil.lab.twin.sea import sea_of
from hil.ship import scenarios
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND

DEG_PER_H = DEGREES_PER_RADIAN * 3600.0
SHIP_FACTORS = ((1.0, 1.0, 1.0), (0.7, 1.3, 1.3), (1.3, 0.7, 0.7))  # of K, T and alpha
SETTLING_S = 150.0  # for the convergence of the estimators, before the first leg
SEEDS, FRESH_SEEDS = 2, 4  # numbers of seeds
FRESH_SEED = 1_000_003  # added to the seed for the fresh seas, which check the choice
SEARCHED_NAMES = ("CTL_PRICE", "RUD_DBAND_DEG")

Setting = tuple[float, ...]


def default_setting() -> Setting:
    """Return the default values of the searched parameters."""
    return tuple(TABLE[index_of(name)].default for name in SEARCHED_NAMES)


def parameters_of(setting: Setting) -> dict[str, float]:
    """Return names and values, rounded as in the autopilot."""
    return {name: to_single(value) for name, value in zip(SEARCHED_NAMES, setting, strict=True)}


@dataclass(frozen=True, slots=True)
class Case:
    """A trial run: a sea, its seed, and the ship's K, T and alpha relative to those of the model."""

    scenario: Scenario
    text: str
    ship: tuple[float, float, float]
    seed: int

    def model(self, model: KtModel) -> KtModel:
        """Return the ship of this case, at the speed of the model."""
        ability, lag, norrbin = self.ship
        return model._replace(
            turning_ability_1_s=model.turning_ability_1_s * ability,
            turning_lag_s=model.turning_lag_s * lag,
            norrbin_s2=model.norrbin_s2 * norrbin,
        )


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a setting.

    `error` is the root mean square over the cases of the ITAE relative to that of the defaults, `worst_error` the
    largest ratio. `travel_deg_per_h` is the mean rudder travel of the steady parts.
    """

    setting: Setting
    error: float
    worst_error: float
    travel_deg_per_h: float


def cases_of(names: Sequence[str], seeds: Sequence[int]) -> tuple[Case, ...]:
    """Return the cases of seas, such as "swell+leeway=8", with all ships and seeds."""
    seas = [(name, scenarios.parse_scenario(name)) for name in names]
    return tuple(Case(sea, name, ship, seed) for (name, sea), ship, seed in product(seas, SHIP_FACTORS, seeds))


def task_of(model: KtModel, limit_rad: float) -> tuple[Task, tuple[Goal, ...], float]:
    """Return legs, goals and duration [s] for a ship with the rudder limit `limit_rad`.

    The length of a leg depends on the turning time of the ship.
    """
    fastest_rad_s = steady_yaw_rate(limit_rad, model.turning_ability_1_s, model.norrbin_s2)
    turn_s = max(abs(GOALS_DEG[0]), abs(GOALS_DEG[1] - GOALS_DEG[0])) / degrees(fastest_rad_s)
    leg_s = clamp(3.0 * (turn_s + 5.0 * model.turning_lag_s), MIN_LEG_S, MAX_LEG_S)
    ticks = round(leg_s * ROWS_PER_SECOND)
    legs = Task(
        np.array([radians(goal) for goal in GOALS_DEG]),
        ticks,
        round((1.0 - STEADY_FRACTION) * ticks),
        1 / ROWS_PER_SECOND,
    )
    goals = [Goal(0.0, 0.0)]
    goals += [Goal(SETTLING_S + number * ticks / ROWS_PER_SECOND, goal) for number, goal in enumerate(GOALS_DEG)]
    return legs, tuple(goals), SETTLING_S + len(GOALS_DEG) * ticks / ROWS_PER_SECOND


class Trials:
    """Trial runs of a vehicle, with an archive of all scores."""

    def __init__(self, model: KtModel, parameters: ParameterSet, names: Sequence[str], seeds: Sequence[int]) -> None:
        """Draw the seas and run them with the defaults; raise ValueError for an invalid model."""
        self.parameters = parameters
        self.seeds = tuple(seeds)
        self.cases = cases_of(names, seeds)
        self.legs, self.goals, self.seconds = task_of(model, radians(parameters["RUD_LIMIT_DEG"]))
        self.seas = [sea_of(case.scenario, case.seed, self.seconds, case.model(model)) for case in self.cases]
        self.archive: list[Score] = []
        with compiling("the closed loop"):
            self.reference = self.results(default_setting())
        self.default_score = self._add_score(default_setting(), self.reference)

    def record(self, setting: Setting, sea: Sea) -> Record:
        """Simulate a sea with a setting; return its record."""
        parameters = self.parameters
        for name, value in parameters_of(setting).items():
            parameters = parameters.replaced(name, value)
        boat, law, task = sailing.boat_of(parameters), LawSettings.of(parameters), sailing.task_of(self.goals)
        return sailing.sail(boat, law, sea, task, self.seconds, ticks=False)[0]

    def results(self, setting: Setting) -> Floats:
        """Return the results (cases, RESULTS) in radians, as loop_kernel.measure defines them."""
        results = np.zeros((len(self.cases), RESULTS))
        first = round(SETTLING_S * ROWS_PER_SECOND)

        def sail(number: int) -> None:
            record = self.record(setting, self.seas[number])
            measure(self.legs, record.heading_rad[first:-1], record.rudder_rad[first:-1], results[number])

        # Threads are faster because compiled code releases the global interpreter lock.
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            list(pool.map(sail, range(len(self.cases))))
        return results

    def score(self, setting: Setting) -> Score:
        """Return the score of a setting, from the archive if it has one."""
        archived = next((score for score in self.archive if score.setting == setting), None)
        return archived or self._add_score(setting, self.results(setting))

    def _add_score(self, setting: Setting, results: Floats) -> Score:
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
        """Return error plus price times rudder travel, both relative to the defaults; inf for NaN."""
        cost = score.error + price * self.travel(score)
        return cost if math.isfinite(cost) else math.inf

    def travel(self, score: Score) -> float:
        """Return the rudder travel of a score relative to the defaults."""
        return score.travel_deg_per_h / max(self.default_score.travel_deg_per_h, 1e-9)
