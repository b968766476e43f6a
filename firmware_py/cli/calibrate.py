"""`rambler calibrate compass`: the compass's deviation as she has sailed it, from her logs; proposed, never set."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from firmware_py.cli.refusal import refused
from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.intents import SetParameter
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet, format_file
from firmware_py.core.state_codec import state_from_text
from firmware_py.estimate import swing
from firmware_py.estimate.deviation import NAMES, deviation_of, deviation_rad
from firmware_py.estimate.swing import Swing
from firmware_py.estimate.swinging import Swinging
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, read_log

NOT_ENOUGH = 1
_WHAT_STAYS = (
    "A holds her leeway, too: a bearing of a known mark tells them apart.",
    "A speed that differs by heading by a percent looks like 0.6 deg of B or C.",
)


def swung(ticks: Iterable[LoggedTick], parameters: ParameterSet | None = None) -> Swinging:
    """Return the swing of logged ticks; ValueError for a checkpoint that cannot be read."""
    swinging = Swinging(parameters or ParameterSet())
    for tick in ticks:
        if tick.checkpoint is not None:
            swinging.set_parameters(state_from_text(tick.checkpoint)[0].parameters)
        for request in tick.inputs.requests:
            if isinstance(request.intent, SetParameter):
                swinging.set_parameters(_with(swinging.parameters, request.intent))
        swinging.take(tick.inputs)
    return swinging


def _with(parameters: ParameterSet, intent: SetParameter) -> ParameterSet:
    try:
        return parameters.replaced(intent.name, intent.value)
    except ParameterError:  # of another version
        return parameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("what", choices=("compass",), help="compass: its deviation, by way and heading")
    parser.add_argument("log", metavar="LOG", type=Path, nargs="+", help="onboard logs (.BIN, .BIN.gz), oldest first")
    parser.add_argument("--save", metavar="OUT", type=Path, help="write the proposal to OUT, a parameter file to load")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 with a proposal, 1 when the logs do not tell enough for one."""
    try:
        swinging = swung(chain.from_iterable(_named(path) for path in arguments.log))
    except (LogError, ValueError) as error:
        return refused("calibrate", str(error))
    found = swinging.result()
    if arguments.json:
        print(json.dumps(_record(swinging, found)))
    else:
        print("\n".join(_lines(swinging, found)))
    if found is None or not found.ready:
        return NOT_ENOUGH
    if arguments.save is not None:
        values = {name: round(degrees(one), 2) for name, one in zip(NAMES, found.coefficients_rad, strict=True)}
        try:
            arguments.save.write_text(format_file(values), encoding="ascii")
        except OSError as error:
            return refused("calibrate", f"{arguments.save}: cannot be written: {error.strerror}")
    return 0


def _named(path: Path) -> Iterator[LoggedTick]:
    try:
        yield from read_log(path)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error


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
