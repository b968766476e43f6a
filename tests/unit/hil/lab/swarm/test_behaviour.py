"""Behaviours of the fish, as the paper defines them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.lab.swarm import SwarmSettings, behaviour
from hil.lab.swarm.shoal import (
    CENTRE,
    FOLLOW_MOVE,
    NONE,
    PREY_MOVE,
    RANDOM_MOVE,
    SWARM_MOVE,
    TRY,
    Behaviour,
    new_shoal,
    scatter,
    schedule,
)

BEHAVIOUR = Behaviour(vision=0.3, step=0.1, congestion=0.1, skips_after_improvement=False)


def shoal_of(positions, costs, tries=2, seed=1):
    """Return a shoal in two dimensions with partners and random numbers."""
    shoal = new_shoal(SwarmSettings(fish=len(positions), tries=tries), 2)
    shoal.position[:] = positions
    shoal.cost[:] = costs
    rng = np.random.default_rng(seed)
    rng.random(out=shoal.uniforms)
    rng.standard_normal(out=shoal.normals)
    behaviour.start_iteration(shoal)
    behaviour.find_partners(shoal, BEHAVIOUR.vision)
    return shoal


def bit(*kinds):
    return sum(1 << kind for kind in kinds)


def request_points(shoal, *kinds, settings=BEHAVIOUR, tries=(0, 2)):
    count = behaviour.request_points(shoal, bit(*kinds), *tries, settings)
    return [
        (int(kind), int(owner), point.copy())
        for kind, owner, point in zip(shoal.kind[:count], shoal.owner[:count], shoal.point[:count], strict=True)
    ]


# Fish 0, 1 and 2 are partners; fish 3 is alone.
POSITIONS = [(0.2, 0.2), (0.3, 0.2), (0.2, 0.4), (0.9, 0.9)]
COSTS = [4.0, 3.0, 1.0, 2.0]


def test_partners_are_the_fish_within_vision_except_itself():
    shoal = shoal_of(POSITIONS, COSTS)
    assert shoal.partners.tolist() == [2, 2, 2, 0]
    assert shoal.leader.tolist() == [2, 2, 1, NONE]
    np.testing.assert_allclose(shoal.centre[0], (0.25, 0.3))


def test_fish_at_the_limit_of_vision_is_a_partner():
    shoal = shoal_of([(0.0, 0.0), (0.3, 0.0), (0.0, 0.30001)], [1.0, 2.0, 3.0])
    assert shoal.partners.tolist() == [1, 1, 0]


def test_food_is_the_fraction_of_the_shoal_with_higher_cost():
    shoal = shoal_of(POSITIONS, COSTS)
    assert shoal.food.tolist() == [0.0, 0.25, 0.75, 0.5]


@pytest.mark.parametrize("change", [lambda y: y - 1e6, lambda y: -1.0 / y, np.exp, lambda y: 1e-200 * y])
def test_food_does_not_depend_on_sign_or_scale(change):
    shoal = shoal_of(POSITIONS, change(np.array(COSTS)))
    assert shoal.food.tolist() == [0.0, 0.25, 0.75, 0.5]


def test_follow_moves_toward_the_best_partner_by_at_most_a_step():
    shoal = shoal_of(POSITIONS, COSTS)
    moves = request_points(shoal, FOLLOW_MOVE)
    # Fish 2 is better than its partners, and fish 3 has no partner.
    assert [(kind, owner) for kind, owner, _ in moves] == [(FOLLOW_MOVE, 0), (FOLLOW_MOVE, 1)]
    for _, owner, point in moves:
        move, target_direction = point - shoal.position[owner], shoal.position[2] - shoal.position[owner]
        assert 0.0 < np.linalg.norm(move) <= BEHAVIOUR.step
        assert move @ target_direction == pytest.approx(np.linalg.norm(move) * np.linalg.norm(target_direction))


def test_crowded_leader_is_not_followed():
    # Food of the leader 0.75 around which there are 2: 0.75 / 2 > kappa * 0.25 up to kappa 1.5 for fish 1.
    crowded_positions = [(0.5, 0.5)] * 9 + [(0.6, 0.5)]
    shoal = shoal_of(crowded_positions, [*range(1, 10), 0.0])
    # The best (share 0.9) has 9 around it: 0.1 > kappa * share.
    followers = [
        owner for _, owner, _ in request_points(shoal, FOLLOW_MOVE, settings=BEHAVIOUR._replace(congestion=0.2))
    ]
    assert followers == [owner for owner in range(9) if 0.2 * shoal.food[owner] < 0.1]
    assert 0 < len(followers) < 9


def test_each_better_leader_is_followed_without_congestion():
    shoal = shoal_of([(0.5, 0.5)] * 9 + [(0.6, 0.5)], [*range(1, 10), 0.0])
    assert len(request_points(shoal, FOLLOW_MOVE, settings=BEHAVIOUR._replace(congestion=0.0))) == 9


def test_equal_leader_is_not_followed():
    shoal = shoal_of([(0.5, 0.5), (0.6, 0.5)], [1.0, 1.0])
    assert request_points(shoal, FOLLOW_MOVE) == []


def test_swarm_evaluates_the_centre_and_moves_toward_a_good_one():
    shoal = shoal_of(POSITIONS, COSTS)
    centres = request_points(shoal, CENTRE)
    assert [owner for _, owner, _ in centres] == [0, 1, 2]
    # Good for fish 0 (better than 3 of 4), good for 1, without food for 2.
    behaviour.store_costs(shoal, 3, np.array([1.5, 2.5, 5.0]))
    moves = request_points(shoal, SWARM_MOVE)
    assert [owner for _, owner, _ in moves] == [0, 1]
    for _, owner, point in moves:
        move, target_direction = point - shoal.position[owner], shoal.centre[owner] - shoal.position[owner]
        assert move @ target_direction == pytest.approx(np.linalg.norm(move) * np.linalg.norm(target_direction))
        assert np.linalg.norm(move) <= BEHAVIOUR.step


def test_crowded_centre_is_avoided():
    shoal = shoal_of(POSITIONS, COSTS)
    request_points(shoal, CENTRE)
    behaviour.store_costs(shoal, 3, np.array([1.5, 2.5, 2.5]))
    # Fish 2: food of the centre 0.5 over 2 partners, its own 0.75: up to kappa 1/3.
    assert 2 in [
        owner for _, owner, _ in request_points(shoal, SWARM_MOVE, settings=BEHAVIOUR._replace(congestion=0.33))
    ]
    assert 2 not in [
        owner for _, owner, _ in request_points(shoal, SWARM_MOVE, settings=BEHAVIOUR._replace(congestion=0.34))
    ]


def test_fish_at_the_centre_of_its_partners_does_not_move():
    shoal = shoal_of([(0.5, 0.5), (0.4, 0.5), (0.6, 0.5)], [9.0, 1.0, 1.0])
    request_points(shoal, CENTRE)
    behaviour.store_costs(shoal, 3, np.array([0.0, np.inf, np.inf]))
    assert request_points(shoal, SWARM_MOVE) == []


def test_tries_are_distributed_within_vision():
    tries = 400
    shoal = shoal_of([(0.5, 0.5), (0.5, 0.5)], [1.0, 2.0], tries=tries)
    points = np.array([point for _, owner, point in request_points(shoal, TRY, tries=(0, tries)) if owner == 0])
    behaviour = points - 0.5
    distances = np.linalg.norm(behaviour, axis=1)
    assert len(points) == tries
    assert distances.max() <= BEHAVIOUR.vision
    assert distances.max() > 0.95 * BEHAVIOUR.vision
    angles = np.arctan2(behaviour[:, 1], behaviour[:, 0])
    assert np.histogram(angles, bins=4, range=(-math.pi, math.pi))[0].min() > tries / 6


def test_prey_moves_toward_the_best_of_the_better_tries():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    tries_requested = request_points(shoal, TRY)
    assert [owner for _, owner, _ in tries_requested] == [0, 0, 1, 1]
    behaviour.store_costs(shoal, 4, np.array([0.9, 0.8, 2.0, np.nan]))
    ((kind, owner, point),) = request_points(shoal, PREY_MOVE)
    assert (kind, owner) == (PREY_MOVE, 0)
    target_direction, move = tries_requested[1][2] - 0.5, point - 0.5
    assert move @ target_direction == pytest.approx(np.linalg.norm(move) * np.linalg.norm(target_direction))


def test_fish_with_a_better_try_does_not_try_again():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    request_points(shoal, TRY, tries=(0, 1))
    behaviour.store_costs(shoal, 2, np.array([0.5, 3.0]))
    assert [owner for _, owner, _ in request_points(shoal, TRY, tries=(1, 2))] == [1]


def test_fish_without_a_better_position_moves_at_random():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    shoal.move_cost[1] = 1.5
    shoal.move_kind[1] = FOLLOW_MOVE
    shoal.move_position[1] = 0.15
    ((kind, owner, point),) = request_points(shoal, RANDOM_MOVE)
    assert (kind, owner) == (RANDOM_MOVE, 0)
    assert 0.0 < np.linalg.norm(point - 0.5) <= BEHAVIOUR.step
    behaviour.store_costs(shoal, 1, np.array([7.0]))
    moves = np.zeros(4, np.int64)
    behaviour.move_fish(shoal, moves)
    assert shoal.cost.tolist() == [7.0, 1.5]
    np.testing.assert_array_equal(shoal.position, [point, (0.15, 0.15)])
    assert moves.tolist() == [1, 0, 0, 1]


def test_step_out_of_the_box_is_clipped_to_its_wall():
    point = np.zeros(2)
    assert behaviour.point_toward(np.array([0.9, 0.5]), np.array([0.95, 0.5]), 0.3, point) == 1
    assert point.tolist() == [1.0, 0.5]
    assert behaviour.point_toward(np.array([0.1, 0.1]), np.array([0.0, 0.1]), 0.3, point) == 1
    assert point.tolist() == [0.0, 0.1]


def test_tries_and_random_steps_are_mirrored_into_the_box():
    """Without mirroring, in many dimensions half of all tries would be on walls."""
    shoal = shoal_of([(0.0, 1.0)] * 50, [1.0] * 50)
    points = np.array([point for _, _, point in request_points(shoal, TRY, RANDOM_MOVE)])
    assert points.min() > 0.0
    assert points.max() < 1.0
    assert points[:, 0].max() > 0.05
    assert points[:, 1].min() < 0.95


@given(st.floats(-10.0, 10.0))
def test_mirrored_coordinate_is_a_triangle_wave(coordinate):
    image = behaviour.mirror(coordinate)
    assert 0.0 <= image <= 1.0
    # a triangle wave with corners at the integers
    assert image == pytest.approx(abs(coordinate - 2.0 * round(coordinate / 2.0)), abs=1e-12)
    if 0.0 <= coordinate <= 1.0:
        assert image == coordinate


def test_bulletin_board_includes_each_evaluated_point():
    shoal = shoal_of(POSITIONS, COSTS)
    requests = request_points(shoal, CENTRE, TRY)
    costs = np.full(len(requests), 9.0)
    costs[4] = -3.0
    behaviour.store_costs(shoal, len(requests), costs)
    assert shoal.best_cost[0] == -3.0
    np.testing.assert_array_equal(shoal.best_position, requests[4][2])


def test_move_with_the_lowest_cost_is_made():
    shoal = shoal_of([(0.5, 0.5), (0.6, 0.5)], [5.0, 1.0])
    shoal.owner[:3] = 0
    shoal.kind[:3] = FOLLOW_MOVE, SWARM_MOVE, PREY_MOVE
    shoal.point[:3] = [(0.51, 0.5), (0.52, 0.5), (0.53, 0.5)]
    behaviour.store_costs(shoal, 3, np.array([4.0, 2.0, 3.0]))
    moves = np.zeros(4, np.int64)
    behaviour.move_fish(shoal, moves)
    assert shoal.position[0].tolist() == [0.52, 0.5]
    assert moves.tolist() == [0, 1, 0, 0]


def test_fish_that_has_improved_requests_no_more_points():
    shoal = shoal_of(POSITIONS, COSTS)
    shoal.move_cost[:2] = 0.0
    skipping_behaviour = BEHAVIOUR._replace(skips_after_improvement=True)
    assert {owner for _, owner, _ in request_points(shoal, FOLLOW_MOVE, CENTRE, TRY, settings=skipping_behaviour)} == {
        2,
        3,
    }


def test_stages_of_each_strategy():
    optimal = schedule(SwarmSettings(strategy="optimal", prey="best", tries=3))
    assert optimal.tolist() == [
        [bit(FOLLOW_MOVE, CENTRE, TRY), 0, 3],
        [bit(SWARM_MOVE, PREY_MOVE), 0, 0],
        [bit(RANDOM_MOVE), 0, 0],
    ]
    progress = schedule(SwarmSettings(strategy="progress", prey="first", tries=2))
    assert progress[:, 0].tolist() == [
        bit(kind) for kind in (FOLLOW_MOVE, CENTRE, SWARM_MOVE, TRY, TRY, PREY_MOVE, RANDOM_MOVE)
    ]
    assert progress[3:5, 1:].tolist() == [[0, 1], [1, 2]]


def test_initial_positions_have_a_fish_in_each_slice_of_each_side():
    shoal = new_shoal(SwarmSettings(fish=20), 3)
    scatter(shoal, np.random.default_rng(1))
    for dimension in range(3):
        assert sorted((shoal.position[:, dimension] * 20).astype(int)) == list(range(20))
