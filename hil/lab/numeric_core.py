"""Register the numeric core of the firmware with numba, so that compiled code of the laboratory can call it.

The control law, the estimators, the monitors and the K-T equation exist once, in firmware_py, as functions of floats
and NamedTuples without None and without I/O. This module registers them with numba. No other module of `hil` except
estimate/tick.py imports control, estimators and monitors (import contract `seam`). A kernel calls a function of the
core, and numba compiles it with the kernel:

    from hil.lab.compiled import compiled
    from hil.lab.numeric_core import law

    @compiled
    def kernel(...): ... law.steer(...) ...

The functions remain plain functions for Python. Compiled arithmetic is that of Python: no fast-math and no fused
multiply-add, so that both agree to the last bit (tests/unit/hil/lab/test_numeric_core.py). Division by zero gives inf
or NaN as in C; Python raises ZeroDivisionError.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import FunctionType, ModuleType
from typing import Any, Final, TypeVar

from numba.extending import register_jitable

from firmware_py.common import angles, sample_timeout
from firmware_py.control import law, rudder_limit
from firmware_py.control.law import Gains, LawConstants, LawSettings
from firmware_py.estimate import (
    delay_test,
    fixed_gain,
    heading_filter,
    heading_model,
    heading_tick,
    prediction_check,
    sources,
    water,
    water_filter,
    water_results,
)
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.estimate.heading_tick import HeadingSettings
from firmware_py.model import heading_estimate, kt
from firmware_py.safety import convergence, oscillation, steering_loss, steering_monitor, steering_reversal

__all__ = [
    "ERROR_MODEL", "MODULES", "Gains", "HeadingSettings", "LawConstants", "LawSettings", "Motion", "NoiseLevels",
    "angles", "convergence", "delay_test", "fixed_gain", "functions_of", "heading_estimate", "heading_filter",
    "heading_model", "heading_tick", "inner", "kt", "law", "oscillation", "prediction_check", "rudder_limit",
    "sample_timeout", "sources", "steering_loss", "steering_monitor", "steering_reversal",
    "water", "water_filter", "water_results",
]  # fmt: skip

Function = TypeVar("Function", bound=Callable[..., Any])

ERROR_MODEL: Final = "numpy"
MODULES: Final = (
    angles, sample_timeout, kt, heading_estimate, fixed_gain, sources, heading_model, heading_filter,
    prediction_check, delay_test, water_filter, water_results, water, heading_tick, law, rudder_limit, oscillation,
    convergence, steering_loss, steering_reversal, steering_monitor,
)  # fmt: skip


def inner(function: Function) -> Function:
    """Make a plain function callable from compiled code; it remains a plain function for Python.

    Without numba's wrappers for calls from Python and C, it compiles faster than a function that is `compiled`.
    """
    return register_jitable(error_model=ERROR_MODEL, no_cfunc_wrapper=True)(function)


def functions_of(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions that a module defines."""
    for value in vars(module).values():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__:
            yield value


for _module in MODULES:
    for _function in functions_of(_module):
        inner(_function)
