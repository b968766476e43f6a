"""Whose place is taken for whom."""

import random

import pytest

from firmware_py.link.peers import (
    MAX_ACTIVE_PEERS,
    MAX_PENDING_PEERS,
    MAX_UNKNOWN_PEERS,
    QUIET_S,
    Contender,
    select_evictions,
    select_pending_evictions,
)

NOW_S = 100.0


def guest(number, host="host", *, known=True, heard_s=NOW_S):
    return Contender((0, number), host, known, heard_s)


def test_no_peer_leaves_while_there_is_room():
    connections = [guest(number) for number in range(MAX_ACTIVE_PEERS - 1)]
    assert select_evictions(guest(99), connections, NOW_S) == ()


@pytest.mark.parametrize("known", [True, False])
def test_among_equals_of_one_address_only_silence_makes_room(known):
    connections = [guest(number, known=known) for number in range(MAX_ACTIVE_PEERS if known else MAX_UNKNOWN_PEERS)]
    assert select_evictions(guest(99, known=known), connections, NOW_S) is None
    silent = guest(50, known=known, heard_s=NOW_S - QUIET_S - 0.1)
    assert select_evictions(guest(99, known=known), [*connections[1:], silent], NOW_S) == (silent,)


def test_an_address_gives_up_places_until_both_have_as_many():
    crowd = [guest(number, "crowd", heard_s=NOW_S - number / 10) for number in range(MAX_ACTIVE_PEERS)]
    assert select_evictions(guest(99, "other"), crowd, NOW_S) == (crowd[-1],)
    half = MAX_ACTIVE_PEERS // 2
    shared = [*crowd[:half], *(guest(20 + number, "other") for number in range(half))]
    assert select_evictions(guest(99, "other"), shared, NOW_S) is None


def test_a_strangers_place_is_taken_first_however_alive_he_is():
    owners = [guest(number, heard_s=NOW_S - 200.0) for number in range(MAX_ACTIVE_PEERS - 1)]
    stranger = guest(50, "far", known=False)
    assert select_evictions(guest(99), [*owners, stranger], NOW_S) == (stranger,)


def test_a_stranger_takes_no_place_of_the_owners():
    owners = [guest(number, heard_s=NOW_S - 200.0) for number in range(MAX_ACTIVE_PEERS)]
    assert select_evictions(guest(99, "far", known=False), owners, NOW_S) is None


def test_whatever_comes_the_places_are_kept():
    drawn = random.Random(5)
    connections = []
    for step in range(2000):
        newcomer = guest(step, f"host {drawn.randrange(6)}", known=drawn.random() < 0.4, heard_s=step / 3)
        leaving = select_evictions(newcomer, connections, step / 3)
        if leaving is None:
            assert not newcomer.known or not [other for other in connections if not other.known]
            continue
        assert newcomer.known or not any(other.known for other in leaving)
        connections = [other for other in connections if other not in leaving] + [newcomer]
        assert len(connections) <= MAX_ACTIVE_PEERS
        assert sum(not other.known for other in connections) <= MAX_UNKNOWN_PEERS


def test_of_those_who_wait_one_of_the_address_with_the_most_leaves():
    crowd = [guest(number, "crowd", heard_s=float(number)) for number in range(MAX_PENDING_PEERS)]
    assert select_pending_evictions(crowd) == ()
    assert select_pending_evictions([guest(99, "other", heard_s=-1.0), *crowd]) == (crowd[0],)
