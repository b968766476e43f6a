"""The ticks of logs, with the parameters that were in force and whether she was armed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from firmware_py.common.intents import Arm, SetParameter
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet
from firmware_py.core.state_codec import state_from_text
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, read_log


def ticks_of(paths: Iterable[Path]) -> Iterator[LoggedTick]:
    """Yield the ticks of logs, one behind the other; LogError names the log."""
    for path in paths:
        try:
            yield from read_log(path)
        except LogError as error:
            raise LogError(f"{path}: {error}") from error


def in_force(ticks: Iterable[LoggedTick]) -> Iterator[tuple[LoggedTick, ParameterSet, bool]]:
    """Yield each tick with the parameters in force, and whether she was armed; ValueError for an unreadable checkpoint.

    What was asked for counts as accepted, but for parameters that this version does not know.
    """
    parameters, armed = ParameterSet(), False
    for tick in ticks:
        if tick.checkpoint is not None:
            try:
                state = state_from_text(tick.checkpoint)[0]
            except ValueError as error:
                raise ValueError(f"a state in the log cannot be read ({error})") from error
            parameters, armed = state.parameters, state.modes.armed
        for request in tick.inputs.requests:
            if isinstance(request.intent, SetParameter):
                parameters = _with(parameters, request.intent)
            elif isinstance(request.intent, Arm):
                armed = request.intent.armed
        yield tick, parameters, armed


def _with(parameters: ParameterSet, intent: SetParameter) -> ParameterSet:
    try:
        return parameters.replaced(intent.name, intent.value)
    except ParameterError:  # of another version
        return parameters
