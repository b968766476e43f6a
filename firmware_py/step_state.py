"""The state between ticks as text and back, bit for bit: the checkpoints of the log."""

from __future__ import annotations

from typing import Any

from firmware_py.params import TABLE, ParameterError, ParameterSet
from firmware_py.plain import Codec, Hook
from firmware_py.plan import HOOK as PLAN_HOOK
from firmware_py.step import State


def _parameters_from(data: Any) -> ParameterSet:
    """Read a full set of this version's parameters; ValueError for any other."""
    if not isinstance(data, dict) or list(data) != [row.name for row in TABLE]:
        raise ValueError("the parameters are those of another version of the autopilot")
    parameters = ParameterSet()
    for name, value in data.items():
        if type(value) not in (int, float):
            raise ValueError(f"{name}: expected a number")
        try:
            parameters = parameters.replaced(name, value)
        except ParameterError as error:
            raise ValueError(str(error)) from None
    return parameters


_PARAMETER_HOOK = Hook(ParameterSet, lambda parameters: dict(parameters.items()), _parameters_from)
_CODEC = Codec([State], [_PARAMETER_HOOK, PLAN_HOOK])


def state_to_text(state: State) -> str:
    """Write a state as one line of text."""
    return _CODEC.to_text(state)


def state_from_text(text: str) -> State:
    """Read a state; ValueError for text of another version."""
    state: State = _CODEC.from_text(text)
    return state
