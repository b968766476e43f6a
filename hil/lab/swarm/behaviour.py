"""Behaviours of the fish (section 3 of the paper): follow, swarm, prey, random, congestion, bulletin board.

An iteration consists of `look`; then, for each stage, `request` for points, their evaluation, and `receive` for the
values; then `settle`. All fish move at once. Differences to the paper:

* Food. The paper's crowding condition Y_c / n_f > kappa * Y_i assumes food Y > 0, and its result changes with a
  constant that is added to Y. Here the food of a place is the share of the shoal with higher cost: 0 to 1 for any sign
  and scale of the objective. Everything else only compares values, so any strictly increasing function of the objective
  (J, log J, -1/J) gives the same search.
* All evaluated points, also tries and centres, go to the bulletin board.
* A move toward a place outside the box stops at its wall, by coordinate, because the optimum may be there. Tries and
  random moves beyond a wall are mirrored into the box: with wide vision in five dimensions half of them would otherwise
  end on walls.
"""

from __future__ import annotations

import math

import numpy as np

from hil.lab.numeric_core import inner
from hil.lab.swarm.shoal import (
    CENTRE,
    FOLLOW_MOVE,
    MOVES,
    NONE,
    PREY_MOVE,
    RANDOM_MOVE,
    SWARM_MOVE,
    TRY,
    Behaviour,
    Shoal,
)


@inner
def begin(shoal: Shoal) -> None:
    """Clear the results of the last iteration, and compute the food of every fish."""
    for i in range(shoal.cost.size):
        shoal.share[i] = food(shoal.cost, shoal.cost[i])
        shoal.centre_cost[i] = np.inf
        shoal.try_cost[i] = np.inf
        shoal.move_cost[i] = np.inf
        shoal.move_kind[i] = NONE


@inner
def food(costs: np.ndarray, cost: float) -> float:
    """Return the share of the shoal with a higher cost."""
    worse = 0
    for i in range(costs.size):
        if costs[i] > cost:
            worse += 1
    return worse / costs.size


@inner
def look(shoal: Shoal, reach: float) -> None:
    """Find the partners of every fish (those within its vision), their centre and the best of them."""
    fish, dimensions = shoal.place.shape
    for i in range(fish):
        count = 0
        leader = NONE
        for k in range(dimensions):
            shoal.centre[i, k] = 0.0
        for j in range(fish):
            if j == i:
                continue
            square = 0.0
            for k in range(dimensions):
                way = shoal.place[j, k] - shoal.place[i, k]
                square += way * way
            if square > reach * reach:
                continue
            count += 1
            for k in range(dimensions):
                shoal.centre[i, k] += shoal.place[j, k]
            if leader == NONE or shoal.cost[j] < shoal.cost[leader]:
                leader = j
        shoal.partners[i] = count
        shoal.leader[i] = leader
        for k in range(dimensions):
            shoal.centre[i, k] /= max(count, 1)


