"""A run of a campaign, which depends only on the specification and its number, and the outcome of the run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import index_of
from firmware_py.vehicle import Vehicle
from hil.lab.campaign.draws import Value, blocks, uniform_numbers
from hil.lab.campaign.scores import Scores
from hil.lab.campaign.spec import Spec
from hil.ship import disturbance_options, scenarios
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal, parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.run_file import FINISHED
from hil.sim.vehicle_file import model_of, with_devices

SEED_BITS = 48
# Factors on the model of the ship, and the parameters of the vehicle file that they scale.
MODEL_PARAMETERS = {"K": "MDL_K", "T": "MDL_T_S", "alpha": "MDL_ALPHA_S2"}


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of the drill table, or NO_FAULT, with its start and duration."""

    name: str
    at_s: float
    for_s: float


@dataclass(frozen=True, slots=True)
class Row:
    """A run. `vehicle`: parameters of the simulated ship. `settings`: parameters that the autopilot uses instead.

    `fault` is None in a campaign without faults.
    """

    index: int
    seed: int
    scenario: Scenario
    goals: tuple[Goal, ...]
    seconds: float
    vehicle: Vehicle
    settings: Mapping[str, float]
    fault: Fault | None
    drawn_values: Mapping[str, Value]

    def options(self, out: Path) -> RunOptions:
        """Return the options with which the harness simulates this run into a directory."""
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
    fixed = {name: draw.quantile(0.0) for name, draw in spec.draws.items() if not draw.has_variation}
    numbers_by_name = {name: uniform_numbers(spec.seed, name, first, count) for name in spec.drawn_names}
    for offset, seed in enumerate(seeds):
        drawn_values = {name: spec.draws[name].quantile(numbers[offset]) for name, numbers in numbers_by_name.items()}
        yield _row(spec, first + offset, seed, fixed | drawn_values, drawn_values)


def extremes(spec: Spec) -> Iterator[Row]:
    """Yield two runs for each scenario: one with all other draws at their lower limits, one at their upper limits."""
    for scenario in spec.values("scenario"):
        for limit_index in (0, -1):
            values = {name: draw.limits()[limit_index] for name, draw in spec.draws.items()} | {"scenario": scenario}
            yield _row(spec, 0, 0, values, {})


def _row(spec: Spec, index: int, seed: int, values: Mapping[str, Value], drawn_values: Mapping[str, Value]) -> Row:
    vehicle, settings = _vehicle_and_settings(spec.vehicle, values)
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
        drawn_values,
    )


def _scenario(spec: Spec, values: Mapping[str, Value]) -> Scenario:
    scenario = scenarios.parse_scenario(str(values["scenario"]))
    if spec.options:
        scenario = scenarios.with_disturbances(scenario, ",".join(_option(name, values) for name in spec.options))
    return replace(scenario, speed_m_s=scenario.speed_m_s * float(values.get("ship.speed", 1.0)))


def _option(name: str, values: Mapping[str, Value]) -> str:
    """Return an option in the syntax of `--with`; values that are not drawn have their defaults."""
    return disturbance_options.format_option(
        name, {key: values.get(f"with.{name}.{key}") for key in disturbance_options.number_names(name)}
    )


def _vehicle_and_settings(vehicle: Vehicle, values: Mapping[str, Value]) -> tuple[Vehicle, dict[str, float]]:
    """Return the vehicle with the scaled model of the ship, and the parameters of the autopilot."""
    settings: dict[str, float] = {}
    factors = {name: float(values[f"ship.{name}"]) for name in MODEL_PARAMETERS if f"ship.{name}" in values}
    if factors:
        model = model_of(vehicle)
        model_values = dict(
            zip(MODEL_PARAMETERS, (model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2), strict=True)
        )
        ship_parameters = {MODEL_PARAMETERS[name]: model_values[name] * factor for name, factor in factors.items()}
        settings = {name: vehicle.parameters.get(name, TABLE[index_of(name)].default) for name in ship_parameters}
        vehicle = msgspec.structs.replace(vehicle, parameters={**vehicle.parameters, **ship_parameters})
    for name, value in values.items():
        if name.startswith("set."):
            parameter = name.removeprefix("set.")
            settings[parameter] = TABLE[index_of(parameter)].check(float(value))
    return vehicle, settings


def _fault(values: Mapping[str, Value]) -> Fault | None:
    if "fault.what" not in values:
        return None
    return Fault(str(values["fault.what"]), float(values["fault.at_s"]), float(values["fault.for_s"]))


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a run; `digest` is the digest of truth.csv or, with the compiled engine, of heading and rudder.

    `faults`: warnings of the autopilot, None for an engine without warnings. `scores`: None if the run ended early or
    no goal was steady. `ended`: FINISHED, or the error that ended the run early.
    """

    digest: str
    scores: Scores | None
    faults: tuple[str, ...] | None = None
    ended: str = FINISHED


def failure(outcome: Outcome, limits: Mapping[str, float]) -> str:
    """Return the reason why a run counts as failed, or an empty text."""
    if outcome.ended != FINISHED:
        return outcome.ended
    if outcome.scores is None:
        return "no goal lasted" if limits else ""
    values = {name: getattr(outcome.scores, name) for name in limits}
    # NaN counts as a failure.
    exceeded = [name for name, value in values.items() if not abs(value) <= limits[name]]
    return ", ".join(f"{name} {_score_text(values[name])}" for name in exceeded)


def _score_text(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "never"


@dataclass(frozen=True, slots=True)
class Result:
    """A run and its outcome."""

    row: Row
    outcome: Outcome
