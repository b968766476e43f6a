"""The chain, link by link: manoeuvres, identification, tuning, closed-loop runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.identify.identify import Identification, identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.reproduce.manoeuvre import Floats, Manoeuvre, circles, predicted, sail, zigzag
from hil.lab.tune import paper
from hil.lab.tune.cases import pilot_of
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.search import Tuned, tune
from hil.lab.tune.trials import FIXED_GAINS, Setting, Trials
from hil.report.figures import GoalFigures, goal_figures, goal_spans, off_goal_rad
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run as sail_autopilot
from hil.sim.truth import Truth

ZIGZAG_RAD = radians(20.0)
CIRCLES_RAD = tuple(radians(angle) for angle in (10.0, -10.0, 20.0, -20.0, 30.0, -30.0))
PAPER_SETTINGS = {"CTL_K1": paper.K1, "CTL_K2": paper.K2}

Tell = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Effort:
    """How long everything lasts."""

    zigzag_s: float
    circle_s: float
    held_out_s: float
    evaluations: int
    scenarios: tuple[str, ...]
    goals: str
    run_s: float


FULL = Effort(3600.0, 600.0, 900.0, 300, ("tank", "sea", "swell", "weak"), "0:0,120:60,720:-90", 1320.0)
QUICK = Effort(1800.0, 300.0, 600.0, 120, ("tank", "sea"), "0:0,10:60", 330.0)


@dataclass(frozen=True, slots=True)
class Voyage:
    """A closed-loop run by the real autopilot."""

    scenario: str
    gains: str
    truth: Truth
    figures: tuple[GoalFigures, ...]

    @property
    def largest_error_deg(self) -> float:
        """The largest error of the hull's heading in the steady parts."""
        largest_rad = 0.0
        truth = self.truth
        for (first, last), goal in zip(goal_spans(truth.goal_rad), self.figures, strict=False):
            steady = first + int(np.searchsorted(truth.time_s[first:last], goal.steady_from_s - 1e-9))
            errors = np.abs(off_goal_rad(truth.heading_low_rad[steady:last], truth.goal_rad[steady:last]))
            largest_rad = max(largest_rad, float(np.max(errors, initial=0.0)))
        return math.degrees(largest_rad)

    @property
    def p95_error_deg(self) -> float:
        """95 % of the errors of the worst steady part lie within this."""
        return max(goal.p95_error_deg for goal in self.figures)


@dataclass(frozen=True, slots=True)
class Chain:
    """Everything that the table is made of."""

    effort: Effort
    zigzag: Identification
    everything: Identification
    held_out: Manoeuvre
    prediction_rad: Floats
    studies: tuple[StepStudy, ...]
    trials: Trials
    tuned: Tuned
    voyages: tuple[Voyage, ...]

    @property
    def model(self) -> KtModel:
        """The identified model, of all manoeuvres together."""
        return self.everything.model()

    @property
    def prediction_error_deg(self) -> Floats:
        """Heading predicted less heading measured."""
        return (self.prediction_rad - self.held_out.heading_rad) * DEGREES_PER_RADIAN


def run_chain(effort: Effort, out: Path, seed: int, tell: Tell) -> Chain:
    """Go through the chain; what is recorded is written to out."""
    tell("manoeuvres in the tank", 0.0)
    tank = scenarios.named("tank")
    recorded = {
        "zigzag": sail(OCEAN_RAMBLER, tank, zigzag(ZIGZAG_RAD, ZIGZAG_RAD), effort.zigzag_s, seed),
        "circles": sail(
            OCEAN_RAMBLER, tank, circles(CIRCLES_RAD, effort.circle_s), len(CIRCLES_RAD) * effort.circle_s, seed + 1
        ),
        "held-out": sail(OCEAN_RAMBLER, tank, zigzag(ZIGZAG_RAD, ZIGZAG_RAD), effort.held_out_s, seed + 2),
    }
    for name, manoeuvre in recorded.items():
        manoeuvre.write(out / f"{name}.csv")
    tell("identification", 0.1)
    zigzag_recording, circle_recording = (read(out / f"{name}.csv") for name in ("zigzag", "circles"))
    from_zigzag = identify([zigzag_recording])
    from_both = identify([zigzag_recording, circle_recording], model="cubic")
    model = from_both.model()
    tell("tuning", 0.3)
    parameters = with_model(ParameterSet(), model)
    pilot = pilot_of(parameters)
    studies = tuple(paper.study(step_deg, model, pilot, seed) for step_deg in paper.STEPS_DEG)
    trials = Trials(model, parameters, effort.scenarios, seed)
    tuned = tune(trials, Setting.of(parameters), evaluations=effort.evaluations, seed=seed)
    voyages = _voyages(effort, out, seed, model, tuned, tell)
    return Chain(
        effort=effort,
        zigzag=from_zigzag,
        everything=from_both,
        held_out=recorded["held-out"],
        prediction_rad=predicted(model, recorded["held-out"]),
        studies=studies,
        trials=trials,
        tuned=tuned,
        voyages=voyages,
    )


def with_model(parameters: ParameterSet, model: KtModel) -> ParameterSet:
    """Return the parameters with a model in them."""
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


def _voyages(effort: Effort, out: Path, seed: int, model: KtModel, tuned: Tuned, tell: Tell) -> tuple[Voyage, ...]:
    """Sail tank and sea, each with the paper's gains and with the tuned ones; the ship stays the true one."""
    chosen = {name: tuned.chosen.setting.parameters()[name] for name in tuned.changed}
    runs = [
        (sea, name, gains) for sea in ("tank", "sea") for name, gains in (("paper", PAPER_SETTINGS), ("tuned", chosen))
    ]
    voyages = []
    for number, (sea, name, gains) in enumerate(runs):
        tell(f"the autopilot in the {sea}, {name} gains", 0.5 + 0.5 * number / len(runs))
        options = RunOptions(
            scenario=scenarios.named(sea),
            seconds=effort.run_s,
            out=out / f"{sea}-{name}",
            seed=seed,
            goals=parse_goals(effort.goals),
            settings={**model_settings(model), **FIXED_GAINS, **gains},
        )
        truth = sail_autopilot(options).truth.table()
        voyages.append(Voyage(sea, name, truth, goal_figures((truth,))))
    return tuple(voyages)
