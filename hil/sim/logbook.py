"""A recorded run: its options, its world, and the run file with its results."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from firmware_py.vehicle import Vehicle
from hil.errors import HilError, UsageError
from hil.ship import disturbance_options
from hil.ship.scenarios import Scenario, description_rows
from hil.sim import run_file
from hil.sim.goals import Goal
from hil.sim.ground_station import GUIDED
from hil.sim.run_directory import TRUTH_FILE, prepare_directory, remove_earlier, restore_earlier
from hil.sim.run_file import FINISHED, OrderRecord, RunFile
from hil.sim.truth import TruthFile
from hil.sim.vehicle_file import model_of, mounting_of, standard_vehicle
from hil.sim.world import World, extra_columns


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of a run; `speed` is None in real time, infinity for as fast as possible."""

    scenario: Scenario
    seconds: float
    out: Path
    speed: float | None = math.inf
    seed: int = 1
    goals: tuple[Goal, ...] = ()
    vehicle: Vehicle = field(default_factory=standard_vehicle)
    settings: dict[str, float] = field(default_factory=dict)  # parameters that replace those of the vehicle
    links: tuple[str, ...] = ()  # URLs, in addition to that of the simulated ground station
    mode: int = GUIDED
    state: Path | None = None  # state directory of earlier runs, which is copied
    view: str | None = None  # HOST:PORT of the live page
    live_display: bool = True  # live display on a terminal
    cores: int = 1  # maximum in lockstep: 2 for an interactive run, one core for each program
    play: bool = False  # the operator ends the run, and no command of the operator is a failure

    @property
    def lockstep(self) -> bool:
        """True if the harness is the clock of the autopilot."""
        return self.speed is not None


@dataclass(slots=True)
class Logbook:
    """A run in progress and its results, which are recorded at its end; `wall_s` is its duration without the start.

    `begin` is called when all ports are open and the autopilot runs; it deletes the earlier run.
    """

    begin: Callable[[], None]
    world: World
    truth: TruthFile
    wall_s: float | None = None
    orders: tuple[OrderRecord, ...] = ()
    arrivals: tuple[tuple[float, int], ...] = ()
    supply: dict[str, float] | None = None
    vessels: list[dict[str, float | str]] | None = None


@contextmanager
def recorded_run(options: RunOptions, start_utc_s: float) -> Iterator[Logbook]:
    """Prepare the directory and the world of a run, and record how it ended; raise HilError if that fails.

    A run that fails before it has begun leaves an earlier run in the directory unchanged.
    """
    prepare_directory(options.out, options.state)
    try:
        with _record_run(options, start_utc_s) as book:
            yield book
        book.begin()
    finally:
        restore_earlier(options.out)


@contextmanager
def _record_run(options: RunOptions, start_utc_s: float) -> Iterator[Logbook]:
    run_record = _make_run_file(options, start_utc_s)
    run_record.write(options.out)
    truth = TruthFile(options.out / TRUTH_FILE, extra_columns(options.scenario))
    ending, start_s = FINISHED, time.monotonic()
    book: Logbook | None = None
    try:
        book = Logbook(partial(remove_earlier, options.out), _make_world(options, truth, start_utc_s), truth)
        yield book
    except BaseException as error:
        ending = _describe_ending(error, truth.end_s)
        raise
    finally:
        truth.close()
        replace(
            run_record,
            ending=ending,
            seconds=truth.end_s if options.play else options.seconds,
            wall_s=(book.wall_s if book else None) or time.monotonic() - start_s,
            orders=book.orders if book else (),
            arrivals=book.arrivals if book else (),
            supply=book.supply if book else None,
            vessels=book.vessels if book else None,
        ).write(options.out)


def _make_world(options: RunOptions, truth: TruthFile, start_utc_s: float) -> World:
    try:
        return World(
            options.scenario,
            options.seed,
            options.goals,
            end_s=options.seconds,
            model=model_of(options.vehicle),
            mounting=mounting_of(options.vehicle),
            truth=truth,
            start_utc_s=start_utc_s,
        )
    except ValueError as error:
        raise UsageError(f"vehicle file: invalid ship model: {error}") from None


def _make_run_file(options: RunOptions, start_utc_s: float) -> RunFile:
    scenario, vehicle = options.scenario, options.vehicle
    names = disturbance_options.names_of(scenario.disturbances)
    return RunFile(
        command=("rambler-hil", *sys.argv[1:]),
        begun=run_file.now_text(),
        title=f"{scenario.name}: {scenario.text}" + (f"; {', '.join(names)}" if names else ""),
        scenario=scenario.name,
        extras=disturbance_options.text_of(scenario.disturbances),
        sea=tuple(description_rows(scenario)),
        seed=options.seed,
        seconds=options.seconds,
        compass=" with ".join(entry.driver for entry in (vehicle.compass, vehicle.compass_b) if entry is not None),
        servo=vehicle.rudder.driver,
        settings={**vehicle.parameters, **options.settings},
        lockstep=options.lockstep,
        start_utc_s=start_utc_s,
        versions=run_file.versions(),
    )


def _describe_ending(error: BaseException, end_s: float) -> str:
    if isinstance(error, KeyboardInterrupt):
        return f"interrupted after {end_s:.0f} s"
    return str(error) if isinstance(error, HilError) else f"{type(error).__name__}: {error}"
