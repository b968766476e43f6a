"""A run of a campaign: all that it is sailed with, a pure function of the specification and its number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import index_of
from firmware_py.vehicle import Vehicle
from hil.lab.campaign.draws import Value, blocks, shares
from hil.lab.campaign.spec import Spec
from hil.ship import extras_table, scenarios
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal, parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.vehicle_file import model_of, with_devices

SEED_BITS = 48
# Of the ship's factors, those on the model, and how the model's numbers are called in a vehicle file.
MODEL = {"K": "MDL_K", "T": "MDL_T_S", "alpha": "MDL_ALPHA_S2"}


@dataclass(frozen=True, slots=True)
class Fault:
    """A drill of the book, or NO_FAULT, that is begun at a time and mended after a while."""

    name: str
    at_s: float
    for_s: float


@dataclass(frozen=True, slots=True)
class Row:
    """A run; the vehicle's parameters are those of the ship, over which the settings are what the boat is told.

    `fault` is None in a campaign without any.
    """

    index: int
    seed: int
    scenario: Scenario
    goals: tuple[Goal, ...]
    seconds: float
    vehicle: Vehicle
    settings: Mapping[str, float]
    fault: Fault | None
    drawn: Mapping[str, Value]

    def options(self, out: Path) -> RunOptions:
        """Return how the harness makes this run into a directory."""
        return RunOptions(
            self.scenario,
            self.seconds,
            out,
            seed=self.seed,
            goals=self.goals,
            vehicle=self.vehicle,
            settings=dict(self.settings),
        )


def rows(spec: Spec, first: int, last: int) -> Iterator[Row]:
    """Yield the runs [first, last)."""
    count = last - first
    seeds = (blocks(spec.seed, "seed", first, count) >> (64 - SEED_BITS)).tolist()
    fixed = {name: draw.at(0.0) for name, draw in spec.draws.items() if not draw.varies}
    varied = {name: shares(spec.seed, name, first, count) for name in spec.drawn}
    for number, seed in enumerate(seeds):
        drawn = {name: spec.draws[name].at(numbers[number]) for name, numbers in varied.items()}
        yield _row(spec, first + number, seed, fixed | drawn, drawn)


def extremes(spec: Spec) -> Iterator[Row]:
    """Yield a run in each scenario with everything else at its least, and one with everything at its largest."""
    for scenario in spec.values("scenario"):
        for end in (0, -1):
            values = {name: draw.ends()[end] for name, draw in spec.draws.items()} | {"scenario": scenario}
            yield _row(spec, 0, 0, values, {})


def _row(spec: Spec, index: int, seed: int, values: Mapping[str, Value], drawn: Mapping[str, Value]) -> Row:
    vehicle, settings = _told(spec.vehicle, values)
    compass, servo = (str(values[name]) if name in values else None for name in ("compass", "servo"))
    return Row(
        index,
        seed,
        _scenario(spec, values),
        parse_goals(str(values["goals"])),
        spec.seconds,
        with_devices(vehicle, compass, servo),
        settings,
        _fault(values),
        drawn,
    )


def _scenario(spec: Spec, values: Mapping[str, Value]) -> Scenario:
    scenario = scenarios.sea_of(str(values["scenario"]))
    if spec.options:
        scenario = scenarios.with_extras(scenario, ",".join(_option(name, values) for name in spec.options))
    return replace(scenario, speed_m_s=scenario.speed_m_s * float(values.get("ship.speed", 1.0)))


def _option(name: str, values: Mapping[str, Value]) -> str:
    """Write an option as `--with` has it, with the defaults where nothing is given."""
    return extras_table.written(name, {key: values.get(f"with.{name}.{key}") for key in extras_table.numbers(name)})


def _told(vehicle: Vehicle, values: Mapping[str, Value]) -> tuple[Vehicle, dict[str, float]]:
    """Return the vehicle with another ship, which she is not told of, and the parameters that she is told."""
    settings: dict[str, float] = {}
    factors = {name: float(values[f"ship.{name}"]) for name in MODEL if f"ship.{name}" in values}
    if factors:
        model = model_of(vehicle)
        true = dict(zip(MODEL, (model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2), strict=True))
        ship = {MODEL[name]: true[name] * factor for name, factor in factors.items()}
        settings = {name: vehicle.parameters.get(name, TABLE[index_of(name)].default) for name in ship}
        vehicle = msgspec.structs.replace(vehicle, parameters={**vehicle.parameters, **ship})
    for name, value in values.items():
        if name.startswith("set."):
            parameter = name.removeprefix("set.")
            settings[parameter] = TABLE[index_of(parameter)].check(float(value))
    return vehicle, settings


def _fault(values: Mapping[str, Value]) -> Fault | None:
    if "fault.what" not in values:
        return None
    return Fault(str(values["fault.what"]), float(values["fault.at_s"]), float(values["fault.for_s"]))
