"""`rambler calibrate`: the compass's deviation as she has sailed it, the rudder's centre and limits; never set."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from firmware_py.cli import calibrate_rudder
from firmware_py.cli.logged import in_force, ticks_of
from firmware_py.cli.refusal import refused
from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet, format_file
from firmware_py.estimate import swing
from firmware_py.estimate.deviation import NAMES, deviation_of, deviation_rad
from firmware_py.estimate.swing import Swing
from firmware_py.estimate.swinging import Swinging
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick

NOT_ENOUGH = 1
_WHAT_STAYS = (
    "A holds her leeway, too: a bearing of a known mark tells them apart.",
    "A speed that differs by heading by a percent looks like 0.6 deg of B or C.",
)


def swung(ticks: Iterable[LoggedTick]) -> Swinging:
    """Return the swing of logged ticks; ValueError for a checkpoint that cannot be read."""
    swinging = Swinging(ParameterSet())
    for tick, parameters, _armed in in_force(ticks):
        swinging.set_parameters(parameters)
        swinging.take(tick.inputs)
    return swinging


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    text = "compass: its deviation, by way and heading; rudder: centre, limits and direction"
    parser.add_argument("what", choices=("compass", "rudder"), help=text)
    text = "onboard logs (.BIN, .BIN.gz), oldest first; for the rudder on the bench the vehicle file (.toml)"
    parser.add_argument("file", metavar="LOG|VEHICLE.toml", type=Path, nargs="+", help=text)
    parser.add_argument("--save", metavar="OUT", type=Path, help="write the proposal to OUT, a parameter file to load")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--state", metavar="DIR", type=Path, help="bench: the state directory with what links have set")
    text = "bench: the rudder has been laid amidships by hand, its centre is to be proposed"
    parser.add_argument("--amidships", action="store_true", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 with a proposal, 1 when there is not enough for one, 2 when nothing can be read or moved."""
    report = calibrate_rudder.report if arguments.what == "rudder" else _compass
    try:
        code, proposal = report(arguments, ticks_of(arguments.file))
    except (LogError, ValueError) as error:
        return refused("calibrate", str(error))
    if proposal and arguments.save is not None:
        try:
            arguments.save.write_text(format_file(proposal), encoding="ascii")
        except OSError as error:
            return refused("calibrate", f"{arguments.save}: cannot be written: {error.strerror}")
    return code


def _compass(arguments: argparse.Namespace, ticks: Iterable[LoggedTick]) -> tuple[int, Mapping[str, float]]:
    swinging = swung(ticks)
    found = swinging.result()
    print(json.dumps(_record(swinging, found)) if arguments.json else "\n".join(_lines(swinging, found)))
    if found is None or not found.ready:
        return NOT_ENOUGH, {}
    return 0, {name: round(degrees(one), 2) for name, one in zip(NAMES, found.coefficients_rad, strict=True)}


def _record(swinging: Swinging, found: Swing | None) -> dict[str, Any]:
    sectors = swinging.state.sectors
    if found is None:
        return {"ready": False, "minutes": 0, "sectors": list(sectors)}
    report = swinging.report()
    return {
        "ready": found.ready,
        "minutes": sum(sectors),
        "sectors": list(sectors),
        "in_force_deg": {name: swinging.parameters[name] for name in NAMES},
        "proposed_deg": _by_name(found.coefficients_rad),
        "sd_deg": _by_name(found.sds_rad),
        "worst_sd_deg": round(degrees(found.sd_rad), 3),
        "off_deg": round(degrees(found.off_rad), 3),
        "residual_before_deg": _residual(report.residual_before_rad),
        "residual_after_deg": _residual(report.residual_after_rad),
        "mounting_deg": round(_mounting_deg(swinging, found), 3),
    }


def _residual(residual_rad: float | None) -> float | None:
    return None if residual_rad is None else round(degrees(residual_rad), 3)


def _mounting_deg(swinging: Swinging, found: Swing) -> float:
    """Return the mounting angle that would do what A does: by how much she goes another way on the mean."""
    return degrees(wrap_pi(radians(swinging.parameters["CMP_OFFSET_DEG"]) + found.coefficients_rad[0]))


def _by_name(values: Iterable[float]) -> dict[str, float]:
    return {name: round(degrees(value), 3) for name, value in zip(NAMES, values, strict=True)}


def _lines(swinging: Swinging, found: Swing | None) -> Iterator[str]:
    sectors = swinging.state.sectors
    sailed = sum(minutes > 0 for minutes in sectors)
    yield f"{sum(sectors)} minutes of steady way in {sailed} of {swing.SECTORS} parts of the circle"
    if found is None:
        yield "no minute with headings and velocity over the ground: nothing to tell"
        return
    yield f"{'':<10} in force  proposed  sd (deg)"
    for name, value, sd in zip(NAMES, found.coefficients_rad, found.sds_rad, strict=True):
        yield f"{name:<10} {swinging.parameters[name]:8.2f}  {degrees(value):8.2f}  {degrees(sd):8.2f}"
    in_force = deviation_of(swinging.parameters, "CMP")
    yield "compass    in force  proposed"
    for heading_deg in range(0, 360, 45):
        curves = (in_force, found.coefficients_rad)
        before, after = (degrees(deviation_rad(curve, radians(heading_deg))) for curve in curves)
        yield f"{heading_deg:7d}    {before:8.2f}  {after:8.2f}"
    off_deg, sd_deg = degrees(found.off_rad), degrees(found.sd_rad)
    yield f"in force is off by up to {off_deg:.2f} deg; the proposal's sd is up to {sd_deg:.2f} deg"
    report = swinging.report()
    if report.residual_before_rad is not None and report.residual_after_rad is not None:
        before_deg, after_deg = degrees(report.residual_before_rad), degrees(report.residual_after_rad)
        yield f"minutes differ by {before_deg:.1f} deg (rms) with what is in force, {after_deg:.1f} with the proposal"
    offset_deg, mounting_deg = swinging.parameters["CMP_OFFSET_DEG"], _mounting_deg(swinging, found)
    yield f"alignment: CMP_OFFSET_DEG {mounting_deg:.2f} for {offset_deg:.2f} does what CMP_DEV_A does; set one of them"
    yield from _WHAT_STAYS
    if not found.ready:
        yield (
            f"not enough for a proposal: {swing.ENOUGH_SECTORS} parts of the circle and an sd of "
            f"{degrees(swing.ENOUGH_RAD):g} deg; sail more courses, a quarter of an hour each"
        )
