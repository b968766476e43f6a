"""Plain and compiled functions of the numeric core give the same bits: each function, and the closed loop."""

import ast
import inspect
import math
import struct
from enum import IntEnum
from types import ModuleType
from typing import get_args, get_origin, get_type_hints

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import LawSettings
from firmware_py.control.rudder_limit import RudderLimits
from firmware_py.model.heading_estimate import HeadingEstimate
from hil.lab.compiled import compiled
from hil.lab.numeric_core import (
    MODULES,
    angles,
    fixed_gain,
    functions_of,
    heading_filter,
    heading_model,
    heading_tick,
    kt,
    law,
    rudder_limit,
    sample_timeout,
    water,
    water_filter,
    water_results,
)
from support.heading_recording import Sea, draw_recording, filter_rows

EDGES = (
    *(math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, math.pi, -math.pi, math.nextafter(math.pi, 0.0)),
    *(2.0 * math.pi, -2.0 * math.pi, 3.0 * math.pi, 4.0 * math.pi, -1e-17, 5e-324, 1e-300, 1e300),
)
FUNCTIONS = [
    function
    for module in MODULES
    # Other tests compare the filters and functions of arrays over recordings, and those of the tick in the closed loop
    # (tests/process/test_twin.py).
    if module not in {heading_filter, water_filter, water_results, heading_tick, water}
    for function in functions_of(module)
    if heading_model.Floats not in get_type_hints(function).values()
]
STEP_S = 0.1


def draw_argument(kind, rng: np.random.Generator, edge_probability: float):
    """Return a random argument of a type, mostly of a realistic size, sometimes an edge case of floats."""
    if inspect.isclass(kind) and issubclass(kind, IntEnum):
        return list(kind)[rng.integers(len(kind))]
    if kind is int:
        return int(rng.integers(4))
    if get_origin(kind) is tuple:
        return tuple(draw_argument(item, rng, edge_probability) for item in get_args(kind))
    if inspect.isclass(kind) and issubclass(kind, tuple):
        return kind(*(draw_argument(item, rng, edge_probability) for item in get_type_hints(kind).values()))
    if kind is bool:
        return bool(rng.random() < 0.5)
    assert kind is float
    if rng.random() < edge_probability:
        return EDGES[rng.integers(len(EDGES))]
    return float(rng.uniform(-7.0, 7.0) if rng.random() < 0.2 else 10.0 ** rng.uniform(-3.0, 1.0))


def bits(value):
    """Return a result as bytes; all NaN are equal, since IEEE 754 does not define which one an operation returns."""
    if isinstance(value, np.ndarray):
        return bits(tuple(value.ravel()))
    if isinstance(value, tuple):
        return [bits(item) for item in value]
    return "nan" if value != value else struct.pack("<d", value)  # noqa: PLR0124


# The suite compares the other modules in the closed loop only (tests/process/test_twin.py).
IN_SUITE = {
    function
    for module in (angles, sample_timeout, kt, fixed_gain, law, rudder_limit)
    for function in functions_of(module)
}


def is_proof(function) -> bool:
    """Return whether other tests compile the function, in the loop or with another function of its module."""
    others = (other for other in FUNCTIONS if other is not function and other.__module__ == function.__module__)
    return function not in IN_SUITE or any(function.__name__ in other.__code__.co_names for other in others)


@pytest.mark.parametrize(
    "function",
    [pytest.param(function, marks=[pytest.mark.proof] if is_proof(function) else []) for function in FUNCTIONS],
    ids=[f"{function.__module__}.{function.__name__}" for function in FUNCTIONS],
)
def test_plain_and_compiled_function_are_identical_to_the_last_bit(function):
    hints = get_type_hints(function)
    kinds = [hints[name] for name in inspect.signature(function).parameters]
    compiled_function, rng, compared = compiled(function), np.random.default_rng(len(function.__code__.co_code)), 0
    for number in range(1000):
        edge_probability = (0.0, 0.02, 0.2)[number % 3]
        arguments = [draw_argument(kind, rng, edge_probability) for kind in kinds]
        try:
            expected = function(*arguments)
        except (ZeroDivisionError, ValueError, OverflowError):
            continue  # compiled code gives inf or NaN there
        assert bits(compiled_function(*arguments)) == bits(expected), arguments
        compared += 1
    assert compared > 50  # a wave damping ratio above 1 is refused


