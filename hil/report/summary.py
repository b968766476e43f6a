"""summary.json: what a run came to, for other programs."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from hil.report.figures import RudderTravel, goal_figures, steady_rudder_travel_deg_per_h
from hil.report.loop_health import from_logs
from hil.ship import extras_table, power_plant
from hil.sim.runner import STATE, Run

PACKAGES = ("rambler-autopilot", "numpy", "pymavlink")
DIGITS = 4
Summary = dict[str, Any]


def summarise(run: Run) -> Summary:
    """Return the content of summary.json; errors are heading less goal, of the hull's low-frequency heading."""
    options = run.options
    figures = goal_figures(run.truth)
    travel = RudderTravel()
    for piece in run.truth:
        travel.add(piece.time_s, piece.rudder_rad)
    accepted = {order.goal.t_s: order.accepted_s for order in run.orders if order.goal is not None}
    goals = [asdict(one) for one in figures]
    for goal in goals:
        goal["accepted_s"] = next((at_s for t_s, at_s in accepted.items() if abs(t_s - goal["t_s"]) <= 0.1), None)
    health = from_logs(options.out / STATE / "logs", lockstep=options.lockstep)
    summary: Summary = {
        "scenario": options.scenario.name,
        "with": extras_table.text_of(options.scenario.extras),
        "seed": options.seed,
        "seconds": options.seconds,
        "compass": options.vehicle.compass.driver,
        "servo": options.vehicle.rudder.driver,
        "settings": {**options.vehicle.parameters, **options.settings},
        "goals": goals,
        "rudder_travel_deg_per_h": steady_rudder_travel_deg_per_h(figures),
        "rudder_travel_whole_deg_per_h": travel.deg_per_h(),
        **({} if run.plant is None else {"supply": power_plant.figures(run.plant)}),
        "loop": None if health is None else asdict(health),
        "lockstep": options.lockstep,
        "speed_ratio": run.speed_ratio,
        "versions": versions(),
    }
    rounded: Summary = _rounded(summary)
    return rounded


def write(summary: Summary, path: Path) -> None:
    """Write summary.json."""
    path.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def versions() -> dict[str, str]:
    """Return the versions that the figures depend on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return value
