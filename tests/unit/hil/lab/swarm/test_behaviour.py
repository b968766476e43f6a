"""Each behaviour of the fish against the paper's words."""

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

BEHAVIOUR = Behaviour(reach=0.3, step=0.1, congestion=0.1, content=False)


def shoal_of(places, costs, tries=2, seed=1):
    """A shoal in two dimensions that has looked around, with its random numbers drawn."""
    shoal = new_shoal(SwarmSettings(fish=len(places), tries=tries), 2)
    shoal.place[:] = places
    shoal.cost[:] = costs
    rng = np.random.default_rng(seed)
    rng.random(out=shoal.uniforms)
    rng.standard_normal(out=shoal.normals)
    behaviour.begin(shoal)
    behaviour.find_partners(shoal, BEHAVIOUR.reach)
    return shoal


def bit(*kinds):
    return sum(1 << kind for kind in kinds)


def requested(shoal, *kinds, settings=BEHAVIOUR, tries=(0, 2)):
    count = behaviour.request_points(shoal, bit(*kinds), *tries, settings)
    return [
        (int(kind), int(owner), point.copy())
        for kind, owner, point in zip(shoal.kind[:count], shoal.owner[:count], shoal.point[:count], strict=True)
    ]


# Fish 0 and 1 see each other and fish 2; fish 3 is alone.
PLACES = [(0.2, 0.2), (0.3, 0.2), (0.2, 0.4), (0.9, 0.9)]
COSTS = [4.0, 3.0, 1.0, 2.0]


def test_a_fish_sees_those_within_its_vision_and_not_itself():
    shoal = shoal_of(PLACES, COSTS)
    assert shoal.partners.tolist() == [2, 2, 2, 0]
    assert shoal.leader.tolist() == [2, 2, 1, NONE]
    np.testing.assert_allclose(shoal.centre[0], (0.25, 0.3))


def test_a_fish_at_the_edge_of_vision_is_seen():
    shoal = shoal_of([(0.0, 0.0), (0.3, 0.0), (0.0, 0.30001)], [1.0, 2.0, 3.0])
    assert shoal.partners.tolist() == [1, 1, 0]


def test_food_is_the_share_of_the_shoal_with_higher_cost():
    shoal = shoal_of(PLACES, COSTS)
    assert shoal.share.tolist() == [0.0, 0.25, 0.75, 0.5]


@pytest.mark.parametrize("change", [lambda y: y - 1e6, lambda y: -1.0 / y, np.exp, lambda y: 1e-200 * y])
def test_food_does_not_depend_on_sign_or_scale(change):
    shoal = shoal_of(PLACES, change(np.array(COSTS)))
    assert shoal.share.tolist() == [0.0, 0.25, 0.75, 0.5]


def test_following_goes_toward_the_best_partner_and_no_further_than_a_step():
    shoal = shoal_of(PLACES, COSTS)
    moves = requested(shoal, FOLLOW_MOVE)
    # Fish 2 is itself the best of those it sees, fish 3 has no partner.
    assert [(kind, owner) for kind, owner, _ in moves] == [(FOLLOW_MOVE, 0), (FOLLOW_MOVE, 1)]
    for _, owner, point in moves:
        way, aim = point - shoal.place[owner], shoal.place[2] - shoal.place[owner]
        assert 0.0 < np.linalg.norm(way) <= BEHAVIOUR.step
        assert way @ aim == pytest.approx(np.linalg.norm(way) * np.linalg.norm(aim))


def test_a_crowded_leader_is_not_followed():
    # Food of the leader 0.75 around which there are 2: 0.75 / 2 > kappa * 0.25 up to kappa 1.5 for fish 1.
    crowd = [(0.5, 0.5)] * 9 + [(0.6, 0.5)]
    shoal = shoal_of(crowd, [*range(1, 10), 0.0])
    # The best (share 0.9) has 9 around it: 0.1 > kappa * share.
    follows = [owner for _, owner, _ in requested(shoal, FOLLOW_MOVE, settings=BEHAVIOUR._replace(congestion=0.2))]
    assert follows == [owner for owner in range(9) if 0.2 * shoal.share[owner] < 0.1]
    assert 0 < len(follows) < 9


