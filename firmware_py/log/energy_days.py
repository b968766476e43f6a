"""What was given, taken and kept of energy, day by day, from the thin log: measured where somebody measures it.

A minute of the thin log has mean powers. Where part of a day has no measurement, as while a monitor was silent or the
autopilot did not run, what is missing is taken to be as the rest of the day was; that is an estimate, and marked.
"""

from __future__ import annotations

import datetime as dt
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.common.calendar import DAY_S, is_possible
from firmware_py.log.dataflash import LogError, Parser
from firmware_py.log.dating import dated
from firmware_py.log.disk import THIN, log_files
from firmware_py.log.open_file import open_buffer
from firmware_py.log.thin import SAILING, UPKEEP

JOULES_PER_WATT_HOUR: Final = 3600.0
LONGEST_S: Final = 600.0  # of a row: one that says more is damaged
_LABELS: Final = ("Utc", "Sec", "Flt", "BatV", "BatA", "Enr", "VSrv", "Sun", "Load", "SoC")
WHOLE: Final = 0.995  # of the time logged: with so much of it measured nothing is estimated


class Row(msgspec.Struct, frozen=True):
    """A minute of the thin log: when it ended, how long it was, and columns of both its messages by label."""

    utc_s: float
    span_s: float
    values: Mapping[str, float]

    def value(self, label: str) -> float | None:
        """Return a value, None when it was not known."""
        value = self.values.get(label, math.nan)
        return value if math.isfinite(value) else None


@dataclass(slots=True)
class Sum:
    """Energy measured, and for how long."""

    energy_j: float = 0.0
    measured_s: float = 0.0

    def add(self, power_w: float | None, span_s: float) -> None:
        """Take a stretch in; None was not measured."""
        if power_w is not None:
            self.energy_j += power_w * span_s
            self.measured_s += span_s


class Amount(msgspec.Struct, frozen=True):
    """Watt-hours over the time that was logged; `estimated`: part of it was not measured."""

    wh: float
    measured_h: float
    estimated: bool


@dataclass(slots=True)
class Day:
    """The sums of a day (UTC), empty for a time that no clock knew; `charge` is the last that was known."""

    name: str
    logged_s: float = 0.0
    solar: Sum = field(default_factory=Sum)
    load: Sum = field(default_factory=Sum)
    servo: Sum = field(default_factory=Sum)
    charged: Sum = field(default_factory=Sum)
    discharged: Sum = field(default_factory=Sum)
    charge: float | None = None

    def add(self, row: Row) -> None:
        """Take a row in."""
        span_s = row.span_s
        self.logged_s += span_s
        volts, amperes, steering_j = row.value("BatV"), row.value("BatA"), row.value("Enr")
        battery_w = None if volts is None or amperes is None else volts * amperes
        # A servo that tells no voltage tells no power either, and its sum stays 0.
        tells = steering_j is not None and row.value("VSrv") is not None
        self.solar.add(row.value("Sun"), span_s)
        self.load.add(row.value("Load"), span_s)
        self.servo.add(steering_j / span_s if tells and steering_j is not None else None, span_s)
        self.charged.add(None if battery_w is None else max(0.0, battery_w), span_s)
        self.discharged.add(None if battery_w is None else max(0.0, -battery_w), span_s)
        self.charge = row.value("SoC") if row.value("SoC") is not None else self.charge

    def amount(self, of: Sum, otherwise_w: float | None = None) -> Amount | None:
        """Return what a sum comes to over the time logged; what was not measured as the rest, or as `otherwise_w`."""
        if of.measured_s > 0.0:
            estimated = of.measured_s < WHOLE * self.logged_s
            joules = of.energy_j * self.logged_s / of.measured_s if estimated else of.energy_j
            return Amount(joules / JOULES_PER_WATT_HOUR, of.measured_s / 3600.0, estimated)
        if otherwise_w is None or not self.logged_s:
            return None
        return Amount(otherwise_w * self.logged_s / JOULES_PER_WATT_HOUR, 0.0, estimated=True)

    def amounts(self, rest_w: float | None) -> dict[str, Amount | None]:
        """Return all of it by name; `rest_w` is what all but the servo takes where nobody measures the load."""
        servo = self.amount(self.servo)
        servo_w = self.servo.energy_j / self.servo.measured_s if self.servo.measured_s else 0.0
        load = self.amount(self.load, None if rest_w is None else rest_w + servo_w)
        rest = None
        if load is not None and servo is not None:
            rest = Amount(load.wh - servo.wh, min(load.measured_h, servo.measured_h), load.estimated or servo.estimated)
        return {
            "solar": self.amount(self.solar),
            "load": load,
            "servo": servo,
            "rest": rest,
            "charged": self.amount(self.charged),
            "discharged": self.amount(self.discharged),
        }


def days(rows: Iterable[Row]) -> list[Day]:
    """Return the days that rows tell of, in order of time; those of no known day first."""
    found: dict[str, Day] = {}
    for row in rows:
        name = ""
        if is_possible(row.utc_s):
            middle_s = row.utc_s - 0.5 * row.span_s  # a minute over midnight is of the day of its greater part
            name = dt.datetime.fromtimestamp(middle_s // DAY_S * DAY_S, tz=dt.UTC).strftime("%Y-%m-%d")
        found.setdefault(name, Day(name)).add(row)
    return [found[name] for name in sorted(found)]


def thin_logs(directory: Path) -> list[Path]:
    """Return the thin logs of a state directory's logs, the oldest first."""
    thin = directory / THIN
    return list(log_files(thin).values()) if thin.is_dir() else []


def rows(paths: Sequence[Path]) -> Iterator[Row]:
    """Yield the rows of thin logs, dated; LogError for one that cannot be read.

    All are read first: the clock of a row may have been set later. A year of them takes some 60 MB.
    """
    values, times_s = array("d"), array("d")
    for path in paths:
        try:
            with open_buffer(path) as buffer:
                for time_s, cells in _rows(buffer):
                    times_s.append(time_s)
                    values.extend(cells)
        except OSError as error:
            raise LogError(f"{path}: {error.strerror or error}: give a thin log (.BIN or .BIN.gz)") from error
    width = len(_LABELS)
    utc_s = dated(values[0::width], times_s, values[1::width])
    for place, row_utc_s in enumerate(utc_s):
        row = dict(zip(_LABELS, values[place * width : (place + 1) * width], strict=True))
        yield Row(row_utc_s, row["Sec"], row)


def _rows(buffer: Any) -> Iterator[tuple[float, list[float]]]:
    """Yield the time of its run and the values of each row that is whole."""
    first: Mapping[str, float] | None = None
    for file_format, at in Parser(buffer):
        if file_format.name not in (SAILING.type.name, UPKEEP.type.name):
            continue
        cells = zip(file_format.labels, file_format.unpack(buffer, at), strict=True)
        values = {label: value for label, value in cells if isinstance(value, (int, float))}
        if file_format.name == SAILING.type.name:
            first = values
            continue
        # The second message of a row follows the first; one without is of a row that was cut off.
        if first is not None and first.get("TimeUS") == values.get("TimeUS"):
            both = {**first, **values}
            if 0.0 < both.get("Sec", math.nan) <= LONGEST_S:
                yield both.get("TimeUS", math.nan) / 1e6, [both.get(label, math.nan) for label in _LABELS]
        first = None
