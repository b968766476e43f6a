"""The figures of a run as a table on the terminal."""

from __future__ import annotations

from typing import Any

from hil.report.summary import Summary

COLUMNS = ("goal", "overshoot", "settled after", "mean error", "rms error", "95 % within", "rudder travel")


def figures_text(summary: Summary) -> str:
    """Return the table of goals and the line of the loop."""
    rows = [COLUMNS, *map(goal_cells, summary["goals"])] if summary["goals"] else []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([*lines, loop_line(summary)])


def goal_cells(goal: dict[str, Any], time_override: str = "") -> tuple[str, ...]:
    """Return the figures of a goal as texts with units; `time_override` replaces its time in seconds."""
    time_text = time_override or f"{goal['t_s']:.0f} s"
    settling_text = "never" if goal["settling_s"] is None else f"{goal['settling_s']:.0f} s"
    return (
        f"{goal['goal_deg']:.0f} deg at {time_text}",
        f"{goal['overshoot_deg']:.2f} deg",
        settling_text,
        f"{goal['mean_error_deg']:+.2f} deg",
        f"{goal['rms_error_deg']:.2f} deg",
        f"{goal['p95_error_deg']:.2f} deg",
        f"{goal['rudder_travel_deg_per_h']:.0f} deg/h",
    )


def loop_line(summary: Summary) -> str:
    """Return the timing of the control loop in one line."""
    if not summary["sailed_s"]:
        return f"empty run, no figures: {summary['ending']}"
    loop = summary["loop"]
    ratio = summary["speed_ratio"]
    speed = "speed unknown" if ratio is None else f"{ratio:.1f} x real time"
    if loop is None:
        return f"loop: no readable onboard log; {speed}"
    lateness = loop["lateness_us"]
    lateness_text = f"; {loop['note']}" if loop["note"] else ""
    if lateness is not None:
        lateness_text = "; lateness of ticks " + ", ".join(f"{name} {value:.0f} us" for name, value in lateness.items())
    return f"loop: {loop['ticks']} ticks, {loop['skipped']} skipped{lateness_text}; {speed}"
