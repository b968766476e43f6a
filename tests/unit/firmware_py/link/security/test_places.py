"""Whose place is taken for whom."""

import random

import pytest

from firmware_py.link.peers import PLACES, QUIET_S, STRANGERS_PLACES, WAITING, Guest, who_leaves, who_waits_no_more

NOW_S = 100.0


def guest(number, host="host", *, known=True, heard_s=NOW_S):
    return Guest((0, number), host, known, heard_s)


def test_nobody_leaves_while_there_is_room():
    guests = [guest(number) for number in range(PLACES - 1)]
    assert who_leaves(guest(99), guests, NOW_S) == ()


@pytest.mark.parametrize("known", [True, False])
def test_among_equals_of_one_address_only_silence_makes_room(known):
    guests = [guest(number, known=known) for number in range(PLACES if known else STRANGERS_PLACES)]
    assert who_leaves(guest(99, known=known), guests, NOW_S) is None
    silent = guest(50, known=known, heard_s=NOW_S - QUIET_S - 0.1)
    assert who_leaves(guest(99, known=known), [*guests[1:], silent], NOW_S) == (silent,)


def test_an_address_gives_up_places_until_both_have_as_many():
    crowd = [guest(number, "crowd", heard_s=NOW_S - number / 10) for number in range(PLACES)]
    assert who_leaves(guest(99, "other"), crowd, NOW_S) == (crowd[-1],)
    half = PLACES // 2
    shared = [*crowd[:half], *(guest(20 + number, "other") for number in range(half))]
    assert who_leaves(guest(99, "other"), shared, NOW_S) is None


def test_a_strangers_place_is_taken_first_however_alive_he_is():
    owners = [guest(number, heard_s=NOW_S - 200.0) for number in range(PLACES - 1)]
    stranger = guest(50, "far", known=False)
    assert who_leaves(guest(99), [*owners, stranger], NOW_S) == (stranger,)


def test_a_stranger_takes_no_place_of_the_owners():
    owners = [guest(number, heard_s=NOW_S - 200.0) for number in range(PLACES)]
    assert who_leaves(guest(99, "far", known=False), owners, NOW_S) is None


def test_whatever_comes_the_places_are_kept():
    drawn = random.Random(5)
    guests = []
    for step in range(2000):
        newcomer = guest(step, f"host {drawn.randrange(6)}", known=drawn.random() < 0.4, heard_s=step / 3)
        leaving = who_leaves(newcomer, guests, step / 3)
        if leaving is None:
            assert not newcomer.known or not [other for other in guests if not other.known]
            continue
        assert newcomer.known or not any(other.known for other in leaving)
        guests = [other for other in guests if other not in leaving] + [newcomer]
        assert len(guests) <= PLACES
        assert sum(not other.known for other in guests) <= STRANGERS_PLACES


def test_of_those_who_wait_one_of_the_address_with_the_most_leaves():
    crowd = [guest(number, "crowd", heard_s=float(number)) for number in range(WAITING)]
    assert who_waits_no_more(crowd) == ()
    assert who_waits_no_more([guest(99, "other", heard_s=-1.0), *crowd]) == (crowd[0],)
