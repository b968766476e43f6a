"""Daily energy balance from the thin log: generated, used and stored energy.

A row of the thin log has mean powers of a minute. If part of a day has no measurement, it is assumed to be like
the rest of the day, and the result is marked as an estimate.
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
from firmware_py.log.disk import THIN, log_files
from firmware_py.log.log_time import corrected_utc_s
from firmware_py.log.open_file import open_buffer
from firmware_py.log.thin import SAILING, UPKEEP

JOULES_PER_WATT_HOUR: Final = 3600.0
MAX_ROW_S: Final = 600.0  # a longer row is damaged
_LABELS: Final = ("Utc", "Sec", "Flt", "BatV", "BatA", "Enr", "VSrv", "Sun", "Load", "SoC")
MIN_MEASURED_SHARE: Final = 0.995  # of the logged time; below it the energy is extrapolated


class Row(msgspec.Struct, frozen=True):
    """A minute of the thin log: end, duration, and the columns of both messages by label."""

    utc_s: float
    span_s: float
    values: Mapping[str, float]

    def value(self, label: str) -> float | None:
        """Return a value, None if unknown."""
        value = self.values.get(label, math.nan)
        return value if math.isfinite(value) else None


@dataclass(slots=True)
class Sum:
    """Measured energy and the duration of the measurement."""

    energy_j: float = 0.0
    measured_s: float = 0.0

    def add(self, power_w: float | None, span_s: float) -> None:
        """Add a span; None: not measured."""
        if power_w is not None:
            self.energy_j += power_w * span_s
            self.measured_s += span_s


class Amount(msgspec.Struct, frozen=True):
    """Watt-hours over the logged time; `estimated`: part of it was not measured."""

    wh: float
    measured_h: float
    estimated: bool


@dataclass(slots=True)
class Day:
    """The sums of a day (UTC); the name is empty for an unknown date; `charge` is the last known one."""

    name: str
    logged_s: float = 0.0
    solar: Sum = field(default_factory=Sum)
    load: Sum = field(default_factory=Sum)
    servo: Sum = field(default_factory=Sum)
    charged: Sum = field(default_factory=Sum)
    discharged: Sum = field(default_factory=Sum)
    charge: float | None = None

    def add(self, row: Row) -> None:
        """Add a row."""
        span_s = row.span_s
        self.logged_s += span_s
        volts, amperes, steering_j = row.value("BatV"), row.value("BatA"), row.value("Enr")
        battery_w = None if volts is None or amperes is None else volts * amperes
        # Without a servo voltage there is no servo power, and the energy counter stays 0.
        servo_w = None if steering_j is None or row.value("VSrv") is None else steering_j / span_s
        self.solar.add(row.value("Sun"), span_s)
        self.load.add(row.value("Load"), span_s)
        self.servo.add(servo_w, span_s)
        self.charged.add(None if battery_w is None else max(0.0, battery_w), span_s)
        self.discharged.add(None if battery_w is None else max(0.0, -battery_w), span_s)
        self.charge = row.value("SoC") if row.value("SoC") is not None else self.charge

    def amount(self, of: Sum, otherwise_w: float | None = None) -> Amount | None:
        """Return a sum extrapolated to the logged time; `otherwise_w` is the power if nothing was measured."""
        if of.measured_s > 0.0:
            estimated = of.measured_s < MIN_MEASURED_SHARE * self.logged_s
            joules = of.energy_j * self.logged_s / of.measured_s if estimated else of.energy_j
            return Amount(joules / JOULES_PER_WATT_HOUR, of.measured_s / 3600.0, estimated)
        if otherwise_w is None or not self.logged_s:
            return None
        return Amount(otherwise_w * self.logged_s / JOULES_PER_WATT_HOUR, 0.0, estimated=True)

    def amounts(self, rest_w: float | None) -> dict[str, Amount | None]:
        """Return all amounts by name; `rest_w` is the power of all loads but the servo if the load is not measured."""
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
    """Return the days of rows in order of time, rows of unknown date first."""
    found: dict[str, Day] = {}
    for row in rows:
        name = ""
        if is_possible(row.utc_s):
            middle_s = row.utc_s - 0.5 * row.span_s  # a minute over midnight counts for the day of its larger part
            name = dt.datetime.fromtimestamp(middle_s // DAY_S * DAY_S, tz=dt.UTC).strftime("%Y-%m-%d")
        found.setdefault(name, Day(name)).add(row)
    return [found[name] for name in sorted(found)]


def thin_logs(directory: Path) -> list[Path]:
    """Return the thin logs below a log directory, the oldest first."""
    thin = directory / THIN
    return list(log_files(thin).values()) if thin.is_dir() else []


def rows(paths: Sequence[Path]) -> Iterator[Row]:
    """Yield the rows of thin logs with corrected UTC; raises LogError for a log that cannot be read.

    All rows are read first, because the clock may have been set after a row. A year takes about 60 MB.
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
    utc_s = corrected_utc_s(values[0::width], times_s, values[1::width])
    for index, row_utc_s in enumerate(utc_s):
        row = dict(zip(_LABELS, values[index * width : (index + 1) * width], strict=True))
        yield Row(row_utc_s, row["Sec"], row)


def _rows(buffer: Any) -> Iterator[tuple[float, list[float]]]:
    """Yield the time since the start of the run and the values of each whole row."""
    first: Mapping[str, float] | None = None
    for file_format, at in Parser(buffer):
        if file_format.name not in (SAILING.type.name, UPKEEP.type.name):
            continue
        cells = zip(file_format.labels, file_format.unpack(buffer, at), strict=True)
        values = {label: value for label, value in cells if isinstance(value, (int, float))}
        if file_format.name == SAILING.type.name:
            first = values
            continue
        # The second message of a row follows the first; a second message alone belongs to a truncated row.
        if first is not None and first.get("TimeUS") == values.get("TimeUS"):
            both = {**first, **values}
            if 0.0 < both.get("Sec", math.nan) <= MAX_ROW_S:
                yield both.get("TimeUS", math.nan) / 1e6, [both.get(label, math.nan) for label in _LABELS]
        first = None
