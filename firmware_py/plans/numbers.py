"""Checked numbers of plan files."""

from __future__ import annotations

import math
from typing import Any

from firmware_py.common.parameter_row import SINGLE_MAX
from firmware_py.common.plan import PlanItem
from firmware_py.plans.items import has_position

_INT32 = 1 << 31


class PlanFileError(ValueError):
    """A plan file is refused; the text names file, line or item, and remedy."""


def read_number(text: str) -> float:
    """Read a number of a text file; PlanFileError for anything else."""
    try:
        # Python would accept underscores.
        return float(text.replace("_", "?"))
    except ValueError:
        raise PlanFileError(f"{text[:30]!r} is not a number") from None


def read_whole(text: str, high: int) -> int:
    """Read a whole number from 0 to high."""
    value = read_number(text)
    if not (0 <= value <= high and value == math.floor(value)):
        raise PlanFileError(f"{text[:30]!r} is not a whole number from 0 to {high}")
    return int(value)


def scale_angle(angle_deg: float, name: str, limit_deg: float) -> int:
    """Return an angle in 1e-7 degrees, as in MAVLink."""
    if not abs(angle_deg) <= limit_deg:
        raise PlanFileError(f"{name} {angle_deg:g} is not within -{limit_deg:g} to {limit_deg:g} deg")
    return round(angle_deg * 1e7)


def scale_place(latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    """Return x and y of a place."""
    return scale_angle(latitude_deg, "latitude", 90.0), scale_angle(longitude_deg, "longitude", 180.0)


def make_item(command: int, frame: int, params: list[float], *, autocontinue: bool) -> PlanItem:
    """Create an item from the seven parameters of a file; x and y of a place are in degrees."""
    for number, value in enumerate(params, start=1):
        if math.isfinite(value) and abs(value) > SINGLE_MAX:
            raise PlanFileError(f"param{number} is too large")
    first, second, third, fourth, x, y, z = params
    if has_position(command):
        whole_x, whole_y = scale_place(x, y)
    else:
        whole_x, whole_y = _whole_or_zero(x), _whole_or_zero(y)
    return PlanItem(command, frame, autocontinue, (first, second, third, fourth), whole_x, whole_y, z)


def _whole_or_zero(value: float) -> int:
    return int(value) if abs(value) < _INT32 else 0


def located(source: str, where: str, error: PlanFileError) -> PlanFileError:
    """Return the error with its place in the file."""
    return PlanFileError(f"{source}{where}: {error}")


def shorten(value: Any) -> str:
    """Return a value for a message, at most 40 characters."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
