"""Simulate the runs of a campaign, with or without a fault, with the autopilot process in lockstep."""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from hil.errors import HilError
from hil.lab.campaign.row import Fault, Outcome, Row
from hil.lab.campaign.scores import scores_of
from hil.lab.campaign.spec import NO_FAULT, Spec
from hil.lab.drill.boat import DrillBoat
from hil.lab.drill.book import BOOK, Drill
from hil.lab.drill.injection import do_nothing
from hil.sim import run_file, runner
from hil.sim.ground_station import GUIDED
from hil.sim.logbook import recorded_run
from hil.sim.run_directory import FIRMWARE_LOG, STATE, TRUTH_FILE, VEHICLE_NAME
from hil.sim.run_file import FINISHED, OrderRecord
from hil.sim.truth import read
from hil.sim.vehicle_file import standard_vehicle
from hil.sim.world import START_UTC_S

BATCH = 1
MAX_REPEATS = 4
WARNING = 4  # MAV_SEVERITY_WARNING; more severe levels have smaller numbers
# The log has no effect on the run and is deleted with its directory.
NO_LOG = {"LOG_ENABLE": 0.0}
FAULT_CONFLICT = "cannot be combined with [fault]; remove one of them"
ABSOLUTE_PATH = re.compile(r"(?<![\w/])/[\w./-]+")

Message = tuple[float, int, str]  # time, severity and text


def refusals(spec: Spec) -> list[str]:
    """Return a line for each item of a specification that this engine does not support."""
    if "fault.what" not in spec.draws:
        return []
    lines = [f"with.{name}: {FAULT_CONFLICT}" for name in UNSUPPORTED_OPTIONS if name in spec.options]
    lines += [f"{name}: {FAULT_CONFLICT}" for name in ("compass", "servo") if name in spec.draws]
    return lines + ([f"vehicle: {FAULT_CONFLICT}"] if spec.vehicle != standard_vehicle() else [])


def make_ready(row: Row) -> None:
    """Do nothing: there is nothing to compile."""


def simulate(rows: Iterable[Row]) -> Iterator[Outcome]:
    """Simulate runs and yield their outcomes, in order."""
    yield from map(_confirmed_outcome, rows)


def _confirmed_outcome(row: Row) -> Outcome:
    """Simulate a run; accept a failure only if it repeats, because high CPU load can also end a run."""
    outcome = _simulate_without_log(row)
    for _ in range(MAX_REPEATS):
        if outcome.ended == FINISHED:
            return outcome
        previous, outcome = outcome, _simulate_without_log(row)
        if outcome == previous:
            return outcome
    raise HilError(f"run {row.index}: ends differently at each of {MAX_REPEATS + 1} attempts, last: {outcome.ended}")


def _simulate_without_log(row: Row) -> Outcome:
    with tempfile.TemporaryDirectory(prefix="rambler-campaign-") as directory:
        return simulate_into(row, Path(directory) / "run", with_logs=False)


def simulate_into(row: Row, out: Path, *, with_logs: bool) -> Outcome:
    """Simulate a run into a directory; `with_logs` adds log and live display and does not change the results."""
    try:
        texts, ended = _run(row, out, with_logs=with_logs), FINISHED
    except HilError as error:
        # Without this file the run did not start, so it has no outcome.
        if not (out / run_file.NAME).exists():
            raise
        texts, ended = (), ABSOLUTE_PATH.sub("...", str(error))
    content = (out / TRUTH_FILE).read_bytes()
    warnings = tuple(dict.fromkeys(text for _, severity, text in texts if severity <= WARNING))
    scores = None
    if ended == FINISHED:
        truth = read(out / TRUTH_FILE)
        scores = scores_of(truth.heading_low_rad, truth.rudder_rad, truth.goal_rad)
    return Outcome(hashlib.sha256(content).hexdigest(), scores, warnings, ended)


def _run(row: Row, out: Path, *, with_logs: bool) -> tuple[Message, ...]:
    if row.fault is not None:
        # The fault may concern the log, so the log is enabled.
        return run_with_fault(row, row.fault, out)
    options = row.options(out)
    if not with_logs:
        options = replace(options, settings={**NO_LOG, **options.settings}, live_display=False)
    return runner.run(options).texts


# Campaigns use GUIDED mode only; `rambler-hil drill` tests the faults of other modes.
FAULTS: Mapping[str, Drill] = {drill.name: drill for drill in BOOK if drill.mode == GUIDED}
# Options that the devices of DrillBoat do not support.
UNSUPPORTED_OPTIONS = ("receiver", "supply", "vessels")

NO_DRILL = Drill(NO_FAULT, "", "", do_nothing, do_nothing, 0.0, 0.0)


def run_with_fault(row: Row, fault: Fault, out: Path) -> tuple[Message, ...]:
    """Simulate a run with a fault into a directory and return its messages; raise HilError if it ends early."""
    options = row.options(out)
    drill = FAULTS.get(fault.name, NO_DRILL)
    options = replace(options, scenario=drill.sea(options.scenario))
    with tempfile.TemporaryDirectory(prefix="rambler-fault-") as name, recorded_run(options, START_UTC_S) as book:
        directory = Path(name)
        boat = DrillBoat(
            directory,
            options.scenario,
            seed=row.seed,
            settings={**(drill.settings or {}), **row.settings},
            fitted=drill.fitted,
            plans=() if drill.plan is None else (drill.plan(directory),),
            goals=row.goals,
            world=book.world,
        )
        try:
            with boat:
                _run_drill(boat, drill, fault, row.seconds)
        finally:
            book.orders, book.arrivals = tuple(map(OrderRecord.of, boat.station.orders)), tuple(boat.station.reached)
            _copy_results(directory, out)
    return tuple(boat.station.texts)


def _run_drill(boat: DrillBoat, drill: Drill, fault: Fault, seconds: float) -> None:
    boat.run(min(fault.at_s, seconds))
    drill.inject(boat)
    boat.run(max(0.0, min(fault.at_s + fault.for_s, seconds) - boat.now_s))
    drill.remove(boat)
    boat.run(max(0.0, seconds - boat.now_s))


def _copy_results(directory: Path, out: Path) -> None:
    """Copy state, vehicle file and logs of the autopilot into a run directory."""
    shutil.copytree(directory / STATE, out / STATE, ignore=shutil.ignore_patterns("lock"))
    shutil.copy(directory / VEHICLE_NAME, out / VEHICLE_NAME)
    logs = sorted(directory.glob("firmware*.log"))
    (out / FIRMWARE_LOG).write_bytes(b"".join(log.read_bytes() for log in logs))
