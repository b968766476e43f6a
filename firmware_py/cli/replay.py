"""`rambler replay`: recompute a log with the step function of the autopilot."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from firmware_py import ROOT, commit_of, version_text
from firmware_py.cli.errors import print_error
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.log.dataflash import LogError
from firmware_py.log.replay import ReplayReport, replay_log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("log", metavar="LOG", type=Path, help="onboard log (.BIN or .BIN.gz)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Return 0 if every rudder command is bit-identical, 1 if not, 2 for a log that cannot be replayed."""
    try:
        report = replay_log(arguments.log, state_from_text, step)
    except LogError as error:
        return _print_error(str(error))
    except Exception as error:  # noqa: BLE001 - one line, whatever the file contains
        return _print_error(f"{arguments.log}: cannot be read ({type(error).__name__}: {error})")
    print(json.dumps(report.as_dict()) if arguments.json else _format_report(report))
    return 0 if report.identical else 1


def _print_error(reason: str) -> int:
    """Print a reason, which may contain line breaks, as one line."""
    return print_error("replay", " ".join(reason.split()))


def _format_report(report: ReplayReport) -> str:
    reading = report.reading
    lines = [f"{report.ticks} ticks, {report.compared} recomputed"]
    if report.gaps:
        lines.append(f"{report.gaps} gaps: dropped or damaged ticks")
    if reading.damaged or reading.garbage_bytes:
        lines.append(f"{reading.damaged} damaged ticks, {reading.garbage_bytes} unreadable bytes")
    if reading.tail_bytes:
        lines.append(f"the last tick is incomplete: {reading.tail_bytes} bytes ignored")
    lines += [f"note: {note}" for note in reading.notes]
    if (difference := report.first_difference) is not None:
        lines.append(
            f"{report.differences} commands differ, by up to {report.largest_rad:.2g} rad; the first at tick "
            f"{difference.tick} ({difference.t_s:.3f} s): logged {difference.logged.shaft_rad!r} rad, "
            f"recomputed {difference.recomputed.shaft_rad!r} rad"
        )
        lines += _version_note(reading.software)
    lines.append("every rudder command is bit-identical" if report.identical else "NOT identical")
    return "\n".join(lines)


def _version_note(software: str) -> list[str]:
    """Return a note if another version wrote the log, since a difference is then expected."""
    own = version_text("rambler", commit_of(ROOT))
    if software == own:
        return []
    return [f"log written by {software or 'an unknown program'}, recomputed by {own}: a difference is expected"]
