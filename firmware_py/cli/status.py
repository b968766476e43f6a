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
from firmware_py.system.readings import device_line, values_line
from firmware_py.system.slots import examine
from firmware_py.system.status_file import FoundStatus, Freshness, find, find_all

# Printed in the first line; the other sections are lines of names and values.
_HEADING = ("status", "reason", "age_s", "user", "vehicle", "state_directory", "written_machine_s")
_INDENT = "  "
_LAST_ENDINGS = 3  # the JSON output has all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="state directory; not needed if only one autopilot runs"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Return 0 for a running autopilot, 1 for an old status or none, 2 if --state is missing or wrong."""
    directory = arguments.state
    if directory is not None:
        found = find(directory, machine_s())
        # An autopilot that has lost its disk still has a status.
        if found.freshness is Freshness.ABSENT and not os.path.isdir(directory):  # noqa: PTH112 - never raises
            return print_error("status", f"{directory} is not a directory; give that of `rambler run --state`")
    else:
        all_found = find_all(machine_s())
        running = {name: one for name, one in all_found.items() if one.freshness is Freshness.RUNNING} or all_found
        if len(running) > 1:
            places = ", ".join(sorted(str(one.content.get("state_directory", one.reason)) for one in running.values()))
            return print_error("status", f"several autopilots run here; choose one with --state: {places}")
        found = next(iter(running.values()), FoundStatus(Freshness.ABSENT, reason="no autopilot runs here"))
        if "state_directory" in found.content:
            directory = Path(found.content["state_directory"])
    status = _whole(found, directory)
    if arguments.json:
        print(json.dumps(status))
    else:
        try:
            print("\n".join(_lines(status)))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):  # of another version than this program
            print(f"{status['status']}; status of another version, use --json")
    return 0 if found.freshness is Freshness.RUNNING else 1


def _whole(found: FoundStatus, directory: Path | None) -> dict[str, Any]:
    """Return the status with its age, the endings of earlier runs and the disk space."""
    status: dict[str, Any] = {
        "status": found.freshness.value,
        "reason": found.reason,
        "age_s": None if found.age_s is None else round(found.age_s, 1),
        **found.content,
    }
    if directory is not None:
        status |= {"state_directory": os.path.realpath(directory), "disk": _disk(directory)}
        status["endings"] = _endings(directory)
    return status


def _endings(directory: Path) -> dict[str, Any]:
    """Return the endings of earlier runs, stored in the state directory."""
    stored = examine(directory, ENDINGS_FILE)
    if stored.content is None:
        return {"error": stored.damage} if stored.damage else {}
    try:
        endings, _ = from_bytes(stored.content)
    except ValueError as error:
        return {"error": f"{ENDINGS_FILE}: {error}"}
    return {"counts": dict(endings.counts), "last": [asdict(ending) for ending in endings.last]}


def _disk(directory: Path) -> dict[str, Any]:
    try:
        usage = shutil.disk_usage(directory)
    except OSError as error:
        return {"error": error.strerror}
    # Without the space reserved for root.
    return {"free_mb": round(usage.free / 1e6, 1), "total_mb": round(usage.total / 1e6, 1)}


def _lines(status: Mapping[str, Any]) -> Iterator[str]:
    age = "" if status["age_s"] is None else f", updated {status['age_s']:g} s ago"
    reason = f": {status['reason']}" if status["reason"] else ""
    user = f" by user {status['user']}" if "user" in status else ""
    name = f"{status.get('vehicle', 'autopilot')} in {status.get('state_directory', '?')}"
    yield f"{name}: {status['status']}{age}{user}{reason}"
    yield from _block("endings", list(_ending_lines(status.get("endings", {}))))
    if "mode" not in status:
        return
    faults = [
        f"{row['severity']} {row['fault']} for {_duration(row['since_s'])}: {row['text']}" for row in status["faults"]
    ]
    yield from _block("faults", faults or ["none"])
    yield from _block("devices", [device_line(row) for row in status["devices"]])
    yield from _block("links", [line for row in status["links"] for line in _link_lines(row)] or ["none"])
    single = {
        name: value for name, value in status.items() if not isinstance(value, (dict, list)) and name not in _HEADING
    }
    yield from _block("now", [values_line({name: value for name, value in single.items() if value != ""})])
    for name, value in status.items():
        if isinstance(value, dict) and value and name != "endings":
            rows = value.get("nearest", []) if name == "traffic" else []
            plain = {key: item for key, item in value.items() if key != "nearest"}
            yield from _block(name, [values_line(plain), *(f"{_INDENT}{values_line(row)}" for row in rows)])


def _ending_lines(endings: Mapping[str, Any]) -> Iterator[str]:
    """Yield the counts of endings by reason, and the last ones with their time."""
    if "error" in endings:
        yield endings["error"]
    if endings.get("counts"):
        yield ", ".join(f"{why} {count}" for why, count in endings["counts"].items())
    for ending in reversed(endings.get("last", [])[-_LAST_ENDINGS:]):
        known = is_possible(ending["utc_s"])
        when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(ending["utc_s"])) if known else "at an unknown time"
        yield f"{_INDENT}{when}  {ending['why']}{ending['text'] and ', '}{ending['text']}"


def _link_lines(link: Mapping[str, Any]) -> Iterator[str]:
    blocked = f"  sending blocked: {link['blocked_reason']}" if link.get("hindrance") else ""
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
    age = "none yet" if satellite["session_age_s"] is None else f"last {_duration(satellite['session_age_s'])} ago"
    blocked = f", blocked: {satellite['blocked_reason']}" if satellite["hindrance"] else ""
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


def _block(name: str, lines: list[str]) -> Iterator[str]:
    for number, line in enumerate(lines):
        yield f"{'' if number else name:<13} {line}"


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "?"
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