@compiled
def simulate(settings, limits, model, goal_rad, compass_error_rad, offset_rad, gain_reduction, command_rad):
    """Simulate the K-T boat with observer, control law and rudder limits; compute `command_rad`."""
    psi, r, command, state = 0.0, 0.0, 0.0, law.IDLE
    theta, decay = math.exp(-STEP_S / 1.5), kt.decay_over(STEP_S, model.turning_lag_s)
    heading_rad, rate_rad_s, bias_rad = 0.0, 0.0, 0.0
    for tick in range(command_rad.size):
        measured_rad = angles.wrap_two_pi(psi + compass_error_rad[tick])
        heading_rad, rate_rad_s = fixed_gain.predict(
            heading_rad, rate_rad_s, command, STEP_S, decay, model.turning_ability_1_s, model.turning_lag_s
        )
        heading_rad, rate_rad_s = fixed_gain.correct(heading_rad, rate_rad_s, measured_rad, STEP_S, theta, 0.5)
        bias_rad += 0.001 * (command - bias_rad)
        estimate = HeadingEstimate(heading_rad, 2e-5, rate_rad_s, bias_rad, 0.5 * bias_rad, 0.4, 0.02)
        error_rad = angles.wrap_pi(goal_rad[tick] - heading_rad)
        state, demand_rad = law.steer(settings, state, estimate, error_rad, command, STEP_S, gain_reduction[tick])
        command = rudder_limit.limit_command(limits, command, demand_rad, STEP_S)
        command_rad[tick] = command
        for _ in range(2):
            psi, r = kt.rk4_step(
                psi, r, command, 0.5 * STEP_S, model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2,
                offset_rad[tick],
            )  # fmt: skip


def assert_closed_loop_is_identical(seed: int, ticks: int) -> None:
    """Compare a plain and a compiled run with waves, noise, rudder bias, turns, and a reduced gain in the middle."""
    rng, t_s = np.random.default_rng(seed), np.arange(ticks) * STEP_S
    waves = sum(
        math.radians(size) * np.sin(2.0 * math.pi * t_s / period_s + phase)
        for size, period_s, phase in zip((3.0, 2.0, 1.5), rng.uniform(4.0, 9.0, 3), rng.uniform(0, 6, 3), strict=True)
    )
    compass_error_rad = waves + math.radians(0.3) * rng.standard_normal(ticks)
    goal_rad = np.repeat(rng.uniform(-3.0, 3.0, ticks // 300 + 1), 300)[:ticks]
    offset_rad = 0.1 * np.sin(0.01 * t_s)
    gain_reduction = np.where((t_s > 0.3 * t_s[-1]) & (t_s < 0.6 * t_s[-1]), 4.0, 1.0)
    inputs = (
        LawSettings.of(PARAMETERS), RudderLimits.of(PARAMETERS), kt.OCEAN_RAMBLER,
        *(goal_rad, compass_error_rad, offset_rad, gain_reduction),
    )  # fmt: skip
    compiled_rad, plain_rad = np.zeros(ticks), np.zeros(ticks)
    simulate(*inputs, compiled_rad)
    # Floats of Python, because those of numpy divide by zero without an exception.
    simulate.py_func(*inputs[:3], *(Column(column) for column in inputs[3:]), plain_rad)
    assert np.array_equal(compiled_rad, plain_rad)
    assert np.ptp(compiled_rad) > 0.5


class Column:
    """A column of numbers whose items are floats of Python."""

    def __init__(self, numbers):
        self.numbers, self.size = numbers.tolist(), numbers.size

    def __getitem__(self, number):
        return self.numbers[number]


PARAMETERS = ParameterSet()


def test_closed_loop_is_identical_to_the_last_bit():
    assert_closed_loop_is_identical(1, 3000)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(20))
def test_long_closed_loop_is_identical_to_the_last_bit(seed):
    assert_closed_loop_is_identical(100 + seed, 30_000)


def assert_filter_is_identical(seed: int, seconds: float) -> None:
    """Filter a recording, plain and compiled, with outliers, gaps, delays, a restart and an unknown rudder."""
    t_s, compass_rad, rudder_rad, _ = (column.copy() for column in draw_recording(Sea(), seed, seconds))
    n = t_s.size
    compass_rad[n // 3 : n // 3 + 40] += 2.0
    compass_rad[n // 7], rudder_rad[n // 2 : n // 2 + 60] = math.nan, math.nan
    t_s[n // 5 :] += 30.0
    t_s[n // 4 : n // 4 + 2] -= 1.2
    t_s[-n // 8 :] += 700.0
    filters = filter_rows(t_s, compass_rad, rudder_rad, kt.OCEAN_RAMBLER)
    columns = (Column(t_s), Column(compass_rad), Column(rudder_rad))
    assert bits(filter_rows.py_func(*columns, kt.OCEAN_RAMBLER)) == bits(filters)
    assert filters[0].begun_s > 700.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(10))
def test_heading_filter_is_identical_over_long_recordings_to_the_last_bit(seed):
    assert_filter_is_identical(100 + seed, 5400.0)


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_core_imports_only_the_core_and_uses_no_none(module: ModuleType):
    tree = ast.parse(inspect.getsource(module))
    names = {function.__name__ for function in MODULES} | {
        "__future__",
        "enum",
        "math",
        "typing",
        "numpy",
        "numpy.typing",
        "firmware_py.common.geodesy.EARTH_RADIUS_M",
    }
    for node in tree.body:
        if isinstance(node, ast.Import):
            assert {name.name for name in node.names} <= names
        elif isinstance(node, ast.ImportFrom):
            assert node.module in names or {f"{node.module}.{name.name}" for name in node.names} <= names
        elif isinstance(node, ast.FunctionDef):
            parts = [item for statement in node.body for item in ast.walk(statement)]
            assert not any(isinstance(item, ast.Constant) and item.value is None for item in parts)
