"""Daily energy balance from the thin log: generated, used and stored energy.

A row of the thin log contains mean powers of a minute. For the part of a day without measurements, the mean power of
the rest of the day is assumed, and the result is marked as an estimate.
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
MIN_MEASURED_FRACTION: Final = 0.995  # of the logged time; below this fraction the energy is extrapolated


class Row(msgspec.Struct, frozen=True):
    """A minute of the thin log: time of the end, duration, and the columns of both messages by label."""

    utc_s: float
    span_s: float
    values: Mapping[str, float]

    def value(self, label: str) -> float | None:
        """Return a value, None if unknown."""
        value = self.values.get(label, math.nan)
        return value if math.isfinite(value) else None


@dataclass(slots=True)
class Sum:
    """Measured energy and total duration of the measurements."""

    energy_j: float = 0.0
    measured_s: float = 0.0

    def add(self, power_w: float | None, span_s: float) -> None:
        """Add the energy of an interval; None: the power was not measured."""
        if power_w is not None:
            self.energy_j += power_w * span_s
            self.measured_s += span_s


class Amount(msgspec.Struct, frozen=True):
    """Energy in the logged time; `estimated`: a part of the time was not measured."""

    wh: float
    measured_h: float
    estimated: bool


@dataclass(slots=True)
class Day:
    """The sums of a day (UTC); `name` is empty for an unknown date, `charge` is the last known value."""

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

    def amount(self, measured: Sum, default_w: float | None = None) -> Amount | None:
        """Return a sum extrapolated to the logged time; `default_w` is the power if nothing was measured."""
        if measured.measured_s > 0.0:
            estimated = measured.measured_s < MIN_MEASURED_FRACTION * self.logged_s
            energy_j = measured.energy_j * self.logged_s / measured.measured_s if estimated else measured.energy_j
            return Amount(energy_j / JOULES_PER_WATT_HOUR, measured.measured_s / 3600.0, estimated)
        if default_w is None or not self.logged_s:
            return None
        return Amount(default_w * self.logged_s / JOULES_PER_WATT_HOUR, 0.0, estimated=True)

    def amounts(self, rest_w: float | None) -> dict[str, Amount | None]:
        """Return all amounts by name; without a measured load, `rest_w` is the power of all loads but the servo."""
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


def sum_by_day(rows: Iterable[Row]) -> list[Day]:
    """Sum up rows by day; days are in order of time, the unknown date is first."""
    days_by_name: dict[str, Day] = {}
    for row in rows:
        name = ""
        if is_possible(row.utc_s):
            middle_s = row.utc_s - 0.5 * row.span_s  # a row across midnight belongs to the day of its larger part
            name = dt.datetime.fromtimestamp(middle_s // DAY_S * DAY_S, tz=dt.UTC).strftime("%Y-%m-%d")
        days_by_name.setdefault(name, Day(name)).add(row)
    return [days_by_name[name] for name in sorted(days_by_name)]


def list_thin_logs(directory: Path) -> list[Path]:
    """Return the paths of the thin logs below a log directory, the oldest first."""
    thin = directory / THIN
    return list(log_files(thin).values()) if thin.is_dir() else []


def read_rows(paths: Sequence[Path]) -> Iterator[Row]:
    """Yield the rows of thin logs with corrected UTC; raises LogError for a log that cannot be read.

    All rows are read first, because the clock may be set only after a row. A year needs about 60 MB of memory.
    """
    values, times_s = array("d"), array("d")
    for path in paths:
        try:
            with open_buffer(path) as buffer:
                for time_s, cells in _read_rows(buffer):
                    times_s.append(time_s)
                    values.extend(cells)
        except OSError as error:
            raise LogError(f"{path}: {error.strerror or error}: give a thin log (.BIN or .BIN.gz)") from error
    width = len(_LABELS)
    utc_s = corrected_utc_s(values[0::width], times_s, values[1::width])
    for index, row_utc_s in enumerate(utc_s):
        row = dict(zip(_LABELS, values[index * width : (index + 1) * width], strict=True))
        yield Row(row_utc_s, row["Sec"], row)


def _read_rows(buffer: Any) -> Iterator[tuple[float, list[float]]]:
    """Yield the time since the start of the run and the values of each whole row."""
    first_values: Mapping[str, float] | None = None
    for file_format, at in Parser(buffer):
        if file_format.name not in (SAILING.type.name, UPKEEP.type.name):
            continue
        cells = zip(file_format.labels, file_format.unpack(buffer, at), strict=True)
        values = {label: value for label, value in cells if isinstance(value, (int, float))}
        if file_format.name == SAILING.type.name:
            first_values = values
            continue
        # A row is two messages in succession; a second message without the first belongs to a truncated row.
        if first_values is not None and first_values.get("TimeUS") == values.get("TimeUS"):
            all_values = {**first_values, **values}
            if 0.0 < all_values.get("Sec", math.nan) <= MAX_ROW_S:
                yield all_values.get("TimeUS", math.nan) / 1e6, [all_values.get(label, math.nan) for label in _LABELS]
        first_values = None
