"""Run a comparison of controllers in several seas with several seeds."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from firmware_py.common.parameters import ParameterSet
from hil.lab.compare.score import Score, mean_of, score_of
from hil.lab.processes import in_process, processes
from hil.ship import scenarios
from hil.sim.goals import Goal
from hil.sim.signals import interruptible
from hil.sim.truth import Truth

AUTOPILOT, TWIN = "autopilot", "compiled twin"
FIXED_GAINS = {"CTL_MODE": 0.0, "EST_MODE": 0.0}


@dataclass(frozen=True, slots=True)
class Controller:
    """A controller: its name, the engine that simulates it, and its parameters."""

    name: str
    engine: str
    settings: tuple[tuple[str, float], ...] = ()


PAPER = Controller("S-surface, paper gains", AUTOPILOT, tuple(FIXED_GAINS.items()))
PID = Controller("PID, tuned", TWIN)
OURS = Controller("Rambler", TWIN)


def with_price(price: float) -> Controller:
    """Return our controller with another weight of rudder travel (CTL_PRICE)."""
    return Controller(f"Rambler, CTL_PRICE {price:g}", TWIN, (("CTL_PRICE", price),))


@dataclass(frozen=True, slots=True)
class Task:
    """The runs: seas such as "swell+float=0.3:0.6,leeway=8", seeds, goals and duration."""

    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    goals: tuple[Goal, ...]
    seconds: float


@dataclass(frozen=True, slots=True)
class Row:
    """A controller in a sea: the score of each seed."""

    scenario: str
    controller: Controller
    scores: tuple[Score, ...]

    @property
    def mean(self) -> Score:
        """Return the mean over all seeds."""
        return mean_of(self.scores)


def compare(task: Task, controllers: Sequence[Controller], report: Callable[[int, int, str], None]) -> list[Row]:
    """Simulate all runs and return a row for each sea and controller.

    `report` is called with the number of finished runs, the number of all runs, and the last run.
    """
    pairs = [(name, controller) for name in task.scenarios for controller in controllers]
    jobs = [(name, controller, seed) for name, controller in pairs for seed in task.seeds]
    scores_by_job: dict[tuple[str, str, int], Score] = {}
    report(0, len(jobs), "")
    for number, (job, score) in enumerate(_run_jobs(task, jobs)):
        scores_by_job[job] = score
        name, controller, seed = job
        report(number + 1, len(jobs), f"{controller}, {name}, seed {seed}")
    return [
        Row(name, controller, tuple(scores_by_job[name, controller.name, seed] for seed in task.seeds))
        for name, controller in pairs
    ]


def _run_jobs(task: Task, jobs: Sequence[tuple[str, Controller, int]]) -> Iterator[tuple[tuple[str, str, int], Score]]:
    # Each worker process starts its own autopilot.
    with interruptible(), processes(os.cpu_count() or 1) as pool:
        job_of_future = {pool.submit(_run_in_process, task, *job): job for job in jobs}
        for future in as_completed(job_of_future):
            name, controller, seed = job_of_future[future]
            yield (name, controller.name, seed), future.result()


def _run_in_process(task: Task, scenario_name: str, controller: Controller, seed: int) -> Score:
    return in_process(run_one, task, scenario_name, controller, seed)


def run_one(task: Task, scenario_name: str, controller: Controller, seed: int) -> Score:
    """Simulate a run and compute its score."""
    return score_of(truth_of(task, scenario_name, controller, seed))


def truth_of(task: Task, scenario_name: str, controller: Controller, seed: int) -> Truth:
    """Simulate a run and return its truth; the compiled loop gives the same commands as the autopilot process."""
    scenario = scenarios.parse_scenario(scenario_name)
    if controller.engine == TWIN:
        from hil.lab.compare import pid  # noqa: PLC0415 - compiles, which the other controllers do not need
        from hil.lab.numeric_core import LawSettings  # noqa: PLC0415 - likewise
        from hil.lab.twin import sailing  # noqa: PLC0415 - likewise
        from hil.lab.twin.sea import sea_of  # noqa: PLC0415 - likewise

        if controller == PID:
            return pid.sail(scenario, seed, task.goals, task.seconds, pid.TUNED)
        parameters = ParameterSet()
        for name, value in controller.settings:
            parameters = parameters.replaced(name, value)
        sea, goals = sea_of(scenario, seed, task.seconds), sailing.task_of(task.goals)
        boat, law = sailing.boat_of(parameters), LawSettings.of(parameters)
        record, _ = sailing.sail(boat, law, sea, goals, task.seconds, ticks=False)
        return sailing.truth_of(record, task.goals)
    from hil.sim.logbook import RunOptions  # noqa: PLC0415 - not needed by the compiled loop
    from hil.sim.runner import run  # noqa: PLC0415 - likewise

    with tempfile.TemporaryDirectory(prefix="rambler-compare-") as directory:
        options = RunOptions(
            scenario,
            task.seconds,
            Path(directory) / "run",
            seed=seed,
            goals=task.goals,
            settings=dict(controller.settings),
            live_display=False,  # the comparison shows its own progress
        )
        return run(options).truth.table()
