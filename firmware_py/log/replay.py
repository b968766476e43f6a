"""Recomputes a log through the step that made it, and compares every rudder command bit by bit."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from firmware_py.common.records import Inputs, RudderCommand
from firmware_py.common.reports import Output
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, LogReader, Reading

State = TypeVar("State")


class CheckpointError(LogError):
    """The state that a log begins with cannot be read."""


class Difference(msgspec.Struct, frozen=True):
    """A tick whose recomputed command is not the logged one."""

    tick: int
    t_s: float
    logged: RudderCommand
    recomputed: RudderCommand


class ReplayReport(msgspec.Struct, frozen=True):
    """What a replay found.

    `ticks` are in the log, `compared` of them could be recomputed: after a `gap` that
    follows on no checkpoint the state is not known. `largest_rad` is the largest difference of
    a shaft angle, infinite where one is no number. `reading` tells of damage.
    """

    ticks: int
    compared: int
    gaps: int
    differences: int
    first_difference: Difference | None
    largest_rad: float
    reading: Reading

    @property
    def identical(self) -> bool:
        """Whether every command of the log was recomputed, to the same bits."""
        return self.differences == 0 and self.compared == self.ticks and self.reading.damaged == 0

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON data; the bits of a command are its double in hexadecimal."""
        first = self.first_difference
        return {
            "identical": self.identical,
            "ticks": self.ticks,
            "compared": self.compared,
            "gaps": self.gaps,
            "differences": self.differences,
            "first_difference": None
            if first is None
            else {
                "tick": first.tick,
                "t_s": first.t_s,
                "logged": _command_data(first.logged),
                "recomputed": _command_data(first.recomputed),
            },
            "largest_rad": self.largest_rad if math.isfinite(self.largest_rad) else None,
            **{field.name: getattr(self.reading, field.name) for field in msgspec.structs.fields(Reading)},
        }


def replay(
    ticks: Iterable[LoggedTick],
    restore: Callable[[str], tuple[State, tuple[str, ...]]],
    step: Callable[[State, Inputs], tuple[State, Output]],
) -> ReplayReport:
    """Recompute ticks from their checkpoints and compare the commands.

    `restore` returns a state and what is to be noted of it. Raises LogError when there is no
    tick, no checkpoint, one that `restore` refuses with ValueError, or a tick that `step` fails at.
    """
    count = compared = gaps = differences = 0
    first: Difference | None = None
    largest_rad = 0.0
    known_state: tuple[State] | None = None
    all_notes: dict[str, None] = {}
    for tick in ticks:
        count += 1
        gaps += tick.gap
        if tick.checkpoint is not None:
            restored, notes = _restored(tick.checkpoint, restore)
            known_state = (restored,)
            all_notes.update(dict.fromkeys(notes))
        elif tick.gap:
            known_state = None
        if known_state is None:
            continue
        state, output = _step_or_refuse(known_state[0], tick.inputs, step)
        known_state = (state,)
        compared += 1
        if _bits(output.command) != _bits(tick.command):
            differences += 1
            off_rad = abs(output.command.shaft_rad - tick.command.shaft_rad)
            largest_rad = max(largest_rad, math.inf if math.isnan(off_rad) else off_rad)
            if first is None:
                first = Difference(tick.inputs.tick.index, tick.inputs.tick.t_s, tick.command, output.command)
    if count == 0:
        raise LogError("no whole tick in it: give an onboard log (.BIN) that has run for a second or more")
    if compared == 0:
        raise LogError("no checkpoint in it: give the file from its first byte on, replay begins at a stored state")
    reading = Reading(ticks=count, notes=tuple(all_notes))
    return ReplayReport(count, compared, gaps, differences, first, largest_rad, reading)


def replay_log(
    source: Path | bytes,
    restore: Callable[[str], tuple[State, tuple[str, ...]]],
    step: Callable[[State, Inputs], tuple[State, Output]],
) -> ReplayReport:
    """Replay one log file; LogError as `replay` and when the file cannot be read, with its name."""
    reader = LogReader(source)
    try:
        report = replay(reader, restore, step)
    except LogError as error:
        remedy = ""
        if isinstance(error, CheckpointError):
            remedy = f": replay it with the version of rambler that wrote it ({reader.reading.software or 'not named'})"
        raise LogError((f"{source}: {error}" if isinstance(source, Path) else str(error)) + remedy) from error
    notes = (*report.reading.notes, *reader.reading.notes)
    return msgspec.structs.replace(report, reading=msgspec.structs.replace(reader.reading, notes=notes))


def _step_or_refuse(
    state: State, inputs: Inputs, step: Callable[[State, Inputs], tuple[State, Output]]
) -> tuple[State, Output]:
    try:
        return step(state, inputs)
    except Exception as error:  # a log may hold numbers that no boat has seen
        tick = inputs.tick.index
        raise LogError(f"tick {tick} cannot be recomputed ({type(error).__name__}: {error})") from error


def _restored(text: str, restore: Callable[[str], tuple[State, tuple[str, ...]]]) -> tuple[State, tuple[str, ...]]:
    try:
        return restore(text)
    except ValueError as error:
        raise CheckpointError(f"checkpoint refused ({error})") from error


def _bits(command: RudderCommand) -> tuple[bytes, bool]:
    """Return what must be equal: -0.0 is not 0.0 here, and a NaN is itself."""
    return struct.pack("<d", command.shaft_rad), command.torque_on


def _command_data(command: RudderCommand) -> dict[str, Any]:
    return {
        "shaft_rad": command.shaft_rad if math.isfinite(command.shaft_rad) else None,
        "shaft_bits": struct.pack(">d", command.shaft_rad).hex(),
        "torque_on": command.torque_on,
    }
