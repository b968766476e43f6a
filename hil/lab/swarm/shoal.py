"""State of the shoal: arrays that compiled code changes in place; positions are in the unit box."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.swarm.records import Floats, SwarmSettings

# Types of a requested point: moves of the behaviours, and evaluations before a move.
FOLLOW_MOVE, SWARM_MOVE, PREY_MOVE, RANDOM_MOVE, CENTRE, TRY = range(6)
MOVES = 4  # number of types that are moves, the first ones
NONE = -1


class Shoal(NamedTuple):
    """n fish in d dimensions; `cost` is the value of the objective.

    position, cost: of each fish. food: fraction of the shoal with higher cost.
    partners, centre, leader: number, centre and best one of the fish within vision.
    centre_cost, try_position, try_cost: results of the evaluations in this iteration.
    move_position, move_cost, move_kind: the best move of this iteration.
    best_position, best_cost: the bulletin board.
    point, owner, kind: requested points, their fish and their types.
    uniforms, normals: random numbers of an iteration.
    """

    position: Floats
    cost: Floats
    food: Floats
    partners: NDArray[np.int64]
    centre: Floats
    leader: NDArray[np.int64]
    centre_cost: Floats
    try_position: Floats
    try_cost: Floats
    move_position: Floats
    move_cost: Floats
    move_kind: NDArray[np.int64]
    best_position: Floats
    best_cost: Floats
    point: Floats
    owner: NDArray[np.int64]
    kind: NDArray[np.int64]
    uniforms: Floats
    normals: Floats


class Behaviour(NamedTuple):
    """Settings of the behaviours for one iteration; vision and step in side lengths of the unit box."""

    vision: float
    step: float
    congestion: float
    skips_after_improvement: bool  # a fish with a better position requests no more points (strategy "progress")


def new_shoal(settings: SwarmSettings, dimensions: int) -> Shoal:
    """Return a shoal without positions and costs."""
    fish = settings.fish
    requests = fish * (settings.tries + 2)
    return Shoal(
        position=np.zeros((fish, dimensions)),
        cost=np.full(fish, np.inf),
        food=np.zeros(fish),
        partners=np.zeros(fish, np.int64),
        centre=np.zeros((fish, dimensions)),
        leader=np.zeros(fish, np.int64),
        centre_cost=np.zeros(fish),
        try_position=np.zeros((fish, dimensions)),
        try_cost=np.zeros(fish),
        move_position=np.zeros((fish, dimensions)),
        move_cost=np.zeros(fish),
        move_kind=np.zeros(fish, np.int64),
        best_position=np.zeros(dimensions),
        best_cost=np.full(1, np.inf),
        point=np.zeros((requests, dimensions)),
        owner=np.zeros(requests, np.int64),
        kind=np.zeros(requests, np.int64),
        uniforms=np.zeros((fish, MOVES + settings.tries)),
        normals=np.zeros((fish, settings.tries + 1, dimensions)),
    )


def schedule(settings: SwarmSettings) -> NDArray[np.int64]:
    """Return the stages of an iteration: rows with the bits of the requested types, first try, and last try + 1.

    A stage is one call of the objective. The strategy "optimal" requests everything at once; "progress" requests a
    behaviour only if the previous one has not improved the cost.
    """

    def stage(*kinds: int) -> int:
        return sum(1 << kind for kind in kinds)

    tries = settings.tries
    all_tries = [(0, tries)] if settings.prey == "best" else [(number, number + 1) for number in range(tries)]
    if settings.strategy == "optimal":
        first_tries, *other_tries = all_tries
        rows = [(stage(FOLLOW_MOVE, CENTRE, TRY), *first_tries)]
        rows += [(stage(TRY), *try_range) for try_range in other_tries]
        rows += [(stage(SWARM_MOVE, PREY_MOVE), 0, 0)]
    else:
        rows = [(stage(FOLLOW_MOVE), 0, 0), (stage(CENTRE), 0, 0), (stage(SWARM_MOVE), 0, 0)]
        rows += [(stage(TRY), *try_range) for try_range in all_tries]
        rows += [(stage(PREY_MOVE), 0, 0)]
    rows += [(stage(RANDOM_MOVE), 0, 0)]
    return np.array(rows, np.int64)


def scatter(shoal: Shoal, rng: np.random.Generator) -> None:
    """Set the initial positions by Latin hypercube sampling."""
    fish, dimensions = shoal.position.shape
    for dimension in range(dimensions):
        shoal.position[:, dimension] = (rng.permutation(fish) + rng.random(fish)) / fish


def diagonal(dimensions: int) -> float:
    """Return the diagonal of the unit box."""
    return math.sqrt(dimensions)
