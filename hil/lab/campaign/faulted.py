"""Runs in which something breaks and is mended: a row of the drill book, at a drawn time and for a drawn while."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from hil.lab.campaign.row import Fault, Row
from hil.lab.campaign.spec import NO_FAULT
from hil.lab.drill.boat import DrillBoat
from hil.lab.drill.book import BOOK, Drill
from hil.lab.drill.provoke import nothing
from hil.sim.ground_station import GUIDED
from hil.sim.logbook import put_to_sea
from hil.sim.run_directory import FIRMWARE_LOG, STATE, VEHICLE_NAME
from hil.sim.run_file import OrderRecord
from hil.sim.world import START_UTC_S

# A campaign steers headings: what breaks in other modes is for `rambler-hil drill`.
FAULTS: Mapping[str, Drill] = {drill.name: drill for drill in BOOK if drill.mode == GUIDED}
# What the emulators of a drill's boat do not know.
UNKNOWN_OPTIONS = ("receiver", "supply", "vessels")

UNBROKEN = Drill(NO_FAULT, "", "", nothing, nothing, 0.0, 0.0)

Text = tuple[float, int, str]


def sail(row: Row, fault: Fault, out: Path) -> tuple[Text, ...]:
    """Sail a run into a directory and return what she said; HilError when she does not get to its end."""
    options = row.options(out)
    drill = FAULTS.get(fault.name, UNBROKEN)
    options = replace(options, scenario=drill.sea(options.scenario))
    with tempfile.TemporaryDirectory(prefix="rambler-fault-") as name, put_to_sea(options, START_UTC_S) as book:
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
                _sail(boat, drill, fault, row.seconds)
        finally:
            book.orders, book.arrivals = tuple(map(OrderRecord.of, boat.station.orders)), tuple(boat.station.reached)
            _keep(directory, out)
    return tuple(boat.station.texts)


def _sail(boat: DrillBoat, drill: Drill, fault: Fault, seconds: float) -> None:
    boat.run(min(fault.at_s, seconds))
    drill.broken(boat)
    boat.run(max(0.0, min(fault.at_s + fault.for_s, seconds) - boat.now_s))
    drill.mended(boat)
    boat.run(max(0.0, seconds - boat.now_s))


def _keep(directory: Path, out: Path) -> None:
    """Put what the autopilot has left where a run has it."""
    shutil.copytree(directory / STATE, out / STATE, ignore=shutil.ignore_patterns("lock"))
    shutil.copy(directory / VEHICLE_NAME, out / VEHICLE_NAME)
    logs = sorted(directory.glob("firmware*.log"))
    (out / FIRMWARE_LOG).write_bytes(b"".join(log.read_bytes() for log in logs))