def test_without_congestion_every_better_leader_is_followed():
    shoal = shoal_of([(0.5, 0.5)] * 9 + [(0.6, 0.5)], [*range(1, 10), 0.0])
    assert len(requested(shoal, FOLLOW_MOVE, settings=BEHAVIOUR._replace(congestion=0.0))) == 9


def test_an_equal_leader_is_not_followed():
    shoal = shoal_of([(0.5, 0.5), (0.6, 0.5)], [1.0, 1.0])
    assert requested(shoal, FOLLOW_MOVE) == []


def test_swarming_evaluates_the_centre_and_steps_toward_a_good_one():
    shoal = shoal_of(PLACES, COSTS)
    centres = requested(shoal, CENTRE)
    assert [owner for _, owner, _ in centres] == [0, 1, 2]
    # Good for fish 0 (better than 3 of 4), good for 1, without food for 2.
    behaviour.store_costs(shoal, 3, np.array([1.5, 2.5, 5.0]))
    moves = requested(shoal, SWARM_MOVE)
    assert [owner for _, owner, _ in moves] == [0, 1]
    for _, owner, point in moves:
        way, aim = point - shoal.place[owner], shoal.centre[owner] - shoal.place[owner]
        assert way @ aim == pytest.approx(np.linalg.norm(way) * np.linalg.norm(aim))
        assert np.linalg.norm(way) <= BEHAVIOUR.step


def test_a_crowded_centre_is_avoided():
    shoal = shoal_of(PLACES, COSTS)
    requested(shoal, CENTRE)
    behaviour.store_costs(shoal, 3, np.array([1.5, 2.5, 2.5]))
    # Fish 2: food of the centre 0.5 over 2 partners, its own 0.75: up to kappa 1/3.
    assert 2 in [owner for _, owner, _ in requested(shoal, SWARM_MOVE, settings=BEHAVIOUR._replace(congestion=0.33))]
    assert 2 not in [
        owner for _, owner, _ in requested(shoal, SWARM_MOVE, settings=BEHAVIOUR._replace(congestion=0.34))
    ]


def test_a_fish_in_the_middle_of_its_partners_stays():
    shoal = shoal_of([(0.5, 0.5), (0.4, 0.5), (0.6, 0.5)], [9.0, 1.0, 1.0])
    requested(shoal, CENTRE)
    behaviour.store_costs(shoal, 3, np.array([0.0, np.inf, np.inf]))
    assert requested(shoal, SWARM_MOVE) == []


def test_tries_are_distributed_within_vision():
    tries = 400
    shoal = shoal_of([(0.5, 0.5), (0.5, 0.5)], [1.0, 2.0], tries=tries)
    points = np.array([point for _, owner, point in requested(shoal, TRY, tries=(0, tries)) if owner == 0])
    behaviour = points - 0.5
    distances = np.linalg.norm(behaviour, axis=1)
    assert len(points) == tries
    assert distances.max() <= BEHAVIOUR.reach
    assert distances.max() > 0.95 * BEHAVIOUR.reach
    angles = np.arctan2(behaviour[:, 1], behaviour[:, 0])
    assert np.histogram(angles, bins=4, range=(-math.pi, math.pi))[0].min() > tries / 6


def test_preying_steps_toward_the_best_of_better_tries_only():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    looked = requested(shoal, TRY)
    assert [owner for _, owner, _ in looked] == [0, 0, 1, 1]
    behaviour.store_costs(shoal, 4, np.array([0.9, 0.8, 2.0, np.nan]))
    ((kind, owner, point),) = requested(shoal, PREY_MOVE)
    assert (kind, owner) == (PREY_MOVE, 0)
    aim, way = looked[1][2] - 0.5, point - 0.5
    assert way @ aim == pytest.approx(np.linalg.norm(way) * np.linalg.norm(aim))


def test_a_fish_with_prey_does_not_try_again():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    requested(shoal, TRY, tries=(0, 1))
    behaviour.store_costs(shoal, 2, np.array([0.5, 3.0]))
    assert [owner for _, owner, _ in requested(shoal, TRY, tries=(1, 2))] == [1]


