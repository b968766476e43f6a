"""`rambler calibrate`: propose compass deviation, rudder centre and limits from logs or on the bench."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from firmware_py.cli import calibrate_rudder
from firmware_py.cli.errors import print_error
from firmware_py.cli.logged_ticks import read_ticks, track_parameters
from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet, format_file
from firmware_py.estimate import deviation_filter
from firmware_py.estimate.deviation import NAMES, deviation_rad, read_deviation
from firmware_py.estimate.deviation_estimator import DeviationEstimator
from firmware_py.estimate.deviation_filter import DeviationEstimate
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick

INSUFFICIENT_DATA = 1
_NOTES = (
    "CMP_DEV_A includes the leeway; the bearing of a known mark separates them.",
    "A speed that varies with the heading by 1 % appears as 0.6 deg of CMP_DEV_B or CMP_DEV_C.",
)


def estimate_deviation(ticks: Iterable[LoggedTick]) -> DeviationEstimator:
    """Estimate the compass deviation from logged ticks; raise ValueError for an unreadable checkpoint."""
    estimator = DeviationEstimator(ParameterSet())
    for tick, parameters, _armed in track_parameters(ticks):
        estimator.set_parameters(parameters)
        estimator.take(tick.inputs)
    return estimator


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    text = "compass: deviation from headings and courses; rudder: centre, limits and direction"
    parser.add_argument("what", choices=("compass", "rudder"), help=text)
    text = "onboard logs (.BIN, .BIN.gz), oldest first; for the rudder on the bench, the vehicle file (.toml)"
    parser.add_argument("file", metavar="LOG|VEHICLE.toml", type=Path, nargs="+", help=text)
    parser.add_argument("--save", metavar="OUT", type=Path, help="write the proposal to OUT, a parameter file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--state", metavar="DIR", type=Path, help="bench: state directory with the stored parameters")
    text = "bench: propose the present angle as centre; first turn the rudder amidships by hand"
    parser.add_argument("--amidships", action="store_true", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Return 0 with a proposal, 1 without enough data, 2 for an unreadable log, a faulty rudder or a failed --save."""
    report = calibrate_rudder.report if arguments.what == "rudder" else _compass
    try:
        code, proposal = report(arguments, read_ticks(arguments.file))
    except (LogError, ValueError) as error:
        return print_error("calibrate", str(error))
    if proposal and arguments.save is not None:
        try:
            arguments.save.write_text(format_file(proposal), encoding="ascii")
        except OSError as error:
            return print_error("calibrate", f"{arguments.save}: cannot be written: {error.strerror}")
    return code


def _compass(arguments: argparse.Namespace, ticks: Iterable[LoggedTick]) -> tuple[int, Mapping[str, float]]:
    estimator = estimate_deviation(ticks)
    result = estimator.result()
    if arguments.json:
        print(json.dumps(_json_record(estimator, result)))
    else:
        print("\n".join(_report_lines(estimator, result)))
    if result is None or not result.ready:
        return INSUFFICIENT_DATA, {}
    return 0, {name: round(degrees(value), 2) for name, value in zip(NAMES, result.coefficients_rad, strict=True)}


def _json_record(estimator: DeviationEstimator, result: DeviationEstimate | None) -> dict[str, Any]:
    sectors = estimator.state.sectors
    if result is None:
        return {"ready": False, "minutes": 0, "sectors": list(sectors)}
    report = estimator.report()
    return {
        "ready": result.ready,
        "minutes": sum(sectors),
        "sectors": list(sectors),
        "in_force_deg": {name: estimator.parameters[name] for name in NAMES},
        "proposed_deg": _degrees_by_name(result.coefficients_rad),
        "sd_deg": _degrees_by_name(result.sds_rad),
        "worst_sd_deg": round(degrees(result.sd_rad), 3),
        "off_deg": round(degrees(result.off_rad), 3),
        "residual_before_deg": _rounded_deg(report.residual_before_rad),
        "residual_after_deg": _rounded_deg(report.residual_after_rad),
        "mounting_deg": round(_mounting_deg(estimator, result), 3),
    }


def _rounded_deg(residual_rad: float | None) -> float | None:
    return None if residual_rad is None else round(degrees(residual_rad), 3)


def _mounting_deg(estimator: DeviationEstimator, result: DeviationEstimate) -> float:
    """Return the mounting angle (CMP_OFFSET_DEG) that has the effect of coefficient A."""
    return degrees(wrap_pi(radians(estimator.parameters["CMP_OFFSET_DEG"]) + result.coefficients_rad[0]))


def _degrees_by_name(values: Iterable[float]) -> dict[str, float]:
    return {name: round(degrees(value), 3) for name, value in zip(NAMES, values, strict=True)}


def _report_lines(estimator: DeviationEstimator, result: DeviationEstimate | None) -> Iterator[str]:
    sectors = estimator.state.sectors
    covered = sum(minutes > 0 for minutes in sectors)
    yield f"{sum(sectors)} minutes of steady motion in {covered} of {deviation_filter.SECTORS} sectors"
    if result is None:
        yield "no minute with headings and velocity over ground: no estimate"
        return
    yield f"{'':<10} in force  proposed  sd (deg)"
    for name, value, sd in zip(NAMES, result.coefficients_rad, result.sds_rad, strict=True):
        yield f"{name:<10} {estimator.parameters[name]:8.2f}  {degrees(value):8.2f}  {degrees(sd):8.2f}"
    present = read_deviation(estimator.parameters, "CMP")
    yield "compass    in force  proposed"
    for heading_deg in range(0, 360, 45):
        curves = (present, result.coefficients_rad)
        present_deg, proposed_deg = (degrees(deviation_rad(curve, radians(heading_deg))) for curve in curves)
        yield f"{heading_deg:7d}    {present_deg:8.2f}  {proposed_deg:8.2f}"
    max_change_deg, sd_deg = degrees(result.off_rad), degrees(result.sd_rad)
    yield f"error in force up to {max_change_deg:.2f} deg; sd of the proposal up to {sd_deg:.2f} deg"
    report = estimator.report()
    if report.residual_before_rad is not None and report.residual_after_rad is not None:
        present_rms_deg, proposed_rms_deg = degrees(report.residual_before_rad), degrees(report.residual_after_rad)
        yield f"rms residual {present_rms_deg:.1f} deg in force, {proposed_rms_deg:.1f} deg with the proposal"
    offset_deg, mounting_deg = estimator.parameters["CMP_OFFSET_DEG"], _mounting_deg(estimator, result)
    yield f"alignment: CMP_OFFSET_DEG {mounting_deg:.2f} (now {offset_deg:.2f}) acts like CMP_DEV_A; set only one"
    yield from _NOTES
    if not result.ready:
        yield (
            f"not enough data: {deviation_filter.MIN_SECTORS} sectors and an sd of "
            f"{degrees(deviation_filter.MAX_SD_RAD):g} deg needed; sail more courses, 15 min each"
        )
