"""Data model of all pages that show a voyage: columns over time, panels of lines, marks, plans.

A voyage is a mapping of JSON values, drawn by the scripts of this folder:

    columns   name -> numbers, null if unknown, all of the length of time_s; a row of nulls interrupts the lines
    panels    as Panel; a line without values is not drawn, nor a panel without lines
    marks     [time_s, severity (0 to 7, MAVLink's), text]
    origin    [latitude, longitude] of north_m and east_m; or columns lat_deg and lon_deg instead
    plans     mission, fence, rally: [MAV_CMD, param1 to param4, latitude, longitude] for each item; home: a position
    first_item  displayed number of the first mission item; item: displayed number of the active one
    target    [latitude, longitude, radius in m or null]
    vessels   name, lat_deg, lon_deg, course_deg of each other vessel
    begin_utc_s  UTC of time 0; with it, calendar times are shown
    spectrum  frequency_hz, lines [label, look, numbers], marks [hertz, label]

Angles are in degrees; the scripts wrap headings.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from firmware_py.common.plan import Plan

Voyage = dict[str, Any]
POSITION_DIGITS, DIGITS = 7, 3


class Line(msgspec.Struct, frozen=True):
    """A column drawn as a line; `look` is a class of view.css."""

    column: str
    label: str
    look: str = "main"


class Panel(msgspec.Struct, frozen=True):
    """Lines over time with one axis.

    `min_span` is the minimum span of the axis, `band` a value up to which the range around 0 is shaded; such an axis
    does not include values far outside the band. `wrap`: the values are compass degrees. `zero`: the axis includes 0.
    `step`: a value is constant until the next one. `tall`: the panel is higher.
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
        (
            Line("command_deg", "commanded", "command"),
            Line("rudder_estimated_deg", "estimated", "second"),
            Line("rudder_deg", "angle"),
        ),
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
    Panel("wind (m/s)", (Line("gust_m_s", "gust", "command"), Line("wind_m_s", "wind")), min_span=2.0, zero=True),
    Panel("water depth (m)", (Line("depth_m", "depth"),), min_span=2.0, zero=True),
    Panel("active faults", (Line("faults", "faults", "bad"),), min_span=1.0, zero=True, step=True),
)


def voyage(
    columns: Mapping[str, Iterable[float]], marks: Sequence[tuple[float, int, str]], panels: Sequence[Panel] = PANELS
) -> Voyage:
    """Return a voyage with rounded columns, None for values that are not finite."""
    digits = {"lat_deg": POSITION_DIGITS, "lon_deg": POSITION_DIGITS}
    return {
        "columns": {name: numbers(values, digits.get(name, DIGITS)) for name, values in columns.items()},
        "panels": [msgspec.to_builtins(panel) for panel in panels],
        "marks": [[round(t_s, 2), severity, text] for t_s, severity, text in marks if math.isfinite(t_s)],
    }


def numbers(values: Iterable[float], digits: int = DIGITS) -> list[float | None]:
    """Return rounded numbers for JSON, None for values that are not finite."""
    return [round(value, digits) if math.isfinite(value) else None for value in values]


def plan_rows(plan: Plan) -> list[list[float | None]]:
    """Return the items of a plan as rows of a voyage."""
    return [
        [item.command, *numbers(item.params, POSITION_DIGITS), *numbers((item.x / 1e7, item.y / 1e7), POSITION_DIGITS)]
        for item in plan.items
    ]
