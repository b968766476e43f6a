"""Recomputes a log with the step function and compares every rudder command bit by bit."""

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
    """The checkpoint of a log cannot be read."""


class Difference(msgspec.Struct, frozen=True):
    """A tick whose recomputed command differs from the logged one."""

    tick: int
    t_s: float
    logged: RudderCommand
    recomputed: RudderCommand


class ReplayReport(msgspec.Struct, frozen=True):
    """The result of a replay.

    `ticks` is the number of ticks in the log, `compared` the number of recomputed ticks: after a gap the state is
    unknown until the next checkpoint. `largest_rad` is the largest difference of shaft angles, infinite if one is NaN.
    `reading` reports damage of the log.
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
        """Whether every command of the log was recomputed with identical bits."""
        return self.differences == 0 and self.compared == self.ticks and self.reading.damaged == 0

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON data; `shaft_bits` is the angle as a big-endian double in hexadecimal."""
        difference = self.first_difference
        return {
            "identical": self.identical,
            "ticks": self.ticks,
            "compared": self.compared,
            "gaps": self.gaps,
            "differences": self.differences,
            "first_difference": None
            if difference is None
            else {
                "tick": difference.tick,
                "t_s": difference.t_s,
                "logged": _command_as_dict(difference.logged),
                "recomputed": _command_as_dict(difference.recomputed),
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

    `restore` converts a checkpoint to a state and notes. Raises LogError if there is no tick or no checkpoint, if
    `restore` raises ValueError, or if `step` raises any exception.
    """
    count = compared = gaps = differences = 0
    first_difference: Difference | None = None
    largest_rad = 0.0
    current_state: tuple[State] | None = None
    all_notes: dict[str, None] = {}
    for tick in ticks:
        count += 1
        gaps += tick.gap
        if tick.checkpoint is not None:
            restored, notes = _restore_checkpoint(tick.checkpoint, restore)
            current_state = (restored,)
            all_notes.update(dict.fromkeys(notes))
        elif tick.gap:
            current_state = None
        if current_state is None:
            continue
        state, output = _recompute_tick(current_state[0], tick.inputs, step)
        current_state = (state,)
        compared += 1
        if _command_bits(output.command) != _command_bits(tick.command):
            differences += 1
            difference_rad = abs(output.command.shaft_rad - tick.command.shaft_rad)
            largest_rad = max(largest_rad, math.inf if math.isnan(difference_rad) else difference_rad)
            if first_difference is None:
                first_difference = Difference(
                    tick.inputs.tick.index, tick.inputs.tick.t_s, tick.command, output.command
                )
    if count == 0:
        raise LogError("no whole tick in it: give an onboard log (.BIN) that has run for a second or more")
    if compared == 0:
        raise LogError("no checkpoint in it: give the file from its first byte on, replay begins at a stored state")
    reading = Reading(ticks=count, notes=tuple(all_notes))
    return ReplayReport(count, compared, gaps, differences, first_difference, largest_rad, reading)


def replay_log(
    source: Path | bytes,
    restore: Callable[[str], tuple[State, tuple[str, ...]]],
    step: Callable[[State, Inputs], tuple[State, Output]],
) -> ReplayReport:
    """Replay one log file; raises LogError like `replay`, and if the file cannot be read. The text names the file."""
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


def _recompute_tick(
    state: State, inputs: Inputs, step: Callable[[State, Inputs], tuple[State, Output]]
) -> tuple[State, Output]:
    try:
        return step(state, inputs)
    except Exception as error:  # a damaged log may contain any numbers
        tick = inputs.tick.index
        raise LogError(f"tick {tick} cannot be recomputed ({type(error).__name__}: {error})") from error


def _restore_checkpoint(
    text: str, restore: Callable[[str], tuple[State, tuple[str, ...]]]
) -> tuple[State, tuple[str, ...]]:
    try:
        return restore(text)
    except ValueError as error:
        raise CheckpointError(f"checkpoint refused ({error})") from error


def _command_bits(command: RudderCommand) -> tuple[bytes, bool]:
    """Return the bits of a command, in which -0.0 differs from 0.0 and a NaN equals itself."""
    return struct.pack("<d", command.shaft_rad), command.torque_on


def _command_as_dict(command: RudderCommand) -> dict[str, Any]:
    return {
        "shaft_rad": command.shaft_rad if math.isfinite(command.shaft_rad) else None,
        "shaft_bits": struct.pack(">d", command.shaft_rad).hex(),
        "torque_on": command.torque_on,
    }