@inner
def request(shoal: Shoal, stage: int, first_try: int, end_try: int, behaviour: Behaviour) -> int:
    """Fill in the points to be evaluated in a stage; return their number."""
    count = 0
    for i in range(shoal.cost.size):
        here, drawn = shoal.place[i], shoal.uniforms[i]
        own, partners, leader = behaviour.congestion * shoal.share[i], shoal.partners[i], shoal.leader[i]
        helped = shoal.move_cost[i] < shoal.cost[i]
        found = shoal.try_cost[i] < shoal.cost[i]
        begun = count
        if helped and behaviour.content:
            continue
        better = leader != NONE and shoal.cost[leader] < shoal.cost[i]
        if stage >> FOLLOW_MOVE & 1 and better and shoal.share[leader] > own * shoal.partners[leader]:
            shoal.kind[count] = FOLLOW_MOVE
            count += toward(here, shoal.place[leader], behaviour.step * drawn[FOLLOW_MOVE], shoal.point[count])
        if stage >> CENTRE & 1 and partners > 0:
            shoal.kind[count] = CENTRE
            copy(shoal.centre[i], shoal.point[count])
            count += 1
        if stage >> SWARM_MOVE & 1 and partners > 0 and food(shoal.cost, shoal.centre_cost[i]) > own * partners:
            shoal.kind[count] = SWARM_MOVE
            count += toward(here, shoal.centre[i], behaviour.step * drawn[SWARM_MOVE], shoal.point[count])
        if stage >> TRY & 1 and not found:
            for number in range(first_try, end_try):
                # Random direction, uniform distance within vision.
                shoal.kind[count] = TRY
                aside(here, shoal.normals[i, number], behaviour.reach * drawn[MOVES + number], shoal.point[count])
                count += 1
        if stage >> PREY_MOVE & 1 and found:
            shoal.kind[count] = PREY_MOVE
            count += toward(here, shoal.try_place[i], behaviour.step * drawn[PREY_MOVE], shoal.point[count])
        if stage >> RANDOM_MOVE & 1 and not helped:
            shoal.kind[count] = RANDOM_MOVE
            aside(here, shoal.normals[i, -1], behaviour.step * drawn[RANDOM_MOVE], shoal.point[count])
            count += 1
        for number in range(begun, count):
            shoal.owner[number] = i
    return count


@inner
def toward(here: np.ndarray, target: np.ndarray, distance: float, point: np.ndarray) -> int:
    """Fill in the place at a distance toward a target, and return 1; return 0 if the fish is already there."""
    square = 0.0
    for k in range(here.size):
        square += (target[k] - here[k]) ** 2
    if square == 0.0:
        return 0
    share = distance / math.sqrt(square)
    for k in range(here.size):
        point[k] = min(max(here[k] + share * (target[k] - here[k]), 0.0), 1.0)
    return 1


@inner
def aside(here: np.ndarray, direction: np.ndarray, distance: float, point: np.ndarray) -> None:
    """Fill in the place at a distance in a direction of any length."""
    square = 0.0
    for k in range(here.size):
        square += direction[k] ** 2
    share = distance / math.sqrt(square) if square > 0.0 else 0.0
    for k in range(here.size):
        point[k] = mirrored(here[k] + share * direction[k])


@inner
def mirrored(coordinate: float) -> float:
    """Return a coordinate outside the box mirrored into it."""
    if 0.0 <= coordinate <= 1.0:
        return coordinate
    away = abs(coordinate) % 2.0
    return 2.0 - away if away > 1.0 else away


@inner
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy a point (numba takes seconds to compile the checks of a slice assignment)."""
    for k in range(source.size):
        target[k] = source[k]


@inner
def receive(shoal: Shoal, count: int, costs: np.ndarray) -> None:
    """Store the costs of the requested points; NaN is worse than all numbers."""
    for number in range(count):
        cost = costs[number]
        if math.isnan(cost):
            cost = np.inf
        i, kind, point = shoal.owner[number], shoal.kind[number], shoal.point[number]
        if cost < shoal.best_cost[0]:
            shoal.best_cost[0] = cost
            copy(point, shoal.best_place)
        if kind == CENTRE:
            shoal.centre_cost[i] = cost
        elif kind == TRY:
            if cost < shoal.try_cost[i]:
                shoal.try_cost[i] = cost
                copy(point, shoal.try_place[i])
        elif cost < shoal.move_cost[i] or kind == RANDOM_MOVE:
            # A random move is requested if nothing has helped, and is always made.
            shoal.move_cost[i] = cost
            copy(point, shoal.move_place[i])
            shoal.move_kind[i] = kind


@inner
def settle(shoal: Shoal, moves: np.ndarray) -> None:
    """Move every fish, and count the moves of each behaviour."""
    for i in range(shoal.cost.size):
        kind = shoal.move_kind[i]
        if kind == NONE:
            continue
        moves[kind] += 1
        shoal.cost[i] = shoal.move_cost[i]
        copy(shoal.move_place[i], shoal.place[i])
