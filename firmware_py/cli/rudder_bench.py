"""The rudder on the bench, moved by small steps against its own encoder: whether it follows, how far, which way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Final

import msgspec

from firmware_py.common.angles import degrees, radians

STEP_RAD: Final = radians(2.0)
ASTRAY_RAD: Final = radians(3.0)  # farther from the command than this, when it has had its time, it stands at a stop
MARGIN_RAD: Final = radians(2.0)  # that RUD_LIMIT_DEG keeps from a stop
LEAST_RAD: Final = radians(5.0)  # no boat is steered by a limit below
SHOWN_RAD: Final = radians(10.0)  # what is shown to the operator, who says which way it went; or the limit
# From slopes within this of 1 the encoder and the command have one scale.
SCALE: Final = 0.1


class BenchError(RuntimeError):
    """The servo does not do what the bench needs; the text says what to look at."""


class Measured(msgspec.Struct, frozen=True):
    """What the servo says of itself once it has had its time."""

    shaft_rad: float
    current_a: float | None = None


# Bring the shaft to an angle and wait; None: let it go. BenchError when the servo falls silent.
Move = Callable[[float | None], Measured]


@dataclass(slots=True)
class Sweep:
    """One side: how far the shaft has come from the centre, and whether a stop ended it.

    `pairs` are commanded and measured angles.
    """

    reached_rad: float = 0.0
    stopped: bool = False
    pairs: list[tuple[float, float]] = field(default_factory=list)


def sweep(move: Move, centre_rad: float, side: float, farthest_rad: float, most_a: float) -> Sweep:
    """Step to one side (+1 or -1 of the shaft) until a stop or farthest_rad, and come back to the centre."""
    done = Sweep()
    for number in count(1):
        away_rad = number * STEP_RAD
        if away_rad > farthest_rad:
            break
        wanted_rad = centre_rad + side * away_rad
        measured = move(wanted_rad)
        heavy = most_a > 0.0 and measured.current_a is not None and abs(measured.current_a) > most_a
        if heavy or abs(measured.shaft_rad - wanted_rad) > ASTRAY_RAD:
            done.stopped = True
            break
        done.pairs.append((wanted_rad, measured.shaft_rad))
        done.reached_rad = side * (measured.shaft_rad - centre_rad)
    move(centre_rad)
    return done


def scale_of(pairs: list[tuple[float, float]]) -> float:
    """Return by how much the encoder moves for the command; BenchError when it cannot be told."""
    mean_x = sum(x for x, _ in pairs) / max(len(pairs), 1)
    mean_y = sum(y for _, y in pairs) / max(len(pairs), 1)
    square = sum((x - mean_x) ** 2 for x, _ in pairs)
    if len(pairs) < 3 or square <= 0.0:
        raise BenchError("the shaft does not follow even small steps: is it free, and the servo's power strong enough?")
    return sum((x - mean_x) * (y - mean_y) for x, y in pairs) / square


def limit_rad(sides: list[Sweep], largest_rad: float) -> float:
    """Return the rudder limit to propose: the nearer stop less a margin; the largest, where there is none so near.

    BenchError for a stop at the centre: that is none.
    """
    stops = [side.reached_rad - MARGIN_RAD for side in sides if side.stopped]
    if stops and min(stops) < LEAST_RAD:
        raise BenchError(
            f"the shaft follows to {degrees(min(stops) + MARGIN_RAD):.1f} deg only to one side: it sticks, or the "
            "centre is not amidships; free it, or lay it so by hand and give --amidships"
        )
    return min([largest_rad, *stops])
