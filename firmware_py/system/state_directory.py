"""What earlier runs have left in the store: parameters, plans, the resume record. What cannot be used is told."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

from firmware_py.common.interfaces import Clock
from firmware_py.common.parameters import ParameterError, parse_file
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.core.resume import RESUME_FILE, restore
from firmware_py.core.step import State
from firmware_py.loop import PARAMETER_FILE, PLAN_FILES
from firmware_py.plans.validation import problem_of
from firmware_py.system.store import Store

_LINE = re.compile(r"([A-Z][A-Z0-9_]{0,15}) (-?[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?)")


def stored_parameters(store: Store, say: Callable[[str], None]) -> tuple[dict[str, float], dict[str, float]]:
    """The values that ground stations have set in earlier runs, and those that this version cannot use.

    The latter are told. They stay in the store for the version that knows them, until all are forgotten or
    the parameter is set anew; a line that is no name and value is told and left out for good.
    """
    content = store.load(PARAMETER_FILE)
    values: dict[str, float] = {}
    unusable: dict[str, float] = {}
    if content is None:
        return values, unusable
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), start=1):
        try:
            values.update(parse_file(line, f"{PARAMETER_FILE} line {number}"))
        except ParameterError as error:
            name, value = _name_and_value(line)
            if name:
                unusable[name] = value
            say(f"stored parameter left out{', and kept for another version' if name else ''}: {error}")
    return values, {name: value for name, value in unusable.items() if name not in values}


def _name_and_value(line: str) -> tuple[str, float]:
    """Split a stored line; an empty name for what may not be the parameter of another version."""
    match = _LINE.fullmatch(line)
    value = float(match[2]) if match else math.nan
    return (match[1], value) if match and math.isfinite(value) else ("", value)


def _checked_plan(kind: PlanKind, text: str) -> tuple[Plan, tuple[str, ...]]:
    plan, notes = plan_from_text(text)
    if plan.kind is not kind:
        raise ValueError(f"it is a {plan.kind.name.lower()}")
    if fault := problem_of(plan):
        raise ValueError(str(fault))
    return plan, notes


def stored_plans(store: Store, say: Callable[[str], None]) -> Plans:
    """The plans of earlier runs; an unusable one is told and left out."""
    plans = Plans()
    for kind, name in PLAN_FILES.items():
        content = store.load(name)
        if content is None:
            continue
        try:
            plan, notes = _checked_plan(kind, content.decode("ascii", "replace"))
        except ValueError as error:
            say(f"stored {name} left out: {error}")
            continue
        plans = plans.replaced(plan)
        for note in notes:
            say(f"stored {name}: {note}")
    return plans


def with_resume(state: State, store: Store, clock: Clock, say: Callable[[str], None]) -> State:
    """The state at start, going on with what the store holds; an unusable record is told and left out."""
    content = store.load(RESUME_FILE)
    if content is None:
        return state
    try:
        state, notes = restore(state, content.decode("ascii", "replace"), clock.utc_s())
    except ValueError as error:
        say(f"stored {RESUME_FILE} left out: {error}")
        return replace(state, greeting="Not resumed: the record is no good")
    for note in notes:
        say(f"stored {RESUME_FILE}: {note}")
    return state