def test_a_fish_without_a_better_place_moves_at_random():
    shoal = shoal_of([(0.5, 0.5), (0.1, 0.1)], [1.0, 2.0])
    shoal.move_cost[1] = 1.5
    shoal.move_kind[1] = FOLLOW_MOVE
    shoal.move_place[1] = 0.15
    ((kind, owner, point),) = requested(shoal, RANDOM_MOVE)
    assert (kind, owner) == (RANDOM_MOVE, 0)
    assert 0.0 < np.linalg.norm(point - 0.5) <= BEHAVIOUR.step
    behaviour.store_costs(shoal, 1, np.array([7.0]))
    moves = np.zeros(4, np.int64)
    behaviour.move_fish(shoal, moves)
    assert shoal.cost.tolist() == [7.0, 1.5]
    np.testing.assert_array_equal(shoal.place, [point, (0.15, 0.15)])
    assert moves.tolist() == [1, 0, 0, 1]


def test_a_step_that_leaves_the_box_ends_at_its_wall():
    point = np.zeros(2)
    assert behaviour.point_toward(np.array([0.9, 0.5]), np.array([0.95, 0.5]), 0.3, point) == 1
    assert point.tolist() == [1.0, 0.5]
    assert behaviour.point_toward(np.array([0.1, 0.1]), np.array([0.0, 0.1]), 0.3, point) == 1
    assert point.tolist() == [0.0, 0.1]


def test_tries_and_random_steps_are_mirrored_into_the_box():
    """In many dimensions half of all looks would otherwise be at walls, which are no part of the box worth that."""
    shoal = shoal_of([(0.0, 1.0)] * 50, [1.0] * 50)
    points = np.array([point for _, _, point in requested(shoal, TRY, RANDOM_MOVE)])
    assert points.min() > 0.0
    assert points.max() < 1.0
    assert points[:, 0].max() > 0.05
    assert points[:, 1].min() < 0.95


@given(st.floats(-10.0, 10.0))
def test_walls_are_mirrors(coordinate):
    image = behaviour.mirror(coordinate)
    assert 0.0 <= image <= 1.0
    # As a zigzag with corners at the whole numbers.
    assert image == pytest.approx(abs(coordinate - 2.0 * round(coordinate / 2.0)), abs=1e-12)
    if 0.0 <= coordinate <= 1.0:
        assert image == coordinate


def test_the_bulletin_board_includes_every_evaluated_point():
    shoal = shoal_of(PLACES, COSTS)
    found = requested(shoal, CENTRE, TRY)
    costs = np.full(len(found), 9.0)
    costs[4] = -3.0
    behaviour.store_costs(shoal, len(found), costs)
    assert shoal.best_cost[0] == -3.0
    np.testing.assert_array_equal(shoal.best_place, found[4][2])


def test_the_move_that_helps_most_is_taken():
    shoal = shoal_of([(0.5, 0.5), (0.6, 0.5)], [5.0, 1.0])
    shoal.owner[:3] = 0
    shoal.kind[:3] = FOLLOW_MOVE, SWARM_MOVE, PREY_MOVE
    shoal.point[:3] = [(0.51, 0.5), (0.52, 0.5), (0.53, 0.5)]
    behaviour.store_costs(shoal, 3, np.array([4.0, 2.0, 3.0]))
    moves = np.zeros(4, np.int64)
    behaviour.move_fish(shoal, moves)
    assert shoal.place[0].tolist() == [0.52, 0.5]
    assert moves.tolist() == [0, 1, 0, 0]


def test_a_content_fish_requests_no_more_points():
    shoal = shoal_of(PLACES, COSTS)
    shoal.move_cost[:2] = 0.0
    content = BEHAVIOUR._replace(content=True)
    assert {owner for _, owner, _ in requested(shoal, FOLLOW_MOVE, CENTRE, TRY, settings=content)} == {2, 3}


def test_the_stages_of_each_strategy():
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


def test_the_shoal_starts_with_a_fish_in_every_slice_of_every_side():
    shoal = new_shoal(SwarmSettings(fish=20), 3)
    scatter(shoal, np.random.default_rng(1))
    for dimension in range(3):
        assert sorted((shoal.place[:, dimension] * 20).astype(int)) == list(range(20))
