"""`rambler status`: state of the autopilot on this computer, read from its status file."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import asdict

from firmware_py.cli.errors import print_error
from firmware_py.common.calendar import is_possible
from firmware_py.system.clock import machine_s
from firmware_py.system.endings import ENDINGS_FILE, from_bytes
from firmware_py.system.readings import format_device, format_values
from firmware_py.system.slots import examine
from firmware_py.system.status_file import Freshness, StatusReading, find_all_statuses, find_status

# Keys of the first line. The other keys are printed as names and values.
_FIRST_LINE_KEYS = ("status", "reason", "age_s", "user", "vehicle", "state_directory", "written_machine_s")
_INDENT = "  "
_MAX_PRINTED_ENDINGS = 3  # the JSON output contains all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="state directory; not needed if only one autopilot runs"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Return 0 if an autopilot runs, 1 for an old status or none, 2 if --state is missing or wrong."""
    directory = arguments.state
    if directory is not None:
        file_status = find_status(directory, machine_s())
        # The status is elsewhere: it exists even if the autopilot has lost the disk of its state directory.
        if file_status.freshness is Freshness.ABSENT and not os.path.isdir(directory):  # noqa: PTH112 - never raises
            return print_error("status", f"{directory} is not a directory; give that of `rambler run --state`")
    else:
        statuses = list(find_all_statuses(machine_s()).values())
        candidates = [entry for entry in statuses if entry.freshness is Freshness.RUNNING] or statuses
        if len(candidates) > 1:
            directories = ", ".join(sorted(str(row.content.get("state_directory", row.reason)) for row in candidates))
            return print_error("status", f"several autopilots run here; choose one with --state: {directories}")
        file_status = next(iter(candidates), StatusReading(Freshness.ABSENT, reason="no autopilot runs here"))
        if "state_directory" in file_status.content:
            directory = Path(file_status.content["state_directory"])
    status = _complete_status(file_status, directory)
    if arguments.json:
        print(json.dumps(status))
    else:
        try:
            print("\n".join(_status_lines(status)))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):  # the status of another version
            print(f"{status['status']}; status of another version, use --json")
    return 0 if file_status.freshness is Freshness.RUNNING else 1


def _complete_status(file_status: StatusReading, directory: Path | None) -> dict[str, Any]:
    """Add the age of the status, the endings of earlier runs and the disk space."""
    status: dict[str, Any] = {
        "status": file_status.freshness.value,
        "reason": file_status.reason,
        "age_s": None if file_status.age_s is None else round(file_status.age_s, 1),
        **file_status.content,
    }
    if directory is not None:
        status |= {"state_directory": os.path.realpath(directory), "disk": _disk_space(directory)}
        status["endings"] = _read_endings(directory)
    return status


def _read_endings(directory: Path) -> dict[str, Any]:
    """Read the endings of earlier runs from the state directory."""
    stored = examine(directory, ENDINGS_FILE)
    if stored.content is None:
        return {"error": stored.damage} if stored.damage else {}
    try:
        endings, _ = from_bytes(stored.content)
    except ValueError as error:
        return {"error": f"{ENDINGS_FILE}: {error}"}
    return {"counts": dict(endings.counts), "last": [asdict(ending) for ending in endings.last]}


def _disk_space(directory: Path) -> dict[str, Any]:
    try:
        usage = shutil.disk_usage(directory)
    except OSError as error:
        return {"error": error.strerror}
    # usage.free excludes the space reserved for root.
    return {"free_mb": round(usage.free / 1e6, 1), "total_mb": round(usage.total / 1e6, 1)}


