"""Row of the parameter table (parameter_table.py).

Names have at most 16 characters (MAVLink). REAL values are rounded to single precision, so that ground stations, loop
and store use exactly the same values.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from enum import IntEnum

import msgspec


class ParameterError(ValueError):
    """A parameter name or value is refused; the text has a line with reason and allowed values for each."""


class Kind(IntEnum):
    """Type of a parameter, numbered as MAVLink's MAV_PARAM_TYPE (INT32, REAL32)."""

    INTEGER = 6
    REAL = 9


class Parameter(msgspec.Struct, frozen=True):
    """One row of the table; `choices` names the values of an enumeration."""

    name: str
    default: float
    minimum: float
    maximum: float
    unit: str
    kind: Kind
    text: str
    choices: Mapping[int, str] | None = None
    reboot: bool = False  # takes effect at the next start
    read_only: bool = False  # counted or measured by the autopilot

    def check(self, value: float) -> float:
        """Return the value as it is stored, or raise ParameterError."""
        allowed = self.allowed_values()
        if not math.isfinite(value):
            raise ParameterError(f"{self.name}: {value} is not a number; allowed: {allowed}")
        stored = value
        if self.kind is Kind.INTEGER:
            if value != math.floor(value):
                raise ParameterError(f"{self.name}: {value:g} is not a whole number; allowed: {allowed}")
        elif abs(value) <= SINGLE_MAX:
            stored = to_single(value)
        if not to_single(self.minimum) <= stored <= to_single(self.maximum):
            raise ParameterError(f"{self.name}: {value:g} is out of range; allowed: {allowed}")
        if self.choices is not None and int(stored) not in self.choices:
            raise ParameterError(f"{self.name}: {value:g} is not one of its values; allowed: {allowed}")
        return stored

    def allowed_values(self) -> str:
        """Return the allowed values, for messages."""
        if self.choices is not None:
            return ", ".join(f"{number} ({text})" for number, text in self.choices.items())
        return f"{self.minimum:g} to {self.maximum:g} {self.unit}".rstrip()


SINGLE_MAX = 3.4028234663852886e38


def to_single(value: float) -> float:
    """Round to single precision, the precision of a MAVLink parameter."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def real(
    name: str, default: float, low: float, high: float, unit: str, text: str, *, reboot: bool = False
) -> Parameter:
    """Return a row of a REAL parameter."""
    return Parameter(name, to_single(default), low, high, unit, Kind.REAL, text, None, reboot)


def integer(name: str, default: int, low: int, high: int, unit: str, text: str, *, reboot: bool = False) -> Parameter:
    """Return a row of an INTEGER parameter."""
    return Parameter(name, default, low, high, unit, Kind.INTEGER, text, None, reboot)


def choice(name: str, default: int, choices: Mapping[int, str], text: str, *, reboot: bool = False) -> Parameter:
    """Return a row whose values are those of an enumeration."""
    return Parameter(name, default, min(choices), max(choices), "", Kind.INTEGER, text, choices, reboot)


def count(name: str, text: str) -> Parameter:
    """Return a read-only row of a counter."""
    # The maximum is exact in single precision.
    return Parameter(name, 0.0, 0, 1_000_000, "", Kind.INTEGER, text, read_only=True)


def constant(name: str, value: int, meaning: str, text: str) -> Parameter:
    """Return a read-only row with one value."""
    return Parameter(name, value, value, value, "", Kind.INTEGER, text, {value: meaning}, read_only=True)
