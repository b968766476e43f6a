"""Behaviours of the fish (section 3 of the paper): follow, swarm, prey, random, congestion, bulletin board.

An iteration calls `find_partners` once. Each stage calls `request_points`, evaluates the points and calls
`store_costs`. At the end, `move_fish` moves all fish at once. Differences from the paper:

* Food. The paper's crowding condition Y_c / n_f > kappa * Y_i assumes food Y > 0, and its result changes with a
  constant that is added to Y. Here the food of a position is the fraction of the shoal with higher cost, for any sign
  and scale of the objective. All other rules only compare values, so any strictly increasing function of the objective
  (J, log J, -1/J) gives the same search.
* The bulletin board includes all evaluated points, also tries and centres.
* In a move toward a point outside the box, each coordinate is clipped to the box, because the optimum may be on its
  wall. Tries and random moves beyond a wall are mirrored into the box. Otherwise, with wide vision in five dimensions,
  half of them would end on walls.
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
def start_iteration(shoal: Shoal) -> None:
    """Clear the results of the last iteration, and compute the food of each fish."""
    for i in range(shoal.cost.size):
        shoal.food[i] = food_at(shoal.cost, shoal.cost[i])
        shoal.centre_cost[i] = np.inf
        shoal.try_cost[i] = np.inf
        shoal.move_cost[i] = np.inf
        shoal.move_kind[i] = NONE


@inner
def food_at(costs: np.ndarray, cost: float) -> float:
    """Return the fraction of the shoal with a higher cost."""
    worse_count = 0
    for i in range(costs.size):
        if costs[i] > cost:
            worse_count += 1
    return worse_count / costs.size


@inner
def find_partners(shoal: Shoal, vision: float) -> None:
    """Find the partners of each fish (those within its vision), their centre, and the best one."""
    fish, dimensions = shoal.position.shape
    for i in range(fish):
        count = 0
        leader = NONE
        for k in range(dimensions):
            shoal.centre[i, k] = 0.0
        for j in range(fish):
            if j == i:
                continue
            square_distance = 0.0
            for k in range(dimensions):
                difference = shoal.position[j, k] - shoal.position[i, k]
                square_distance += difference * difference
            if square_distance > vision * vision:
                continue
            count += 1
            for k in range(dimensions):
                shoal.centre[i, k] += shoal.position[j, k]
            if leader == NONE or shoal.cost[j] < shoal.cost[leader]:
                leader = j
        shoal.partners[i] = count
        shoal.leader[i] = leader
        for k in range(dimensions):
            shoal.centre[i, k] /= max(count, 1)


@inner
def request_points(shoal: Shoal, stage: int, first_try: int, end_try: int, behaviour: Behaviour) -> int:
    """Write the points to be evaluated in a stage; return their number."""
    count = 0
    for i in range(shoal.cost.size):
        position, uniforms = shoal.position[i], shoal.uniforms[i]
        crowding, partners, leader = behaviour.congestion * shoal.food[i], shoal.partners[i], shoal.leader[i]
        has_improved = shoal.move_cost[i] < shoal.cost[i]
        has_better_try = shoal.try_cost[i] < shoal.cost[i]
        first_point = count
        if has_improved and behaviour.skips_after_improvement:
            continue
        has_better_leader = leader != NONE and shoal.cost[leader] < shoal.cost[i]
        if stage >> FOLLOW_MOVE & 1 and has_better_leader and shoal.food[leader] > crowding * shoal.partners[leader]:
            shoal.kind[count] = FOLLOW_MOVE
            count += point_toward(
                position, shoal.position[leader], behaviour.step * uniforms[FOLLOW_MOVE], shoal.point[count]
            )
        if stage >> CENTRE & 1 and partners > 0:
            shoal.kind[count] = CENTRE
            copy_point(shoal.centre[i], shoal.point[count])
            count += 1
        if stage >> SWARM_MOVE & 1 and partners > 0 and food_at(shoal.cost, shoal.centre_cost[i]) > crowding * partners:
            shoal.kind[count] = SWARM_MOVE
            count += point_toward(position, shoal.centre[i], behaviour.step * uniforms[SWARM_MOVE], shoal.point[count])
        if stage >> TRY & 1 and not has_better_try:
            for number in range(first_try, end_try):
                # Random direction, uniform distance within vision.
                shoal.kind[count] = TRY
                point_along(
                    position, shoal.normals[i, number], behaviour.vision * uniforms[MOVES + number], shoal.point[count]
                )
                count += 1
        if stage >> PREY_MOVE & 1 and has_better_try:
            shoal.kind[count] = PREY_MOVE
            count += point_toward(
                position, shoal.try_position[i], behaviour.step * uniforms[PREY_MOVE], shoal.point[count]
            )
        if stage >> RANDOM_MOVE & 1 and not has_improved:
            shoal.kind[count] = RANDOM_MOVE
            point_along(position, shoal.normals[i, -1], behaviour.step * uniforms[RANDOM_MOVE], shoal.point[count])
            count += 1
        for number in range(first_point, count):
            shoal.owner[number] = i
    return count


@inner
def point_toward(position: np.ndarray, target: np.ndarray, distance: float, point: np.ndarray) -> int:
    """Compute the point at a distance toward a target, and return 1; return 0 if the target is the position itself."""
    square_distance = 0.0
    for k in range(position.size):
        square_distance += (target[k] - position[k]) ** 2
    if square_distance == 0.0:
        return 0
    scale = distance / math.sqrt(square_distance)
    for k in range(position.size):
        point[k] = min(max(position[k] + scale * (target[k] - position[k]), 0.0), 1.0)
    return 1


@inner
def point_along(position: np.ndarray, direction: np.ndarray, distance: float, point: np.ndarray) -> None:
    """Compute the point at a distance in a direction; the vector `direction` may have any length."""
    square_distance = 0.0
    for k in range(position.size):
        square_distance += direction[k] ** 2
    scale = distance / math.sqrt(square_distance) if square_distance > 0.0 else 0.0
    for k in range(position.size):
        point[k] = mirror(position[k] + scale * direction[k])


@inner
def mirror(coordinate: float) -> float:
    """Return a coordinate outside the box mirrored into it."""
    if 0.0 <= coordinate <= 1.0:
        return coordinate
    folded = abs(coordinate) % 2.0
    return 2.0 - folded if folded > 1.0 else folded


@inner
def copy_point(source: np.ndarray, target: np.ndarray) -> None:
    """Copy a point; a slice assignment takes numba seconds to compile."""
    for k in range(source.size):
        target[k] = source[k]


@inner
def store_costs(shoal: Shoal, count: int, costs: np.ndarray) -> None:
    """Store the costs of the requested points; NaN is treated as infinite."""
    for number in range(count):
        cost = costs[number]
        if math.isnan(cost):
            cost = np.inf
        i, kind, point = shoal.owner[number], shoal.kind[number], shoal.point[number]
        if cost < shoal.best_cost[0]:
            shoal.best_cost[0] = cost
            copy_point(point, shoal.best_position)
        if kind == CENTRE:
            shoal.centre_cost[i] = cost
        elif kind == TRY:
            if cost < shoal.try_cost[i]:
                shoal.try_cost[i] = cost
                copy_point(point, shoal.try_position[i])
        elif cost < shoal.move_cost[i] or kind == RANDOM_MOVE:
            # A random move is requested only if no other move has improved the cost, and is always made.
            shoal.move_cost[i] = cost
            copy_point(point, shoal.move_position[i])
            shoal.move_kind[i] = kind


@inner
def move_fish(shoal: Shoal, moves: np.ndarray) -> None:
    """Move all fish, and count the moves of each behaviour."""
    for i in range(shoal.cost.size):
        kind = shoal.move_kind[i]
        if kind == NONE:
            continue
        moves[kind] += 1
        shoal.cost[i] = shoal.move_cost[i]
        copy_point(shoal.move_position[i], shoal.position[i])
