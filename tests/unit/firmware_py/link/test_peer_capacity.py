"""Eviction of peers when a link is full."""

import random

import pytest

from firmware_py.link.peers import Contender, select_evictions, select_pending_evictions

MAX_ACTIVE_PEERS = 8
MAX_PENDING_PEERS = 16
MAX_UNKNOWN_PEERS = 4
QUIET_S = 10.0

NOW_S = 100.0


def contender(number, host="host", *, is_owner=True, frame_s=NOW_S):
    return Contender((0, number), host, is_owner, frame_s)


def test_no_peer_is_evicted_while_there_is_capacity():
    connections = [contender(number) for number in range(MAX_ACTIVE_PEERS - 1)]
    assert select_evictions(contender(99), connections, NOW_S) == ()
    unknown = [contender(number, is_owner=False) for number in range(MAX_UNKNOWN_PEERS - 1)]
    assert select_evictions(contender(99, is_owner=False), unknown, NOW_S) == ()


@pytest.mark.parametrize("is_owner", [True, False])
def test_only_a_silent_peer_is_evicted_among_equals_of_one_host(is_owner):
    count = MAX_ACTIVE_PEERS if is_owner else MAX_UNKNOWN_PEERS
    connections = [contender(number, is_owner=is_owner) for number in range(count)]
    assert select_evictions(contender(99, is_owner=is_owner), connections, NOW_S) is None
    quiet = contender(50, is_owner=is_owner, frame_s=NOW_S - QUIET_S)
    assert select_evictions(contender(99, is_owner=is_owner), [*connections[1:], quiet], NOW_S) is None
    silent = contender(50, is_owner=is_owner, frame_s=NOW_S - QUIET_S - 0.1)
    assert select_evictions(contender(99, is_owner=is_owner), [*connections[1:], silent], NOW_S) == (silent,)


def test_host_with_most_peers_loses_peers_until_both_have_equal_numbers():
    crowd = [contender(number, "crowd", frame_s=NOW_S - number / 10) for number in range(MAX_ACTIVE_PEERS)]
    assert select_evictions(contender(99, "other"), crowd, NOW_S) == (crowd[-1],)
    half = MAX_ACTIVE_PEERS // 2
    shared = [*crowd[:half], *(contender(20 + number, "other") for number in range(half))]
    assert select_evictions(contender(99, "other"), shared, NOW_S) is None
    shared[-1] = crowd[half]  # five and three
    assert select_evictions(contender(99, "other"), shared, NOW_S) == (crowd[half],)
    mixed = [*crowd[:half], *(contender(number, "other") for number in range(20, 23)), contender(60, "third")]
    assert select_evictions(contender(99, "other"), mixed, NOW_S) is None  # four and three
    assert select_evictions(contender(99, "third"), mixed, NOW_S) == (crowd[half - 1],)


def test_unknown_peer_is_evicted_before_silent_owners():
    owners = [contender(number, frame_s=NOW_S - 200.0) for number in range(MAX_ACTIVE_PEERS - 1)]
    unknown = contender(50, "far", is_owner=False)
    assert select_evictions(contender(99), [*owners, unknown], NOW_S) == (unknown,)


def test_unknown_peer_evicts_no_owner():
    owners = [contender(number, frame_s=NOW_S - 200.0) for number in range(MAX_ACTIVE_PEERS)]
    assert select_evictions(contender(99, "far", is_owner=False), owners, NOW_S) is None


def test_random_newcomers_keep_the_limits():
    rng = random.Random(5)
    connections = []
    for step in range(2000):
        newcomer = contender(step, f"host {rng.randrange(6)}", is_owner=rng.random() < 0.4, frame_s=step / 3)
        evictions = select_evictions(newcomer, connections, step / 3)
        if evictions is None:
            assert not newcomer.is_owner or not [other for other in connections if not other.is_owner]
            continue
        assert newcomer.is_owner or not any(other.is_owner for other in evictions)
        connections = [other for other in connections if other not in evictions] + [newcomer]
        assert len(connections) <= MAX_ACTIVE_PEERS
        assert sum(not other.is_owner for other in connections) <= MAX_UNKNOWN_PEERS


def test_pending_peer_of_the_host_with_most_is_evicted():
    crowd = [contender(number, "crowd", frame_s=float(number)) for number in range(MAX_PENDING_PEERS)]
    assert select_pending_evictions(crowd) == ()
    assert select_pending_evictions([contender(99, "other", frame_s=-1.0), *crowd]) == (crowd[0],)
