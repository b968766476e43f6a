"""What the fish do (the paper's section 3): follow, swarm, prey, random, congestion, bulletin board.

An iteration is: look around; then, stage by stage, `ask` for points, have the objective
evaluate them, `tell` the values; then `settle`. All fish move at once. Where these functions
leave the paper's letter, it is for these reasons:

* Food. The paper's crowding condition Y_c / n_f > kappa * Y_i presumes food Y > 0, and its outcome changes when a
  constant is added to Y. Here the food of a place is the share of the shoal that is worse off than who is there:
  0 to 1 whatever the sign and scale of the objective. All else compares values only, so any strictly
  increasing function of the objective (J, log J, -1/J) gives the same search.
* All points that are evaluated, also the tries and the centres, go to the bulletin board.
* A move toward a place that leaves the box stops at its wall, coordinate by coordinate, for the best may lie there.
  A look or a random move beyond a wall is mirrored into the box: with wide vision in five dimensions half of
  them would else fall upon walls.
"""

from __future__ import annotations

import math

import numpy as np

from hil.lab.numeric_core import inner
from hil.lab.swarm.shoal import CENTRE, FOLLOW_MOVE, MOVES, NONE, PREY_MOVE, RANDOM_MOVE, SWARM_MOVE, TRY, Shoal, Ways


@inner
def begin(shoal: Shoal) -> None:
    """Clear the answers of the last iteration, and rate the food of every fish."""
    for i in range(shoal.cost.size):
        shoal.share[i] = food(shoal.cost, shoal.cost[i])
        shoal.centre_cost[i] = np.inf
        shoal.try_cost[i] = np.inf
        shoal.move_cost[i] = np.inf
        shoal.move_kind[i] = NONE


@inner
def food(costs: np.ndarray, cost: float) -> float:
    """Return the share of the shoal that is worse off than at this cost."""
    worse = 0
    for i in range(costs.size):
        if costs[i] > cost:
            worse += 1
    return worse / costs.size


@inner
def look(shoal: Shoal, reach: float) -> None:
    """Find the partners of every fish (those no further than its vision), their centre and the best of them."""
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
def ask(shoal: Shoal, stage: int, first_try: int, end_try: int, ways: Ways) -> int:
    """Fill in the points that a stage needs evaluated; return how many."""
    count = 0
    for i in range(shoal.cost.size):
        here, drawn = shoal.place[i], shoal.uniforms[i]
        own, partners, leader = ways.congestion * shoal.share[i], shoal.partners[i], shoal.leader[i]
        helped = shoal.move_cost[i] < shoal.cost[i]
        found = shoal.try_cost[i] < shoal.cost[i]
        begun = count
        if helped and ways.content:
            continue
        better = leader != NONE and shoal.cost[leader] < shoal.cost[i]
        if stage >> FOLLOW_MOVE & 1 and better and shoal.share[leader] > own * shoal.partners[leader]:
            shoal.kind[count] = FOLLOW_MOVE
            count += toward(here, shoal.place[leader], ways.step * drawn[FOLLOW_MOVE], shoal.point[count])
        if stage >> CENTRE & 1 and partners > 0:
            shoal.kind[count] = CENTRE
            copy(shoal.centre[i], shoal.point[count])
            count += 1
        if stage >> SWARM_MOVE & 1 and partners > 0 and food(shoal.cost, shoal.centre_cost[i]) > own * partners:
            shoal.kind[count] = SWARM_MOVE
            count += toward(here, shoal.centre[i], ways.step * drawn[SWARM_MOVE], shoal.point[count])
        if stage >> TRY & 1 and not found:
            for number in range(first_try, end_try):
                # Any direction, and any distance within vision alike.
                shoal.kind[count] = TRY
                aside(here, shoal.normals[i, number], ways.reach * drawn[MOVES + number], shoal.point[count])
                count += 1
        if stage >> PREY_MOVE & 1 and found:
            shoal.kind[count] = PREY_MOVE
            count += toward(here, shoal.try_place[i], ways.step * drawn[PREY_MOVE], shoal.point[count])
        if stage >> RANDOM_MOVE & 1 and not helped:
            shoal.kind[count] = RANDOM_MOVE
            aside(here, shoal.normals[i, -1], ways.step * drawn[RANDOM_MOVE], shoal.point[count])
            count += 1
        for number in range(begun, count):
            shoal.owner[number] = i
    return count


@inner
def toward(here: np.ndarray, target: np.ndarray, distance: float, point: np.ndarray) -> int:
    """Fill in the place at a distance toward a target, and return 1; 0 where the fish is there already."""
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
    """Fill in the place at a distance in a direction, which need not be of unit length."""
    square = 0.0
    for k in range(here.size):
        square += direction[k] ** 2
    share = distance / math.sqrt(square) if square > 0.0 else 0.0
    for k in range(here.size):
        point[k] = mirrored(here[k] + share * direction[k])


@inner
def mirrored(coordinate: float) -> float:
    """Return a coordinate outside the box as its image within, behind the walls that are mirrors."""
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
def tell(shoal: Shoal, count: int, costs: np.ndarray) -> None:
    """Take in the costs of the points asked for; what is not a number is worse than all others."""
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
            # A random move is asked for when nothing has helped, and is made whether it helps or not.
            shoal.move_cost[i] = cost
            copy(point, shoal.move_place[i])
            shoal.move_kind[i] = kind


@inner
def settle(shoal: Shoal, moves: np.ndarray) -> None:
    """Move every fish, and count which behaviour moved it."""
    for i in range(shoal.cost.size):
        kind = shoal.move_kind[i]
        if kind == NONE:
            continue
        moves[kind] += 1
        shoal.cost[i] = shoal.move_cost[i]
        copy(shoal.move_place[i], shoal.place[i])
