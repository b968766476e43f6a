"""Reproduce the paper: heading control test, identification, tuning, and closed-loop runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import clamp, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab.identify.identify import Identification, identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.reproduce.heading_test import PAPER_SETTINGS, HeadingTest, run_heading_test
from hil.lab.tune import paper
from hil.lab.tune.cases import autopilot_of
from hil.lab.tune.paper import StepStudy
from hil.lab.tune.search import TuningResult, tune
from hil.lab.tune.trials import FIXED_GAINS, Setting, Trials
from hil.report.figures import GoalFigures, goal_figures, goal_spans, heading_error_rad
from hil.ship import scenarios
from hil.ship.hull import GRID_S, STEPS_PER_SECOND, Hull
from hil.ship.noise import Stream, generator
from hil.ship.scenarios import Scenario
from hil.ship.servo import DEFAULT_SLEW_RAD_S
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run as run_autopilot
from hil.sim.truth import Truth

Floats = NDArray[np.float64]
Steer = Callable[[float, float], float]  # time [s], measured heading [rad] -> rudder [rad]

# A recording as of an onboard log: compass and encoder, ten rows per second.
COLUMNS = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
ROWS_PER_SECOND = 10
STEPS_PER_ROW = STEPS_PER_SECOND // ROWS_PER_SECOND
COMPASS_NOISE_RAD = radians(0.3)
COMPASS_RESOLUTION_RAD = radians(0.1)
ENCODER_RAD = 2.0 * math.pi / 4096.0


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A simulated recording: times [s], measured rudder and heading [rad, unwrapped].

    `heading_low_rad` is the true heading of the hull without the yaw from waves, `speed_m_s` that of the scenario.
    """

    time_s: Floats
    rudder_rad: Floats
    heading_rad: Floats
    heading_low_rad: Floats
    speed_m_s: float

    def write(self, path: Path) -> None:
        """Write the manoeuvre CSV; the yaw rate is empty, since the paper's boat has no gyroscope."""
        with path.open("w", encoding="ascii", newline="\n") as file:
            file.write(COLUMNS + "\n")
            for row in zip(self.time_s, self.rudder_rad, self.heading_rad, strict=True):
                file.write(f"{row[0]:.1f},{row[1]:.6f},{row[2]:.6f},,{self.speed_m_s:g}\n")


def zigzag(rudder_rad: float, turn_rad: float) -> Steer:
    """Return a rudder law that changes the side of the rudder each time the heading reaches `turn_rad` on that side."""
    side = 1.0

    def steer(_time_s: float, heading_rad: float) -> float:
        nonlocal side
        if heading_rad * side >= turn_rad:
            side = -side
        return side * rudder_rad

    return steer


def circles(rudders_rad: tuple[float, ...], duration_s: float) -> Steer:
    """Return a rudder law with one rudder angle after the other, each for `duration_s`, the last one until the end."""

    def steer(time_s: float, _heading_rad: float) -> float:
        return rudders_rad[min(int(time_s / duration_s), len(rudders_rad) - 1)]

    return steer


def simulate_manoeuvre(model: KtModel, sea: Scenario, steer: Steer, seconds: float, seed: int) -> Manoeuvre:
    """Simulate a manoeuvre from heading 0 and yaw rate 0."""
    hull = Hull(sea, model, seed)
    noise_rad = COMPASS_NOISE_RAD * generator(seed, Stream.COMPASS).standard_normal(round(seconds * ROWS_PER_SECOND))
    rows = np.zeros((noise_rad.size, 4))
    angle_rad = 0.0
    max_change_rad = DEFAULT_SLEW_RAD_S * GRID_S
    for row, noise in enumerate(noise_rad.tolist()):
        measured_rad = _round(hull.heading_rad(0.0) + noise, COMPASS_RESOLUTION_RAD)
        rows[row] = (row / ROWS_PER_SECOND, _round(angle_rad, ENCODER_RAD), measured_rad, hull.heading_low_rad(0.0))
        # The servo stops at a full count, so that the encoder has no mean error.
        target_rad = _round(steer(row / ROWS_PER_SECOND, measured_rad), ENCODER_RAD)
        for _ in range(STEPS_PER_ROW):
            angle_rad += clamp(target_rad - angle_rad, -max_change_rad, max_change_rad)
            hull.step(angle_rad)
    time_s, rudder_rad, heading_rad, low_rad = rows.T.copy()
    return Manoeuvre(time_s, rudder_rad, heading_rad, low_rad, sea.speed_m_s)


def _round(angle_rad: float, resolution_rad: float) -> float:
    return math.floor(angle_rad / resolution_rad + 0.5) * resolution_rad


