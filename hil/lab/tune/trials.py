"""Scores of a setting: error and rudder travel over all trial runs, relative to the paper's gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN, radians
from firmware_py.common.parameter_row import to_single
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet, index_of
from firmware_py.model.kt import KtModel
from hil.lab.compiled import compiling
from hil.lab.tune import cases as trial_cases
from hil.lab.tune import paper
from hil.lab.tune.loop_kernel import ITAE, RESULTS, TRAVEL, Floats, run_all

DEG_PER_H = DEGREES_PER_RADIAN * 3600.0
# These values select the S-surface with the fixed-gain observer.
FIXED_GAINS = {"CTL_MODE": 0.0, "EST_MODE": 0.0}
NAMES = ("CTL_K1", "CTL_K2", "EST_TAU_S", "RUD_DBAND_DEG")


@dataclass(frozen=True, slots=True)
class Setting:
    """The searched parameters: k1, k2, the observer's time constant [s], the rudder's deadband [deg]."""

    k1: float
    k2: float
    tau_s: float
    deadband_deg: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> Setting:
        """Read the setting of a vehicle."""
        return cls(*(parameters[name] for name in NAMES))

    def parameters(self) -> dict[str, float]:
        """Return names and values, rounded as in the autopilot."""
        values = (self.k1, self.k2, self.tau_s, self.deadband_deg)
        return {name: to_single(value) for name, value in zip(NAMES, values, strict=True)}


PAPER = Setting(
    paper.PAPER_K1, paper.PAPER_K2, *(TABLE[index_of(name)].default for name in ("EST_TAU_S", "RUD_DBAND_DEG"))
)


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a setting.

    `error` is the root mean square over the cases of the ITAE relative to that of the paper's gains, `worst_error` the
    largest ratio. `travel_deg_per_h` is the mean rudder travel of the steady parts.
    """

    setting: Setting
    error: float
    worst_error: float
    travel_deg_per_h: float


class Trials:
    """Trial runs of a vehicle, with an archive of all scores."""

    def __init__(
        self,
        model: KtModel,
        parameters: ParameterSet,
        names: Sequence[str] = trial_cases.DEFAULT_SCENARIOS,
        seed: int = 1,
    ) -> None:
        """Draw the seas and run them with the paper's gains; raise ValueError for an invalid model."""
        self.autopilot = trial_cases.autopilot_of(parameters)
        self.cases = trial_cases.cases_of(names)
        self.task = trial_cases.task_of(model, self.autopilot)
        self.seas = trial_cases.seas_of(self.cases, model, self.task, seed)
        self.archive: list[Score] = []
        with compiling("the closed loop"):
            self.reference = self.results([PAPER])[0]
        self.paper = self.scores([PAPER])[0]

    def results(self, settings: Sequence[Setting]) -> Floats:
        """Return the results (settings, cases, RESULTS) in radians, as loop_kernel.measure defines them."""
        rows = np.array([self.row_of(setting) for setting in settings])
        results = np.zeros((len(rows), len(self.cases), RESULTS))
        run_all(rows, self.autopilot, self.task, self.seas, results)
        return results

    @staticmethod
    def row_of(setting: Setting) -> Floats:
        """Return a setting as a row for the compiled loop."""
        return np.array([setting.k1, setting.k2, setting.tau_s, radians(setting.deadband_deg)])

    def scores(self, settings: Sequence[Setting]) -> list[Score]:
        """Return the score of each setting and add it to the archive."""
        results = self.results(settings)
        ratios = results[:, :, ITAE] / self.reference[:, ITAE]
        scores = [
            Score(
                setting=setting,
                error=float(np.sqrt(np.mean(np.square(ratio)))),
                worst_error=float(np.max(ratio)),
                travel_deg_per_h=float(np.mean(travel)) * DEG_PER_H,
            )
            for setting, ratio, travel in zip(settings, ratios, results[:, :, TRAVEL], strict=True)
        ]
        self.archive += scores
        return scores

    def cost(self, score: Score, price: float) -> float:
        """Return error plus price times rudder travel, both relative to the paper's gains; inf for NaN."""
        cost = score.error + price * score.travel_deg_per_h / max(self.paper.travel_deg_per_h, 1e-9)
        return cost if math.isfinite(cost) else math.inf


def pareto_front(scores: Sequence[Score]) -> list[Score]:
    """Return the Pareto front of error and travel, sorted by travel."""
    lowest_error = math.inf
    pareto_scores = []
    for score in sorted(scores, key=lambda score: (score.travel_deg_per_h, score.error)):
        if score.error < lowest_error:
            lowest_error = score.error
            pareto_scores.append(score)
    return pareto_scores


def knee_of(scores: Sequence[Score]) -> Score:
    """Return the score of a front that is farthest below the line between its ends, on logarithmic axes.

    The axes are logarithmic because relative changes of error and travel are compared.
    """
    travel = np.log([max(score.travel_deg_per_h, 1e-3) for score in scores])
    error = np.log([score.error for score in scores])
    if len(scores) < 3:
        return scores[int(np.argmin(error))]
    x = (travel - travel[0]) / (travel[-1] - travel[0])
    y = (error - error[-1]) / (error[0] - error[-1])
    return scores[int(np.argmin(x + y))]
