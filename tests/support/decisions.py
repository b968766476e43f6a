"""Rudder commands and decisions in the ticks of a log, recomputed and compared between processors.

The C libraries of two processors may differ in the last bit of exp and similar functions. Rudder commands then agree
only closely, and only until a number close to a threshold falls on the other side of it: a decision. Every part of the
state that is not a float counts as a decision.

Run as a program, `decisions.py LOG` prints a line of JSON for each tick that it recomputes.
"""

import json
import math
import sys
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

BOUND_RAD = 1e-9


class Tick(NamedTuple):
    """A rudder command, and the decisions that differ from those of the tick before, by their place in the state."""

    rudder_rad: float
    decisions: dict[str, str]


class Agreement(NamedTuple):
    """Number of ticks that agree in all decisions, and the largest difference of their rudder commands.

    `differs` names the first decision that differs; it is empty where all agree.
    """

    ticks: int
    largest_rad: float
    differs: str


def agreement(ours: list[Tick], theirs: list[Tick]) -> Agreement:
    """Compare two recomputations of a log up to the first decision that differs."""
    ticks, largest_rad = 0, 0.0
    for mine, other in zip_longest(ours, theirs):
        if mine is None or other is None:
            return Agreement(ticks, largest_rad, f"tick {ticks} is missing in one of them")
        if mine.decisions != other.decisions:
            both = mine.decisions.keys() | other.decisions.keys()
            first = min(name for name in both if mine.decisions.get(name) != other.decisions.get(name))
            return Agreement(ticks, largest_rad, f"tick {ticks}: {first}")
        off_rad = abs(mine.rudder_rad - other.rudder_rad)
        one_is_none = math.isnan(mine.rudder_rad) != math.isnan(other.rudder_rad)
        largest_rad = max(largest_rad, math.inf if one_is_none else 0.0 if math.isnan(off_rad) else off_rad)
        ticks += 1
    return Agreement(ticks, largest_rad, "")


def parts(value, place=""):
    """Yield place and text of each part of a state that is not a float."""
    if isinstance(value, float | bytes):  # bytes hold a covariance
        return
    # ParameterSet and Plan are no Structs; their repr is an address, which differs between processes.
    if fields := getattr(value, "__struct_fields__", None) or getattr(value, "__slots__", None):
        named = [(name, getattr(value, name)) for name in fields]
    elif isinstance(value, tuple):
        named = list(enumerate(value))
    else:
        yield place, repr(value)
        return
    for name, part in named:
        yield from parts(part, f"{place}.{name}")


def recomputed(log: Path):
    """Yield a Tick for each tick of a log."""
    from firmware_py.core.state_codec import state_from_text  # noqa: PLC0415 - the program of the machine that runs this
    from firmware_py.core.step import step  # noqa: PLC0415 - likewise
    from firmware_py.log.reader import LogReader  # noqa: PLC0415 - likewise

    state, before = None, {}
    for tick in LogReader(log):
        if tick.checkpoint is not None:
            state, _ = state_from_text(tick.checkpoint)
        elif tick.gap:
            state = None
        if state is not None:
            state, output = step(state, tick.inputs)
            now = dict(parts((state, output.command.torque_on)))
            both = now.keys() | before.keys()
            changed = {name: now.get(name, "") for name in both if now.get(name) != before.get(name)}
            yield Tick(output.command.shaft_rad, changed)
            before = now


def read(text: str) -> list[Tick]:
    """Read the output of this program."""
    return [Tick(*json.loads(line)) for line in text.splitlines()]


if __name__ == "__main__":
    for one in recomputed(Path(sys.argv[1])):
        print(json.dumps(one))
