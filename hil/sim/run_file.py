"""run.json: the options of a run, from its start, and how it ended; summary and report are made from it."""

from __future__ import annotations

import datetime as dt
import json
import platform
from dataclasses import asdict, dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any

from firmware_py import ROOT, commit_of
from hil.errors import HilError, UsageError
from hil.sim.ground_station import Order

NAME = "run.json"
UNDER_WAY, FINISHED = "under way", "finished"
MAX_BYTES = 1 << 24
_PACKAGES = ("rambler-autopilot", "numpy", "pymavlink")


@dataclass(frozen=True, slots=True)
class OrderRecord:
    """A command of the operator and when it was accepted; `goal_s`: when a heading was due, None for other commands."""

    text: str
    goal_s: float | None
    given_s: float | None
    accepted_s: float | None

    @classmethod
    def of(cls, order: Order) -> OrderRecord:
        """Record an order of the operator."""
        return cls(order.text, None if order.goal is None else order.goal.t_s, order.first_sent_s, order.accepted_s)


@dataclass(frozen=True, slots=True)
class RunFile:
    """The data of a run beside its truth and its logs; `ending` is FINISHED, or says what ended it early.

    `sea` is a table for people; `arrivals` are the time and number of each mission item reached. `wall_s`, `supply`
    and `vessels` are None if the run could not record them. Time 0 is at `start_utc_s` by the receiver.
    """

    command: tuple[str, ...]
    begun: str
    title: str
    scenario: str
    extras: str
    sea: tuple[tuple[str, str], ...]
    seed: int
    seconds: float
    compass: str
    servo: str
    settings: dict[str, float]
    lockstep: bool
    start_utc_s: float
    versions: dict[str, str]
    ending: str = UNDER_WAY
    orders: tuple[OrderRecord, ...] = ()
    arrivals: tuple[tuple[float, int], ...] = ()
    wall_s: float | None = None
    supply: dict[str, float] | None = None
    vessels: list[dict[str, float | str]] | None = None

    def write(self, out: Path) -> None:
        """Write the file atomically, or raise HilError."""
        fresh = out / f"{NAME}.new"
        try:
            fresh.write_text(json.dumps(asdict(self), indent=2) + "\n", encoding="utf-8")
            fresh.replace(out / NAME)
        except OSError as error:
            raise HilError(f"{out / NAME} cannot be written: {error.strerror}") from None


def read(out: Path) -> RunFile:
    """Read the record of a run; UsageError when there is none of this version."""
    try:
        with (out / NAME).open("rb") as file:
            content = json.loads(file.read(MAX_BYTES))
        known = {one.name for one in fields(RunFile)}
        values: dict[str, Any] = {name: value for name, value in content.items() if name in known}
        values["command"] = tuple(map(str, content["command"]))
        values["orders"] = tuple(OrderRecord(**order) for order in content["orders"])
        values["arrivals"] = tuple((float(t_s), int(item)) for t_s, item in content.get("arrivals", ()))
        values["sea"] = tuple((str(name), str(value)) for name, value in content["sea"])
        return RunFile(**values)
    except OSError as error:
        raise UsageError(f"{out / NAME}: {error.strerror}; name the directory of a run") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise UsageError(f"{out / NAME} is not a run of this version; repeat the run") from None


def now_text() -> str:
    """Return the date and time of day, UTC."""
    return dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def versions() -> dict[str, str]:
    """Return the versions that a run depends on."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found | ({"git": commit} if (commit := commit_of(ROOT)) else {})
