"""Rudder commands and decisions in the ticks of a log, recomputed and compared between processors.

The C libraries of two processors may differ in the last bit of exp and similar functions. Rudder commands then differ
slightly, until a number is on different sides of a threshold, which is a decision. Every part of the state that is not
a float counts as a decision.

As a program, `decisions.py LOG` prints a line of JSON for each recomputed tick.
"""

import json
import math
import sys
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

MAX_DIFFERENCE_RAD = 1e-9


class Tick(NamedTuple):
    """Rudder command, and the decisions that differ from those of the previous tick, by their path in the state."""

    rudder_rad: float
    decisions: dict[str, str]


class Agreement(NamedTuple):
    """Number of ticks with the same decisions, and the largest difference of their rudder commands.

    `first_difference` names the first decision that differs; it is empty if all are the same.
    """

    ticks: int
    max_difference_rad: float
    first_difference: str


def compare(ours: list[Tick], theirs: list[Tick]) -> Agreement:
    """Compare two recomputations of a log up to the first decision that differs."""
    ticks, max_difference_rad = 0, 0.0
    for own, other in zip_longest(ours, theirs):
        if own is None or other is None:
            return Agreement(ticks, max_difference_rad, f"tick {ticks} is missing in one of them")
        if own.decisions != other.decisions:
            names = own.decisions.keys() | other.decisions.keys()
            first = min(name for name in names if own.decisions.get(name) != other.decisions.get(name))
            return Agreement(ticks, max_difference_rad, f"tick {ticks}: {first}")
        difference_rad = abs(own.rudder_rad - other.rudder_rad)
        is_one_nan = math.isnan(own.rudder_rad) != math.isnan(other.rudder_rad)
        max_difference_rad = max(
            max_difference_rad, math.inf if is_one_nan else 0.0 if math.isnan(difference_rad) else difference_rad
        )
        ticks += 1
    return Agreement(ticks, max_difference_rad, "")


def discrete_parts(value, path=""):
    """Yield path and text of each part of a state that is not a float."""
    if isinstance(value, float | bytes):  # bytes are a covariance
        return
    # ParameterSet and Plan are no Structs; their repr contains an address, which differs between processes.
    if fields := getattr(value, "__struct_fields__", None) or getattr(value, "__slots__", None):
        items = [(name, getattr(value, name)) for name in fields]
    elif isinstance(value, tuple):
        items = list(enumerate(value))
    else:
        yield path, repr(value)
        return
    for name, part in items:
        yield from discrete_parts(part, f"{path}.{name}")


def recompute(log: Path):
    """Yield a Tick for each tick of a log."""
    from firmware_py.core.state_codec import state_from_text  # noqa: PLC0415 - the program of the machine that runs this
    from firmware_py.core.step import step  # noqa: PLC0415 - likewise
    from firmware_py.log.reader import LogReader  # noqa: PLC0415 - likewise

    state, previous = None, {}
    for tick in LogReader(log):
        if tick.checkpoint is not None:
            state, _ = state_from_text(tick.checkpoint)
        elif tick.gap:
            state = None
        if state is not None:
            state, output = step(state, tick.inputs)
            decisions = dict(discrete_parts((state, output.command.torque_on)))
            names = decisions.keys() | previous.keys()
            changed = {name: decisions.get(name, "") for name in names if decisions.get(name) != previous.get(name)}
            yield Tick(output.command.shaft_rad, changed)
            previous = decisions


def read(text: str) -> list[Tick]:
    """Read the output of this program."""
    return [Tick(*json.loads(line)) for line in text.splitlines()]


if __name__ == "__main__":
    for decided_tick in recompute(Path(sys.argv[1])):
        print(json.dumps(decided_tick))
