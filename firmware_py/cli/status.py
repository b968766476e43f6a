"""`rambler status`: what the autopilot that runs on this computer says of itself; reads a file and touches nothing."""

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

from firmware_py.cli.refusal import refused
from firmware_py.common.calendar import is_possible
from firmware_py.system.clock import machine_s
from firmware_py.system.endings import ENDINGS_FILE, from_bytes
from firmware_py.system.readings import device_line, values_line
from firmware_py.system.slots import examine
from firmware_py.system.status_file import FoundStatus, Freshness, find, find_all

# What has lines of its own; any other section of a status is a line of names and values.
_TOLD = ("status", "reason", "age_s", "user", "vehicle", "state_directory", "written_machine_s")
_INDENT = "  "
_LAST_ENDINGS = 3  # the JSON has them all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="its state directory; not needed where only one autopilot runs"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when it runs and says so now, 1 when what there is is old or nothing is there, 2 when DIR is needed."""
    directory = arguments.state
    if directory is not None:
        found = find(directory, machine_s())
        # A boat whose disk has gone under way has much to say.
        if found.freshness is Freshness.ABSENT and not os.path.isdir(directory):  # noqa: PTH112 - never raises
            return refused("status", f"{directory} is no directory; name that of `rambler run --state`")
    else:
        all_found = find_all(machine_s())
        running = {name: one for name, one in all_found.items() if one.freshness is Freshness.RUNNING} or all_found
        if len(running) > 1:
            places = ", ".join(sorted(str(one.content.get("state_directory", one.reason)) for one in running.values()))
            return refused("status", f"there are several, name one with --state: {places}")
        found = next(iter(running.values()), FoundStatus(Freshness.ABSENT, reason="no autopilot says anything here"))
        if "state_directory" in found.content:
            directory = Path(found.content["state_directory"])
    told = _whole(found, directory)
    if arguments.json:
        print(json.dumps(told))
    else:
        try:
            print("\n".join(_lines(told)))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):  # of another version than this program
            print(f"{told['status']}, and not in the words of this version; --json shows all of it")
    return 0 if found.freshness is Freshness.RUNNING else 1


def _whole(found: FoundStatus, directory: Path | None) -> dict[str, Any]:
    """Return what was found, with what can be seen from outside: how old it is, and the disk."""
    told: dict[str, Any] = {
        "status": found.freshness.value,
        "reason": found.reason,
        "age_s": None if found.age_s is None else round(found.age_s, 1),
        **found.content,
    }
    if directory is not None:
        told |= {"state_directory": os.path.realpath(directory), "disk": _disk(directory)}
        told["endings"] = _endings(directory)
    return told


def _endings(directory: Path) -> dict[str, Any]:
    """Return how the runs before have ended, as far as the state directory tells: it can be read when nothing runs."""
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
    # Without the part that the file system keeps for root.
    return {"free_mb": round(usage.free / 1e6, 1), "total_mb": round(usage.total / 1e6, 1)}


def _lines(told: Mapping[str, Any]) -> Iterator[str]:
    age = "" if told["age_s"] is None else f", said {told['age_s']:g} s ago"
    reason = f": {told['reason']}" if told["reason"] else ""
    who = f" by user {told['user']}" if "user" in told else ""
    what = f"{told.get('vehicle', 'autopilot')} in {told.get('state_directory', '?')}"
    yield f"{what}: {told['status']}{age}{who}{reason}"
    yield from _block("endings", list(_ending_lines(told.get("endings", {}))))
    if "mode" not in told:
        return
    faults = [
        f"{row['severity']} {row['fault']} for {_duration(row['since_s'])}: {row['text']}" for row in told["faults"]
    ]
    yield from _block("faults", faults or ["none"])
    yield from _block("devices", [device_line(row) for row in told["devices"]])
    yield from _block("links", [line for row in told["links"] for line in _link_lines(row)] or ["none"])
    single = {name: value for name, value in told.items() if not isinstance(value, (dict, list)) and name not in _TOLD}
    yield from _block("now", [values_line({name: value for name, value in single.items() if value != ""})])
    for name, value in told.items():
        if isinstance(value, dict) and value and name != "endings":
            rows = value.get("nearest", []) if name == "traffic" else []
            plain = {key: item for key, item in value.items() if key != "nearest"}
            yield from _block(name, [values_line(plain), *(f"{_INDENT}{values_line(row)}" for row in rows)])


def _ending_lines(endings: Mapping[str, Any]) -> Iterator[str]:
    """Tell how often the runs before have ended why, and when the last ones did."""
    if "error" in endings:
        yield endings["error"]
    if endings.get("counts"):
        yield ", ".join(f"{why} {count}" for why, count in endings["counts"].items())
    for ending in reversed(endings.get("last", [])[-_LAST_ENDINGS:]):
        known = is_possible(ending["utc_s"])  # by a clock that was right
        when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(ending["utc_s"])) if known else "at an unknown time"
        yield f"{_INDENT}{when}  {ending['why']}{ending['text'] and ', '}{ending['text']}"


def _link_lines(link: Mapping[str, Any]) -> Iterator[str]:
    blocked = f"  nothing leaves: {link['hindrance']}" if link.get("hindrance") else ""
    yield f"{link['url']}  {link['rates']}" + ("" if link["peers"] else "  nobody") + blocked
    if (satellite := link.get("satellite")) is not None:
        yield from _satellite_lines(satellite)
    for peer in link["peers"]:
        who = "station" if peer["ground_station"] else "correspondent"
        heard = "never heard" if peer["heard_age_s"] is None else f"heard {peer['heard_age_s']:g} s ago"
        more = "" if peer["has_place"] else "  waits for a place"
        counts = f"{peer['sent_bytes']} bytes sent, {peer['dropped']} messages dropped, {peer['rejected']} bad frames"
        yield f"{_INDENT}{who} {peer['address']}  {heard}  {counts}{'  signs' if peer['signs'] else ''}{more}"


def _satellite_lines(satellite: Mapping[str, Any]) -> Iterator[str]:
    """Tell of a modem, its sessions, and what they have cost."""
    age = "none yet" if satellite["session_age_s"] is None else f"last {_duration(satellite['session_age_s'])} ago"
    blocked = f", {satellite['hindrance']}" if satellite["hindrance"] else ""
    signal = "unknown" if satellite["signal"] is None else f"{satellite['signal']} of 5"
    yield f"{_INDENT}modem {satellite['imei'] or 'not found'}  signal {signal}  {satellite['waiting']} frames wait"
    yield (
        f"{_INDENT}{satellite['sessions']} sessions, {satellite['failed']} failed, {age}{blocked}; "
        f"{satellite['sent']} messages of {satellite['sent_bytes']} bytes sent, {satellite['received']} received, "
        f"{satellite['dropped']} dropped"
    )
    of = {name: f" of {satellite[f'{name}_limit']}" if satellite[f"{name}_limit"] else "" for name in ("day", "month")}
    yield (
        f"{_INDENT}credits {satellite['day_credits']}{of['day']} today, {satellite['month_credits']}{of['month']} "
        f"this month"
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