def _status_lines(status: Mapping[str, Any]) -> Iterator[str]:
    age = "" if status["age_s"] is None else f", updated {status['age_s']:g} s ago"
    reason = f": {status['reason']}" if status["reason"] else ""
    user = f" by user {status['user']}" if "user" in status else ""
    name = f"{status.get('vehicle', 'autopilot')} in {status.get('state_directory', '?')}"
    yield f"{name}: {status['status']}{age}{user}{reason}"
    yield from _label_lines("endings", list(_ending_lines(status.get("endings", {}))))
    if "mode" not in status:
        return
    faults = [
        f"{row['severity']} {row['fault']} for {_format_duration(row['since_s'])}: {row['text']}"
        for row in status["faults"]
    ]
    yield from _label_lines("faults", faults or ["none"])
    yield from _label_lines("devices", [format_device(row) for row in status["devices"]])
    yield from _label_lines("links", [line for row in status["links"] for line in _link_lines(row)] or ["none"])
    scalars = {
        name: value
        for name, value in status.items()
        if not isinstance(value, (dict, list)) and name not in _FIRST_LINE_KEYS
    }
    yield from _label_lines("now", [format_values({name: value for name, value in scalars.items() if value != ""})])
    for name, value in status.items():
        if isinstance(value, dict) and value and name != "endings":
            nearest = value.get("nearest", []) if name == "traffic" else []
            values = {key: item for key, item in value.items() if key != "nearest"}
            yield from _label_lines(
                name, [format_values(values), *(f"{_INDENT}{format_values(row)}" for row in nearest)]
            )


def _ending_lines(endings: Mapping[str, Any]) -> Iterator[str]:
    """Yield the counts of endings by reason, and the last ones with their time."""
    if "error" in endings:
        yield endings["error"]
    if endings.get("counts"):
        yield ", ".join(f"{why} {count}" for why, count in endings["counts"].items())
    for ending in reversed(endings.get("last", [])[-_MAX_PRINTED_ENDINGS:]):
        has_time = is_possible(ending["utc_s"])
        utc = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(ending["utc_s"])) if has_time else ""
        time_text = utc or "at an unknown time"
        yield f"{_INDENT}{time_text}  {ending['why']}{ending['text'] and ', '}{ending['text']}"


def _link_lines(link: Mapping[str, Any]) -> Iterator[str]:
    blocked = f"  sending blocked: {link['hindrance']}" if link.get("hindrance") else ""
    yield f"{link['url']}  {link['rates']}" + ("" if link["peers"] else "  no peers") + blocked
    if (satellite := link.get("satellite")) is not None:
        yield from _satellite_lines(satellite)
    for peer in link["peers"]:
        kind = "station" if peer["ground_station"] else "peer"
        age = "nothing received" if peer["heard_age_s"] is None else f"last frame {peer['heard_age_s']:g} s ago"
        pending = "" if peer["has_place"] else "  pending: link full"
        counts = f"{peer['sent_bytes']} bytes sent, {peer['dropped']} messages dropped, {peer['rejected']} bad frames"
        yield f"{_INDENT}{kind} {peer['address']}  {age}  {counts}{'  signed' if peer['signs'] else ''}{pending}"


def _satellite_lines(satellite: Mapping[str, Any]) -> Iterator[str]:
    """Yield the state of a satellite modem, its sessions and their cost."""
    age_s = satellite["session_age_s"]
    age = "none yet" if age_s is None else f"last {_format_duration(age_s)} ago"
    blocked = f", blocked: {satellite['hindrance']}" if satellite["hindrance"] else ""
    signal = "unknown" if satellite["signal"] is None else f"{satellite['signal']} of 5"
    yield f"{_INDENT}modem {satellite['imei'] or 'not found'}  signal {signal}  {satellite['waiting']} frames queued"
    yield (
        f"{_INDENT}{satellite['sessions']} sessions, {satellite['failed']} failed, {age}{blocked}; "
        f"{satellite['sent']} messages of {satellite['sent_bytes']} bytes sent, {satellite['received']} received, "
        f"{satellite['dropped']} dropped"
    )
    limits = {
        name: f" of {satellite[f'{name}_limit']}" if satellite[f"{name}_limit"] else "" for name in ("day", "month")
    }
    yield (
        f"{_INDENT}credits {satellite['day_credits']}{limits['day']} today, "
        f"{satellite['month_credits']}{limits['month']} this month"
    )
    if satellite["refused"]:
        yield _INDENT + "refused " + ", ".join(f"{count} {reason}" for reason, count in satellite["refused"].items())


def _label_lines(name: str, lines: list[str]) -> Iterator[str]:
    for number, line in enumerate(lines):
        yield f"{'' if number else name:<13} {line}"


def _format_duration(seconds: float | None) -> str:
    if seconds is None:
        return "?"
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
