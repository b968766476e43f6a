"""`rambler calibrate compass`: the compass's deviation as she has sailed it, from her logs; proposed, never set."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from firmware_py.cli.refusal import refused
from firmware_py.common.angles import degrees, radians
from firmware_py.common.intents import SetParameter
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet, format_file
from firmware_py.common.records import Inputs
from firmware_py.core.state_codec import state_from_text
from firmware_py.estimate import declination, position, swing
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.deviation import deviation_rad
from firmware_py.estimate.position import PositionSettings, PositionState
from firmware_py.estimate.swing import Swing, SwingInput, SwingSettings, SwingState
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, read_log

NOT_ENOUGH = 1
SMOOTHING_S = 15.0  # of the compass, to see whether she turns
LONGEST_STEP_S = 2.0
NAMES = tuple(f"CMP_DEV_{letter}" for letter in "ABCDE")
_WHAT_STAYS = (
    "A holds her leeway, too: a bearing of a known mark tells them apart.",
    "A speed that differs by heading by a percent looks like 0.6 deg of B or C.",
)


class Swinging:
    """Feeds the ticks of a voyage to the swing; the parameters are those that were in force."""

    def __init__(self, parameters: ParameterSet) -> None:
        """Begin with nothing seen."""
        self.parameters = parameters
        self.state = SwingState()
        self._settings = SwingSettings.of(parameters)
        self._place = PositionState()
        self._declination = Declination()
        self._smooth = (0.0, 0.0)
        self._heading_s: float | None = None
        self._skipped_s = 0.0  # clocks of several runs, one behind the other
        self._last_s: float | None = None

    def set_parameters(self, parameters: ParameterSet) -> None:
        """Go on with other parameters."""
        if parameters != self.parameters:
            self.parameters = parameters
            self._settings = SwingSettings.of(parameters)

    def take(self, inputs: Inputs) -> None:
        """Take a tick in; one that is earlier than the one before is of another run."""
        now_s = inputs.tick.t_s
        if self._last_s is not None and now_s < self._last_s:
            self._skipped_s += self._last_s - now_s
            self._place, self._heading_s = PositionState(), None
            self.state = swing.without_minute(self.state)
        self._last_s = now_s
        fix = self._place.fix
        for sample in inputs.positions:
            self._place, _ = position.update(self._place, sample, PositionSettings.of(self.parameters).jump_s)
        fix = None if self._place.fix is fix else self._place.fix
        if fix is not None and fix.latitude_rad is not None and fix.longitude_rad is not None:
            self._declination = declination.update(self._declination, fix.latitude_rad, fix.longitude_rad, fix.utc_s)
        for heading in inputs.headings:
            if heading.source == 0 and math.isfinite(heading.heading_rad):
                self._smooth_in(heading.heading_rad, heading.t_s)
        by_model = self._declination.declination_rad if self.parameters["CMP_DECL_AUTO"] == 1 else None
        given = SwingInput(
            headings=inputs.headings,
            declination_rad=radians(self.parameters["CMP_DECL_DEG"]) if by_model is None else by_model,
            fix=fix,
            heading_rad=math.atan2(self._smooth[1], self._smooth[0]),
            water=(0.0, 0.0, self.parameters["CRUISE_SPEED"]),
        )
        self.state = swing.update(self._settings, self.state, given, now_s + self._skipped_s)

    def result(self) -> Swing | None:
        """Return what has been found, None without a minute."""
        return swing.result(self._settings, self.state)

    def _smooth_in(self, heading_rad: float, t_s: float) -> None:
        step_s = LONGEST_STEP_S if self._heading_s is None else min(max(t_s - self._heading_s, 0.0), LONGEST_STEP_S)
        part = 1.0 if self._heading_s is None else -math.expm1(-step_s / SMOOTHING_S)
        north, east = self._smooth
        self._smooth = (north + part * (math.cos(heading_rad) - north), east + part * (math.sin(heading_rad) - east))
        self._heading_s = t_s


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
    return {
        "ready": found.ready,
        "minutes": sum(sectors),
        "sectors": list(sectors),
        "in_force_deg": {name: swinging.parameters[name] for name in NAMES},
        "proposed_deg": _by_name(found.coefficients_rad),
        "sd_deg": _by_name(found.sds_rad),
        "worst_sd_deg": round(degrees(found.sd_rad), 3),
        "off_deg": round(degrees(found.off_rad), 3),
    }


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
    in_force = SwingSettings.of(swinging.parameters).deviation
    yield "compass    in force  proposed"
    for heading_deg in range(0, 360, 45):
        curves = (in_force, found.coefficients_rad)
        before, after = (degrees(deviation_rad(curve, radians(heading_deg))) for curve in curves)
        yield f"{heading_deg:7d}    {before:8.2f}  {after:8.2f}"
    off_deg, sd_deg = degrees(found.off_rad), degrees(found.sd_rad)
    yield f"in force is off by up to {off_deg:.2f} deg; the proposal's sd is up to {sd_deg:.2f} deg"
    yield from _WHAT_STAYS
    if not found.ready:
        yield (
            f"not enough for a proposal: {swing.ENOUGH_SECTORS} parts of the circle and an sd of "
            f"{degrees(swing.ENOUGH_RAD):g} deg; sail more courses, a quarter of an hour each"
        )
