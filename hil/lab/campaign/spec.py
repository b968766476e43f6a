"""Specification of a campaign, read from a TOML file; reading reports all errors at once."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE as PARAMETERS
from firmware_py.common.parameters import index_of
from firmware_py.files.reading import read_regular
from firmware_py.vehicle import Vehicle
from hil.errors import UsageError
from hil.lab.campaign.draws import Draw, DrawError, Value, read_draw
from hil.lab.campaign.scores import SCORE_NAMES
from hil.ship import disturbance_options, scenarios
from hil.sim.device_factory import COMPASSES, SERVOS
from hil.sim.goals import GoalError, parse_goals
from hil.sim.vehicle_file import load, standard_vehicle

MAX_BYTES = 1 << 20
MAX_RUNS = 10_000_000
MAX_SECONDS = 1e6
FIRMWARE, COMPILED = "firmware", "compiled"
ENGINES = (FIRMWARE, COMPILED)
FORMER_ENGINES = {"twin": COMPILED}
# Factors on the model of the simulated ship, which the autopilot does not know, and on the speed of the scenario.
SHIP_FACTORS = ("K", "T", "alpha", "speed")
FACTOR_RANGE = (0.1, 10.0)
NO_FAULT = "none"
FAULT_TIME_DEFAULTS_S = {"at_s": None, "for_s": 30.0}  # None: required
KEYS = (
    "engine", "runs", "seed", "seconds", "goals", "scenarios", "compass", "servo", "vehicle", "ship", "with", "set",
    "fault", "fail",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Spec:
    """Specification of a campaign; `draws` contains the draw of each value by a name such as "with.leeway.body_deg".

    `options`: the `--with` options of every run. `limits`: largest magnitude of each score of a run that passes.
    `digest`: of the content without comments. `text`: the whole file. `notes`: messages to the operator.
    """

    engine: str
    runs: int
    seed: int
    seconds: float
    draws: Mapping[str, Draw]
    options: tuple[str, ...]
    limits: Mapping[str, float]
    vehicle: Vehicle
    digest: str
    notes: tuple[str, ...] = ()
    text: str = ""

    @property
    def drawn_names(self) -> tuple[str, ...]:
        """Return the sorted names of the values that differ between runs."""
        return tuple(sorted(name for name, draw in self.draws.items() if draw.has_variation))

    def values(self, name: str) -> tuple[Value, ...]:
        """Return the choices or limits of a draw; empty for an unknown name."""
        return self.draws[name].limits() if name in self.draws else ()


Refusals = Callable[[Spec], list[str]]


def read_spec_file(path: Path, faults: tuple[str, ...], refusals: Refusals, beside: Path | None = None) -> Spec:
    """Read a specification, or raise UsageError with a line for each error.

    `faults`: names of the known faults. `refusals` returns a line for each item that the engine does not support.
    The path of a vehicle file is relative to the directory `beside`, by default that of the specification.
    """
    try:
        text = read_regular(path, MAX_BYTES).decode()
        content = tomllib.loads(text)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}; give the TOML file of a campaign") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not a TOML file: {error}") from None
    try:
        return replace(parse(content, faults, refusals, beside or path.parent), text=text)
    except SpecError as error:
        raise UsageError("\n".join(f"{path}: {line}" for line in error.problems)) from None


class SpecError(ValueError):
    """An invalid specification; `problems` has a line for each error."""

    def __init__(self, problems: list[str]) -> None:
        """Store the lines."""
        super().__init__("\n".join(problems))
        self.problems = problems


def parse(content: Mapping[str, Any], faults: tuple[str, ...], refusals: Refusals, beside: Path = Path()) -> Spec:
    """Parse the content of a specification, or raise SpecError; `beside` is the directory of the vehicle file."""
    reader = _Reader(content, faults, beside)
    spec = reader.spec()
    problems = reader.problems + (refusals(spec) if spec.engine in ENGINES else [])
    if problems:
        raise SpecError(problems)
    return spec


@dataclass(slots=True)
class _Reader:
    content: Mapping[str, Any]
    faults: tuple[str, ...]
    beside: Path
    problems: list[str] = field(default_factory=list)
    draws: dict[str, Draw] = field(default_factory=dict)

    def spec(self) -> Spec:
        self._known("", self.content, KEYS)
        engine, notes = self._engine()
        if engine not in ENGINES:
            self._problem("engine", f"{str(engine)[:30]!r}; give {' or '.join(map(repr, ENGINES))}")
        seconds = self._number("seconds", 10.0, MAX_SECONDS)
        vehicle = self._vehicle()
        self._draw("scenario", self.content.get("scenarios", []), _check_scenario, "scenarios")
        self._draw("goals", self.content.get("goals", "0:0"), lambda text: _check_goals(text, seconds))
        for name, devices in (("compass", COMPASSES), ("servo", SERVOS)):
            if name in self.content:
                self._draw(name, self.content[name], _one_of(devices))
        for name, value in self._table("ship", SHIP_FACTORS).items():
            self._draw(f"ship.{name}", value, _within(*FACTOR_RANGE))
        options = tuple(self._option(name, value) for name, value in self._table("with").items())
        for name, value in self._table("set").items():
            self._draw(f"set.{name}", value, partial(_check_parameter, name))
        self._fault(seconds)
        limits = {name: self._limit(name, value) for name, value in self._table("fail", SCORE_NAMES).items()}
        text = json.dumps([self.content, repr(vehicle)], sort_keys=True, default=str)
        return Spec(
            str(engine),
            int(self._number("runs", 1, MAX_RUNS, whole=True)),
            int(self._number("seed", 0, 2**63, default=1, whole=True)),
            seconds,
            self.draws,
            tuple(name for name in options if name),
            limits,
            vehicle,
            hashlib.sha256(text.encode()).hexdigest(),
            notes,
        )

    def _engine(self) -> tuple[Any, tuple[str, ...]]:
        """Return the present name of the engine, and a note if the specification uses a former name."""
        name = self.content.get("engine")
        current_name = FORMER_ENGINES.get(name) if isinstance(name, str) else None
        if current_name is None:
            return name, ()
        return current_name, (f'engine: "{name}" is the old name of "{current_name}"; both select the same engine',)

    def _problem(self, where: str, text: object) -> None:
        line = " ".join(f"{where}: {text}".split())
        self.problems.append("".join(character if character.isprintable() else "?" for character in line))

    def _known(self, where: str, names: Mapping[str, Any], known_keys: tuple[str, ...]) -> None:
        for name in names:
            if name not in known_keys:
                self._problem(f"{where}{name[:40]}", f"unknown key; use one of {', '.join(known_keys)}")

    def _table(self, name: str, known_keys: tuple[str, ...] = ()) -> Mapping[str, Any]:
        value = self.content.get(name, {})
        if not isinstance(value, dict):
            self._problem(name, f"must be a table, [{name}]")
            return {}
        if known_keys:
            self._known(f"{name}.", value, known_keys)
        return {key: content for key, content in value.items() if not known_keys or key in known_keys}

    def _number(
        self, name: str, low: float, high: float, *, default: float | None = None, whole: bool = False
    ) -> float:
        value = self.content.get(name, default)
        types = (int,) if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, types) or not low <= value <= high:
            problem = "is missing" if value is None else f"{value!r:.40} is not allowed"
            self._problem(name, f"{problem}; give a {'whole ' if whole else ''}number from {low:g} to {high:g}")
            return high
        return value

    def _draw(self, name: str, content: Any, check: Callable[[Value], object], label: str = "") -> None:
        try:
            self.draws[name] = read_draw(content, check)
        except DrawError as error:
            self._problem(label or name, error)

    def _vehicle(self) -> Vehicle:
        name = self.content.get("vehicle")
        if name is None:
            return standard_vehicle()
        try:
            return load(self.beside / str(name))
        except UsageError as error:
            for line in str(error).splitlines():
                self._problem("vehicle", line)
            return standard_vehicle()

    def _option(self, name: str, content: Any) -> str:
        """Read a disturbance option: true, the first number, or a table of numbers by name; return its name."""
        row = disturbance_options.BY_NAME.get(name)
        if row is None:
            self._problem(f"with.{name[:40]}", f"unknown option; use one of {', '.join(disturbance_options.BY_NAME)}")
            return ""
        option_fields = {option_field.name: option_field for option_field in fields(row.record)}
        named = isinstance(content, dict) and bool(content.keys() & option_fields.keys())
        numbers = content if named else {} if content is True else {next(iter(option_fields)): content}
        self._known(f"with.{name}.", numbers, tuple(option_fields))
        for key, value in numbers.items():
            if key in option_fields:
                self._draw(f"with.{name}.{key}", value, _check_option(option_fields[key]))
        for key in disturbance_options.required_numbers(row):
            if key not in numbers:
                self._problem(f"with.{name}", f"{key} has no default; give a value")
        return name

    def _fault(self, seconds: float) -> None:
        table = self._table("fault", ("what", *FAULT_TIME_DEFAULTS_S))
        if not table:
            return
        self._draw("fault.what", table.get("what", []), _one_of((NO_FAULT, *self.faults)))
        for name, default in FAULT_TIME_DEFAULTS_S.items():
            self._draw(f"fault.{name}", table.get(name, default), _within(0.0, seconds))

    def _limit(self, name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0.0:
            self._problem(f"fail.{name}", f"{str(value)[:40]} is not a limit; give the largest value that passes")
            return 0.0
        return float(value)


def _one_of(known_names: Any) -> Callable[[Value], None]:
    def check(value: Value) -> None:
        if value not in known_names:
            raise ValueError(f"{str(value)[:40]!r} is unknown; use one of {', '.join(known_names)}")

    return check


def _within(low: float, high: float) -> Callable[[Value], None]:
    def check(value: Value) -> None:
        if isinstance(value, str) or not low <= value <= high:
            raise ValueError(f"{str(value)[:40]} is not a number from {low:g} to {high:g}")

    return check


def _check_scenario(value: Value) -> None:
    scenarios.parse_scenario(str(value))


def _check_goals(value: Value, seconds: float) -> None:
    if any(goal.t_s > seconds - 1.0 for goal in parse_goals(str(value))):
        raise GoalError(f"a goal of {str(value)[:60]!r} is later than the end at {seconds:g} s")


def _check_parameter(name: str, value: Value) -> None:
    row = PARAMETERS[index_of(name)]
    if isinstance(value, str):
        raise ParameterError(f"{value[:30]!r} is not a number; allowed: {row.allowed_values()}")
    row.check(value)


def _check_option(option_field: Any) -> Callable[[Value], None]:
    if "choices" in option_field.metadata:
        return _one_of(option_field.metadata["choices"])
    return _within(option_field.metadata["low"], option_field.metadata["high"])
