"""Data model of all pages that show a voyage: columns over time, panels of lines, marks, plans.

A voyage is a mapping of JSON values, drawn by the scripts of this folder:

    columns   name -> numbers, null where unknown, all as long as time_s; a row of nulls breaks the lines
    panels    below; a line whose column is missing or empty is left out, and so is a panel without lines
    marks     [time_s, severity (0 to 7, MAVLink's), text]
    origin    [latitude, longitude] of north_m and east_m; or columns lat_deg and lon_deg instead
    plans     mission, fence, rally: [MAV_CMD, param1 to param4, latitude, longitude] for each item; home: a place
    first_item  number of the first mission item, as displayed; item: the active one
    begin_utc_s  UTC of time 0, for calendar times
    spectrum  frequency_hz, lines [label, look, numbers], marks [hertz, label]

Angles in degrees; headings are not wrapped, the scripts wrap them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from firmware_py.common.plan import Plan

Voyage = dict[str, Any]
PLACE_DIGITS, DIGITS = 7, 3


class Line(msgspec.Struct, frozen=True):
    """A column drawn as a line; its look is a class of view.css."""

    column: str
    label: str
    look: str = "main"


class Panel(msgspec.Struct, frozen=True):
    """Lines over time with one axis: `min_span` is its minimum span, `band` shades +- this value around 0.

    An axis with a band does not follow values far outside it. `wrap`: compass degrees. `step`: a value holds until the
    next.
    """

    title: str
    lines: tuple[Line, ...]
    min_span: float = 0.0
    band: float = 0.0
    wrap: bool = False
    zero: bool = False
    step: bool = False
    tall: bool = False


PANELS: Final = (
    Panel(
        "heading (deg)",
        (
            Line("compass_deg", "compass", "faint"),
            Line("true_heading_deg", "true", "second"),
            Line("heading_deg", "heading", "main"),
            Line("goal_deg", "goal", "goal"),
        ),
        min_span=10.0,
        wrap=True,
        tall=True,
    ),
    Panel("heading error (deg)", (Line("error_deg", "error"),), min_span=2.0, band=3.0, zero=True),
    Panel("yaw rate (deg/s)", (Line("yaw_rate_deg_s", "yaw rate"),), min_span=0.2, zero=True),
    Panel(
        "rudder (deg)",
        (Line("command_deg", "commanded", "command"), Line("rudder_deg", "angle")),
        min_span=4.0,
        zero=True,
    ),
    Panel("cross-track distance (m, + to starboard)", (Line("cross_track_m", "cross-track"),), min_span=4.0, zero=True),
    Panel("distance to fence (m)", (Line("fence_margin_m", "margin"),), min_span=10.0, zero=True),
    Panel(
        "speed (m/s)",
        (
            Line("ground_m_s", "over ground"),
            Line("water_m_s", "through water", "second"),
            Line("current_m_s", "current", "command"),
        ),
        min_span=0.2,
        zero=True,
    ),
    Panel(
        "estimated waves",
        (Line("wave_period_s", "period (s)"), Line("wave_sd_deg", "yaw (deg)", "command")),
        min_span=2.0,
        zero=True,
    ),
    Panel("battery voltage (V)", (Line("battery_v", "battery"),), min_span=0.5),
    Panel("battery charge (%)", (Line("charge_percent", "charge"),), min_span=5.0),
    Panel(
        "power (W)",
        (Line("solar_w", "panels", "command"), Line("load_w", "loads", "second"), Line("servo_w", "servo")),
        min_span=1.0,
        zero=True,
    ),
    Panel("active faults", (Line("faults", "faults", "bad"),), min_span=1.0, zero=True, step=True),
)


def voyage(
    columns: Mapping[str, Iterable[float]], marks: Sequence[tuple[float, int, str]], panels: Sequence[Panel] = PANELS
) -> Voyage:
    """Return a voyage of rounded columns, with null for values that are not finite."""
    digits = {"lat_deg": PLACE_DIGITS, "lon_deg": PLACE_DIGITS}
    return {
        "columns": {name: numbers(values, digits.get(name, DIGITS)) for name, values in columns.items()},
        "panels": [msgspec.to_builtins(panel) for panel in panels],
        "marks": [[round(t_s, 2), severity, text] for t_s, severity, text in marks if math.isfinite(t_s)],
    }


def numbers(values: Iterable[float], digits: int = DIGITS) -> list[float | None]:
    """Return rounded numbers for JSON, None for values that are not finite."""
    return [round(value, digits) if math.isfinite(value) else None for value in values]


def plan_rows(plan: Plan) -> list[list[float | None]]:
    """Return the items of a plan."""
    return [
        [item.command, *numbers(item.params, PLACE_DIGITS), *numbers((item.x / 1e7, item.y / 1e7), PLACE_DIGITS)]
        for item in plan.items
    ]
