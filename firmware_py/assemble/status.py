"""Status reports after each tick: `rambler status`, and the trial of an update."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pymavlink
import serial

from firmware_py import __version__
from firmware_py.assemble.trial import TrialWatch, find_program_link
from firmware_py.common.link_status import LinkStatus
from firmware_py.common.records import DeviceRole
from firmware_py.common.reports import Output
from firmware_py.loop import LoopParts
from firmware_py.system.clock import machine_s
from firmware_py.system.console import Console
from firmware_py.system.realtime import LoadMeter
from firmware_py.system.state_directory import BOOT_COUNT
from firmware_py.system.status_file import StatusFile
from firmware_py.system.status_report import StatusReporter, StatusSources
from firmware_py.vehicle import Vehicle


def report_status(
    vehicle: Vehicle,
    state_directory: Path,
    parts: LoopParts,
    links: Callable[[float], Sequence[LinkStatus]],
    commit: str,
    console: Console,
    opened: ExitStack,
) -> None:
    """Write the status after each tick; `opened` removes it at the end."""
    trial = TrialWatch(find_program_link(sys.argv[0]), parts.store, parts.notices, console.print_early)
    about = {
        "vehicle": vehicle.name,
        "state_directory": os.path.realpath(state_directory),
        "pid": os.getpid(),
        "versions": _read_versions(commit),
    }
    sources = StatusSources(
        about=about,
        ports=_ports_by_role(vehicle),
        devices=lambda: parts.health.latest,
        links=links,
        faults=lambda: parts.autopilot.state.fault_latch,
        starts=lambda: int(parts.autopilot.state.parameters[BOOT_COUNT]),
        written=lambda: parts.store.written,
        load=LoadMeter(parts.clock).fraction,
        utc_s=parts.clock.utc_s,
        machine_s=machine_s,
        swing=lambda: parts.autopilot.compass_swing.report,
        update=lambda: trial.text,
    )
    reporter = StatusReporter(sources, StatusFile(state_directory), console.line)
    opened.callback(reporter.close)

    def after_tick(output: Output, now_s: float) -> None:
        trial.update(output, now_s)
        reporter.update(output, now_s)

    parts.after_tick = after_tick


def _read_versions(commit: str) -> dict[str, str]:
    return {
        "rambler": __version__,
        "git": commit,
        "python": ".".join(map(str, sys.version_info[:3])),
        "numpy": np.__version__,
        "pyserial": serial.__version__,
        "pymavlink": pymavlink.__version__,
        "kernel": os.uname().release,
        "machine": os.uname().machine,
    }


def _ports_by_role(vehicle: Vehicle) -> dict[DeviceRole, tuple[str, str]]:
    """Return driver and port of each device."""
    entries = {
        DeviceRole.COMPASS: vehicle.compass,
        DeviceRole.COMPASS_B: vehicle.compass_b,
        DeviceRole.POSITION: vehicle.position,
        DeviceRole.RUDDER: vehicle.rudder,
        DeviceRole.POWER: vehicle.power,
        DeviceRole.POWER_B: vehicle.power_b,
        DeviceRole.AIS: vehicle.ais,
        DeviceRole.WIND: vehicle.wind,
        DeviceRole.DEPTH: vehicle.depth,
        DeviceRole.RUDDER_ANGLE: vehicle.rudder_angle,
    }
    return {role: (entry.driver, entry.port) for role, entry in entries.items() if entry is not None}
