"""Reading and validation of numbers in plan files."""

from __future__ import annotations

import math
from typing import Any

from firmware_py.common.parameter_row import SINGLE_MAX
from firmware_py.common.plan import PlanItem
from firmware_py.plans.items import has_position

_INT32 = 1 << 31


class PlanFileError(ValueError):
    """Refusal of a plan file; the text contains file, line or item, and remedy."""


def read_number(text: str) -> float:
    """Read a number of a text file; raise PlanFileError for any other text."""
    try:
        # float() would accept underscores.
        return float(text.replace("_", "?"))
    except ValueError:
        raise PlanFileError(f"{text[:30]!r} is not a number") from None


def read_integer(text: str, high: int) -> int:
    """Read an integer from 0 to `high`; raise PlanFileError for any other text."""
    value = read_number(text)
    if not (0 <= value <= high and value == math.floor(value)):
        raise PlanFileError(f"{text[:30]!r} is not a whole number from 0 to {high}")
    return int(value)


def scale_angle(angle_deg: float, name: str, limit_deg: float) -> int:
    """Convert an angle to 1e-7 degrees, as in MAVLink; raise PlanFileError beyond the limit."""
    if not abs(angle_deg) <= limit_deg:
        raise PlanFileError(f"{name} {angle_deg:g} is not within -{limit_deg:g} to {limit_deg:g} deg")
    return round(angle_deg * 1e7)


def scale_position(latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    """Convert a position to x and y of an item; raise PlanFileError beyond the limits."""
    return scale_angle(latitude_deg, "latitude", 90.0), scale_angle(longitude_deg, "longitude", 180.0)


def make_item(command: int, frame: int, params: list[float], *, autocontinue: bool) -> PlanItem:
    """Create an item from the seven parameters of a file; x and y of a position are in degrees.

    Raise PlanFileError for a parameter beyond single precision and for an impossible position.
    """
    for number, value in enumerate(params, start=1):
        if math.isfinite(value) and abs(value) > SINGLE_MAX:
            raise PlanFileError(f"param{number} is too large")
    param1, param2, param3, param4, x, y, z = params
    int_x, int_y = scale_position(x, y) if has_position(command) else (_to_int_or_zero(x), _to_int_or_zero(y))
    return PlanItem(command, frame, autocontinue, (param1, param2, param3, param4), int_x, int_y, z)


def _to_int_or_zero(value: float) -> int:
    return int(value) if abs(value) < _INT32 else 0


def add_location(source: str, location: str, error: PlanFileError) -> PlanFileError:
    """Return the error with its location in the file."""
    return PlanFileError(f"{source}{location}: {error}")


def shorten(value: Any) -> str:
    """Return the text of a value for a message, at most 40 characters."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
