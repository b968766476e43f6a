"""The state of the shoal: arrays that compiled code works on in place, in a box of unit sides."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.swarm.records import Floats
from hil.lab.swarm.settings import SwarmSettings

# The behaviours, and the two questions asked before a move; kinds of a requested point.
FOLLOW_MOVE, SWARM_MOVE, PREY_MOVE, RANDOM_MOVE, CENTRE, TRY = range(6)
MOVES = 4  # the first four
NONE = -1


class Shoal(NamedTuple):
    """n fish in d dimensions; `cost` is the objective's value, the lower the more food.

    place, cost: where each fish is. share: what share of the shoal is worse off (its food).
    partners, centre: how many others a fish sees, and their middle.
    leader: the best of them.
    centre_cost, try_place, try_cost: answers of this iteration.
    move_place, move_cost, move_kind: the best move found in this iteration.
    best_place, best_cost: the bulletin board.
    point, owner, kind: what is to be evaluated next, for which fish, and why.
    uniforms, normals: the random numbers of an iteration.
    """

    place: Floats
    cost: Floats
    share: Floats
    partners: NDArray[np.int64]
    centre: Floats
    leader: NDArray[np.int64]
    centre_cost: Floats
    try_place: Floats
    try_cost: Floats
    move_place: Floats
    move_cost: Floats
    move_kind: NDArray[np.int64]
    best_place: Floats
    best_cost: Floats
    point: Floats
    owner: NDArray[np.int64]
    kind: NDArray[np.int64]
    uniforms: Floats
    normals: Floats


class Ways(NamedTuple):
    """The settings that the compiled behaviours need; reach and step in lengths of the unit box."""

    reach: float
    step: float
    congestion: float
    content: bool  # a fish that has found a better place looks no further (the "progress" strategy)


def new_shoal(settings: SwarmSettings, dimensions: int) -> Shoal:
    """Return the arrays, not yet filled."""
    fish = settings.fish
    requests = fish * (settings.tries + 2)
    return Shoal(
        place=np.zeros((fish, dimensions)),
        cost=np.full(fish, np.inf),
        share=np.zeros(fish),
        partners=np.zeros(fish, np.int64),
        centre=np.zeros((fish, dimensions)),
        leader=np.zeros(fish, np.int64),
        centre_cost=np.zeros(fish),
        try_place=np.zeros((fish, dimensions)),
        try_cost=np.zeros(fish),
        move_place=np.zeros((fish, dimensions)),
        move_cost=np.zeros(fish),
        move_kind=np.zeros(fish, np.int64),
        best_place=np.zeros(dimensions),
        best_cost=np.full(1, np.inf),
        point=np.zeros((requests, dimensions)),
        owner=np.zeros(requests, np.int64),
        kind=np.zeros(requests, np.int64),
        uniforms=np.zeros((fish, MOVES + settings.tries)),
        normals=np.zeros((fish, settings.tries + 1, dimensions)),
    )


def schedule(settings: SwarmSettings) -> NDArray[np.int64]:
    """Return the stages of an iteration, one row (bits of the kinds asked for, first try, last try + 1) each.

    A stage is one call of the objective. The optimal strategy asks everything at once; progress
    asks for a behaviour only when the one before it has not helped.
    """

    def stage(*kinds: int) -> int:
        return sum(1 << kind for kind in kinds)

    tries = settings.tries
    all_tries = [(0, tries)] if settings.prey == "best" else [(number, number + 1) for number in range(tries)]
    if settings.strategy == "optimal":
        first, *others = all_tries
        rows = [(stage(FOLLOW_MOVE, CENTRE, TRY), *first)]
        rows += [(stage(TRY), *span) for span in others]
        rows += [(stage(SWARM_MOVE, PREY_MOVE), 0, 0)]
    else:
        rows = [(stage(FOLLOW_MOVE), 0, 0), (stage(CENTRE), 0, 0), (stage(SWARM_MOVE), 0, 0)]
        rows += [(stage(TRY), *span) for span in all_tries]
        rows += [(stage(PREY_MOVE), 0, 0)]
    rows += [(stage(RANDOM_MOVE), 0, 0)]
    return np.array(rows, np.int64)


def scatter(shoal: Shoal, rng: np.random.Generator) -> None:
    """Place the fish at random, one in each of n slices of every side (Latin hypercube)."""
    fish, dimensions = shoal.place.shape
    for dimension in range(dimensions):
        shoal.place[:, dimension] = (rng.permutation(fish) + rng.random(fish)) / fish


def diagonal(dimensions: int) -> float:
    """Return the diagonal of the unit box."""
    return math.sqrt(dimensions)
