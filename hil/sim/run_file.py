"""run.json: options, orders and ending of a run. Summary and report are made from it."""

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
MAX_BYTES = 1 << 24  # a longer file is rejected
_PACKAGES = ("rambler-autopilot", "numpy", "pymavlink")


@dataclass(frozen=True, slots=True)
class OrderRecord:
    """An order of the simulated ground station: planned time of its goal, times of first sending and acceptance.

    None: no goal, not sent, not accepted.
    """

    text: str
    goal_s: float | None
    given_s: float | None
    accepted_s: float | None

    @classmethod
    def of(cls, order: Order) -> OrderRecord:
        """Return the record of an order of the simulated ground station."""
        return cls(order.text, None if order.goal is None else order.goal.t_s, order.first_sent_s, order.accepted_s)


@dataclass(frozen=True, slots=True)
class RunFile:
    """The data of a run except truth and logs.

    `ending`: UNDER_WAY, FINISHED or the reason for an early end. `extras`: the disturbance options. `sea`: labels and
    values of the scenario. `compass`, `servo`: drivers. `settings`: parameters. `arrivals`: time and number
    of each mission item reached. `start_utc_s`: UTC of the simulated receiver at time 0. `wall_s`, `supply` and
    `vessels` are None if they were not recorded.
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
        temporary = out / f"{NAME}.new"
        try:
            temporary.write_text(json.dumps(asdict(self), indent=2) + "\n", encoding="utf-8")
            temporary.replace(out / NAME)
        except OSError as error:
            raise HilError(f"{out / NAME} cannot be written: {error.strerror}") from None


def read(out: Path) -> RunFile:
    """Read run.json; raise UsageError if it is missing, damaged or of another version."""
    try:
        with (out / NAME).open("rb") as file:
            content = json.loads(file.read(MAX_BYTES))
        names = {field.name for field in fields(RunFile)}
        values: dict[str, Any] = {name: value for name, value in content.items() if name in names}
        values["command"] = tuple(map(str, content["command"]))
        values["orders"] = tuple(OrderRecord(**order) for order in content["orders"])
        values["arrivals"] = tuple((float(t_s), int(item)) for t_s, item in content.get("arrivals", ()))
        values["sea"] = tuple((str(name), str(value)) for name, value in content["sea"])
        return RunFile(**values)
    except OSError as error:
        raise UsageError(f"{out / NAME}: {error.strerror}; name the directory of a run") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise UsageError(f"{out / NAME} is damaged or of another version; repeat the run") from None


def now_text() -> str:
    """Return the present date and time in UTC."""
    return dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the main packages, and the git commit."""
    version_texts = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            version_texts[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return version_texts | ({"git": commit} if (commit := commit_of(ROOT)) else {})