ZIGZAG_RAD = radians(20.0)
CIRCLES_RAD = tuple(radians(angle) for angle in (10.0, -10.0, 20.0, -20.0, 30.0, -30.0))

ProgressReport = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Effort:
    """Durations and sizes of all steps.

    `train_s`, `validation_s`: parts of the heading control test that identify the model and that test it. `circle_s`:
    duration at each rudder angle. `evaluations`, `scenarios`: of the tuning. `goals`, `run_s`: of the closed-loop runs.
    """

    train_s: float
    validation_s: float
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
    """A closed-loop run of the real autopilot."""

    scenario: str
    gains: str
    truth: Truth
    figures: tuple[GoalFigures, ...]

    @property
    def max_error_deg(self) -> float:
        """Return the largest error of the hull's heading in the steady parts."""
        max_error_rad = 0.0
        truth = self.truth
        for (first, last), goal in zip(goal_spans(truth.goal_rad), self.figures, strict=False):
            steady_start = first + int(np.searchsorted(truth.time_s[first:last], goal.steady_from_s - 1e-9))
            errors = np.abs(
                heading_error_rad(truth.heading_low_rad[steady_start:last], truth.goal_rad[steady_start:last])
            )
            max_error_rad = max(max_error_rad, float(np.max(errors, initial=0.0)))
        return math.degrees(max_error_rad)

    @property
    def p95_error_deg(self) -> float:
        """Return the largest of the 95 % quantiles of the error in the steady parts."""
        return max(goal.p95_error_deg for goal in self.figures)


@dataclass(frozen=True, slots=True)
class Chain:
    """All results of the chain; `open_loop` is the model from zigzag and circles."""

    effort: Effort
    test: HeadingTest
    open_loop: Identification
    studies: tuple[StepStudy, ...]
    trials: Trials
    tuned: TuningResult
    voyages: tuple[Voyage, ...]

    @property
    def model(self) -> KtModel:
        """Return the model from the heading control test, at the paper's speed."""
        return self.test.identification.model().at_speed(OCEAN_RAMBLER.speed_m_s)


def run_chain(effort: Effort, out: Path, seed: int, report_progress: ProgressReport) -> Chain:
    """Run the chain and write recordings and runs to the directory `out`."""
    report_progress("heading control test in the tank", 0.0)
    test = run_heading_test(effort.train_s, effort.validation_s, out / "heading-test", seed)
    model = test.identification.model().at_speed(OCEAN_RAMBLER.speed_m_s)
    report_progress("zigzag and circles in the tank", 0.3)
    open_loop = _identify_open_loop(effort, out, seed)
    report_progress("tuning", 0.4)
    parameters = with_model(ParameterSet(), model)
    autopilot = autopilot_of(parameters)
    studies = tuple(paper.study(step_deg, model, autopilot, seed) for step_deg in paper.STEPS_DEG)
    trials = Trials(model, parameters, effort.scenarios, seed)
    tuned = tune(trials, Setting.of(parameters), evaluations=effort.evaluations, seed=seed)
    voyages = _run_voyages(effort, out, seed, model, tuned, report_progress)
    return Chain(effort, test, open_loop, studies, trials, tuned, voyages)


def _identify_open_loop(effort: Effort, out: Path, seed: int) -> Identification:
    tank = scenarios.find_scenario("tank")
    manoeuvres = {
        "zigzag": simulate_manoeuvre(OCEAN_RAMBLER, tank, zigzag(ZIGZAG_RAD, ZIGZAG_RAD), effort.zigzag_s, seed),
        "circles": simulate_manoeuvre(
            OCEAN_RAMBLER, tank, circles(CIRCLES_RAD, effort.circle_s), len(CIRCLES_RAD) * effort.circle_s, seed + 1
        ),
    }
    for name, manoeuvre in manoeuvres.items():
        manoeuvre.write(out / f"{name}.csv")
    return identify([read(out / f"{name}.csv") for name in manoeuvres])


def with_model(parameters: ParameterSet, model: KtModel) -> ParameterSet:
    """Return the parameters with those of a model replaced."""
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


def _run_voyages(
    effort: Effort, out: Path, seed: int, model: KtModel, tuned: TuningResult, report_progress: ProgressReport
) -> tuple[Voyage, ...]:
    """Run the autopilot in the tank and at sea, with the paper's and with the tuned gains."""
    tuned_gains = {name: tuned.chosen.setting.parameters()[name] for name in tuned.changed_names}
    runs = [
        (sea, name, gains)
        for sea in ("tank", "sea")
        for name, gains in (("paper", PAPER_SETTINGS), ("tuned", tuned_gains))
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
        truth = run_autopilot(options).truth.table()
        voyages.append(Voyage(sea, name, truth, goal_figures((truth,))))
    return tuple(voyages)
