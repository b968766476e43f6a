"""Read the ticks of logs, and track the parameters in force and the arming state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from firmware_py.common.intents import Arm, SetParameter
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet
from firmware_py.core.state_codec import state_from_text
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, read_log


def read_ticks(paths: Iterable[Path]) -> Iterator[LoggedTick]:
    """Yield the ticks of all logs in order; raise LogError with the name of the log."""
    for path in paths:
        try:
            yield from read_log(path)
        except LogError as error:
            raise LogError(f"{path}: {error}") from error


def track_parameters(ticks: Iterable[LoggedTick]) -> Iterator[tuple[LoggedTick, ParameterSet, bool]]:
    """Yield each tick with the parameters in force and whether the boat is armed.

    Assume that the autopilot accepted every request; ignore parameters that this version does not know. Raise
    ValueError for an unreadable checkpoint.
    """
    parameters, is_armed = ParameterSet(), False
    for tick in ticks:
        if tick.checkpoint is not None:
            try:
                state = state_from_text(tick.checkpoint)[0]
            except ValueError as error:
                raise ValueError(f"a checkpoint in the log cannot be read ({error})") from error
            parameters, is_armed = state.parameters, state.modes.armed
        for request in tick.inputs.requests:
            if isinstance(request.intent, SetParameter):
                parameters = _set_parameter(parameters, request.intent)
            elif isinstance(request.intent, Arm):
                is_armed = request.intent.armed
        yield tick, parameters, is_armed


def _set_parameter(parameters: ParameterSet, intent: SetParameter) -> ParameterSet:
    try:
        return parameters.replaced(intent.name, intent.value)
    except ParameterError:  # a parameter of another version
        return parameters
