"""The chain: heading control test, identification, tuning, closed-loop runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.identify.identify import Identification, identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.reproduce.heading_test import PAPER_SETTINGS, HeadingTest, run_heading_test
from hil.lab.reproduce.manoeuvre import circles, sail, zigzag
from hil.lab.tune import paper
from hil.lab.tune.cases import autopilot_of
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.search import Tuned, tune
from hil.lab.tune.trials import FIXED_GAINS, Setting, Trials
from hil.report.figures import GoalFigures, goal_figures, goal_spans, heading_error_rad
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run as sail_autopilot
from hil.sim.truth import Truth

ZIGZAG_RAD = radians(20.0)
CIRCLES_RAD = tuple(radians(angle) for angle in (10.0, -10.0, 20.0, -20.0, 30.0, -30.0))

ProgressReport = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Effort:
    """Durations and sizes; the model is identified from `train_s` of the heading control test."""

    train_s: float
    held_out_s: float
    zigzag_s: float
    circle_s: float
    evaluations: int
    scenarios: tuple[str, ...]
    goals: str
    run_s: float


FULL = Effort(1800.0, 600.0, 3600.0, 600.0, 300, ("tank", "sea", "swell", "weak"), "0:0,120:60,720:-90", 1320.0)
QUICK = Effort(600.0, 300.0, 1800.0, 300.0, 120, ("tank", "sea"), "0:0,10:60", 330.0)


@dataclass(frozen=True, slots=True)
class Voyage:
    """A closed-loop run by the real autopilot."""

    scenario: str
    gains: str
    truth: Truth
    figures: tuple[GoalFigures, ...]

    @property
    def largest_error_deg(self) -> float:
        """Return the largest error of the hull's heading in the steady parts."""
        largest_rad = 0.0
        truth = self.truth
        for (first, last), goal in zip(goal_spans(truth.goal_rad), self.figures, strict=False):
            steady = first + int(np.searchsorted(truth.time_s[first:last], goal.steady_from_s - 1e-9))
            errors = np.abs(heading_error_rad(truth.heading_low_rad[steady:last], truth.goal_rad[steady:last]))
            largest_rad = max(largest_rad, float(np.max(errors, initial=0.0)))
        return math.degrees(largest_rad)

    @property
    def p95_error_deg(self) -> float:
        """Return the 95 % quantile of the errors, the largest of all steady parts."""
        return max(goal.p95_error_deg for goal in self.figures)


@dataclass(frozen=True, slots=True)
class Chain:
    """All results; `open_loop` is the model from zigzag and circles."""

    effort: Effort
    test: HeadingTest
    open_loop: Identification
    studies: tuple[StepStudy, ...]
    trials: Trials
    tuned: Tuned
    voyages: tuple[Voyage, ...]

    @property
    def model(self) -> KtModel:
        """Return the model from the heading control test, at the paper's speed."""
        return self.test.found.model().at_speed(OCEAN_RAMBLER.speed_m_s)


def run_chain(effort: Effort, out: Path, seed: int, report_progress: ProgressReport) -> Chain:
    """Run the chain; recordings and runs are written to `out`."""
    report_progress("heading control test in the tank", 0.0)
    test = run_heading_test(effort.train_s, effort.held_out_s, out / "heading-test", seed)
    model = test.found.model().at_speed(OCEAN_RAMBLER.speed_m_s)
    report_progress("zigzag and circles in the tank", 0.3)
    open_loop = _identified_open_loop(effort, out, seed)
    report_progress("tuning", 0.4)
    parameters = with_model(ParameterSet(), model)
    autopilot = autopilot_of(parameters)
    studies = tuple(paper.study(step_deg, model, autopilot, seed) for step_deg in paper.STEPS_DEG)
    trials = Trials(model, parameters, effort.scenarios, seed)
    tuned = tune(trials, Setting.of(parameters), evaluations=effort.evaluations, seed=seed)
    voyages = _voyages(effort, out, seed, model, tuned, report_progress)
    return Chain(effort, test, open_loop, studies, trials, tuned, voyages)


def _identified_open_loop(effort: Effort, out: Path, seed: int) -> Identification:
    tank = scenarios.find_scenario("tank")
    recorded = {
        "zigzag": sail(OCEAN_RAMBLER, tank, zigzag(ZIGZAG_RAD, ZIGZAG_RAD), effort.zigzag_s, seed),
        "circles": sail(
            OCEAN_RAMBLER, tank, circles(CIRCLES_RAD, effort.circle_s), len(CIRCLES_RAD) * effort.circle_s, seed + 1
        ),
    }
    for name, manoeuvre in recorded.items():
        manoeuvre.write(out / f"{name}.csv")
    return identify([read(out / f"{name}.csv") for name in recorded])


def with_model(parameters: ParameterSet, model: KtModel) -> ParameterSet:
    """Return the parameters with a model."""
    for name, value in model_settings(model).items():
        parameters = parameters.replaced(name, value)
    return parameters


def model_settings(model: KtModel) -> dict[str, float]:
    """Return the model as the autopilot's parameters."""
    return {
        "MDL_K": model.turning_ability_1_s,
        "MDL_T_S": model.turning_lag_s,
        "MDL_ALPHA_S2": max(model.norrbin_s2, 0.0),
        "MDL_SPEED": model.speed_m_s,
    }


def _voyages(
    effort: Effort, out: Path, seed: int, model: KtModel, tuned: Tuned, report_progress: ProgressReport
) -> tuple[Voyage, ...]:
    """Run the autopilot in tank and sea with the paper's and with the tuned gains."""
    chosen = {name: tuned.chosen.setting.parameters()[name] for name in tuned.changed}
    runs = [
        (sea, name, gains) for sea in ("tank", "sea") for name, gains in (("paper", PAPER_SETTINGS), ("tuned", chosen))
    ]
    voyages = []
    for number, (sea, name, gains) in enumerate(runs):
        report_progress(f"the autopilot in the {sea}, {name} gains", 0.5 + 0.5 * number / len(runs))
        options = RunOptions(
            scenario=scenarios.find_scenario(sea),
            seconds=effort.run_s,
            out=out / f"{sea}-{name}",
            seed=seed,
            goals=parse_goals(effort.goals),
            settings={**model_settings(model), **FIXED_GAINS, **gains},
        )
        truth = sail_autopilot(options).truth.table()
        voyages.append(Voyage(sea, name, truth, goal_figures((truth,))))
    return tuple(voyages)
