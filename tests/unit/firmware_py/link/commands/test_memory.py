"""Which of two commands are one: retries and doubles, reported apart from what is asked again."""

import pytest
from msgspec.structs import replace

from firmware_py.link.commands.server import (
    OVERTAKEN_S,
    RELATIVE_RETRY_S,
    REMEMBERED,
    REPEAT_S,
    RETRY_S,
    SATELLITE_RETRY_S,
    CommandMemory,
    CommandRecord,
)
from firmware_py.link.peers import DUPLICATE_S, PeerPath, Station

ARM = 400
STATION = (255, 190)
SHORTLY = 1e-3


class Peer:
    """All that a memory asks of a peer."""

    def __init__(self, *, quiet=False):
        self.quiet = quiet
        self.path = PeerPath(None, 0.0)


RADIO, SATELLITE = Station(Peer(), STATION), Station(Peer(quiet=True), STATION)
ON = CommandRecord(1000.0, 7, b"on", is_int=True, station=RADIO)
OFF = replace(ON, content=b"off")


def original(now, *done, confirmed=False, relative=False):
    memory = CommandMemory()
    for record in done:
        memory.remember(ARM, record, relative=relative)
    return memory.find_duplicate(ARM, now, confirmed=confirmed, relative=relative)


@pytest.mark.parametrize(("peer", "longest_s"), [(RADIO, RETRY_S), (SATELLITE, SATELLITE_RETRY_S)])
def test_a_confirmation_is_of_the_command_before_it_for_a_while(peer, longest_s):
    before = replace(ON, station=peer)
    soon, late = (replace(before, t_s=1000.0 + longest_s + more_s, sequence=99) for more_s in (-SHORTLY, SHORTLY))
    assert original(soon, before, confirmed=True) is before
    assert original(late, before, confirmed=True) is None
    assert original(replace(soon, content=b"off"), before, confirmed=True) is None
    assert original(replace(soon, is_int=False), before, confirmed=True) is None


@pytest.mark.parametrize("sequence", [7, 200])
@pytest.mark.parametrize(("ahead", "again"), [(0, True), (-1, True), (-127, True), (-128, False), (1, False)])
def test_what_comes_soon_with_no_later_number_came_twice(sequence, ahead, again):
    before = replace(ON, sequence=sequence)
    now = replace(before, t_s=1000.0 + OVERTAKEN_S - SHORTLY, sequence=(sequence + ahead) % 256)
    assert original(now, before) is (before if again else None)
    assert original(replace(now, t_s=1000.0 + OVERTAKEN_S + SHORTLY), before) is None


@pytest.mark.parametrize(("peer", "longest_s"), [(Peer(), RELATIVE_RETRY_S), (Peer(quiet=True), SATELLITE_RETRY_S)])
@pytest.mark.parametrize("others", [(), (OFF,)])
def test_a_relative_command_that_is_confirmed_is_one_for_longer_and_by_any_way(peer, longest_s, others):
    again = replace(ON, sequence=99, station=Station(peer, STATION))
    soon, late = (replace(again, t_s=1000.0 + longest_s + more_s) for more_s in (-SHORTLY, SHORTLY))
    assert original(soon, ON, *others, confirmed=True, relative=True) is ON
    assert original(late, ON, *others, confirmed=True, relative=True) is None
    assert original(soon, ON, *others, relative=True) is None
    assert original(soon, ON, *others, confirmed=True) is None
    assert original(replace(soon, content=b"other"), ON, *others, confirmed=True, relative=True) is None


def test_a_relative_command_is_one_with_the_same_frame_by_a_way_that_was_there_then():
    other, later = Peer(), Peer()
    later.path = PeerPath(None, ON.t_s + OVERTAKEN_S)
    there, new = (replace(ON, t_s=1000.0 + DUPLICATE_S - SHORTLY, station=Station(p, STATION)) for p in (other, later))
    assert original(there, ON, relative=True) is ON
    assert original(replace(there, t_s=1000.0 + DUPLICATE_S + SHORTLY), ON, relative=True) is None
    assert original(replace(there, sequence=8), ON, relative=True) is None
    assert original(there, ON) is None
    assert original(new, ON, relative=True) is None
    assert original(replace(there, station=RADIO), ON, relative=True) is None  # the same way: so long after it is new


@pytest.mark.parametrize("is_int", [True, False])
def test_what_is_asked_relative_to_now_in_whole_numbers_and_soon_repeated_is_one(is_int):
    before = replace(ON, is_int=is_int)
    soon, late = (replace(before, t_s=1000.0 + REPEAT_S + more_s, sequence=8) for more_s in (-SHORTLY, SHORTLY))
    assert original(soon, before, relative=True) is (before if is_int else None)
    assert original(soon, before) is None
    assert original(late, before, relative=True) is None


def test_a_double_of_an_earlier_one_that_comes_behind_its_contrary_is_not_done_again():
    contrary = replace(OFF, t_s=1000.1, sequence=8)
    double = replace(ON, t_s=1000.0 + OVERTAKEN_S - SHORTLY)
    assert original(double, ON, contrary) is ON
    assert original(replace(double, t_s=1000.0 + OVERTAKEN_S + SHORTLY), ON, contrary) is None
    assert original(replace(double, sequence=9), ON, contrary) is None  # ordered again
    assert original(replace(double, content=b"other"), ON, contrary) is None
    assert original(double, ON, replace(contrary, sequence=7)) is None  # a sender that does not count


def test_of_one_command_the_latest_few_are_known():
    several = [replace(ON, content=bytes([number]), sequence=number) for number in range(5)]
    assert [original(replace(one, t_s=1000.5), *several) for one in several] == [None, *several[1:]]


def test_what_others_asked_is_not_ones_own():
    memory = CommandMemory()
    memory.remember(ARM, ON)
    options = {"confirmed": True, "relative": False}
    assert memory.find_duplicate(ARM, ON, **options) is ON
    other = replace(ON, station=Station(RADIO.peer, (254, 190)))
    assert memory.find_duplicate(ARM, other, **options) is None
    assert memory.find_duplicate(ARM + 1, ON, **options) is None
    assert memory.find_duplicate(ARM, replace(ON, station=SATELLITE), **options) is None


def test_a_bounded_number_of_commands_is_known_the_latest_used():
    memory = CommandMemory()
    for command in range(REMEMBERED):
        memory.remember(command, ON)
    memory.remember(0, ON)
    for command in range(REMEMBERED, REMEMBERED + 5):
        memory.remember(command, ON)
    known = [
        command
        for command in range(REMEMBERED + 5)
        if memory.find_duplicate(command, ON, confirmed=True, relative=False)
    ]
    assert known == [0, *range(6, REMEMBERED + 5)]
    assert len(memory) == REMEMBERED


def test_a_result_is_that_of_the_command_of_its_number():
    memory = CommandMemory()
    later = replace(OFF, sequence=8)
    memory.remember(ARM, ON)
    memory.remember(ARM, later)
    memory.set_result(RADIO, ARM, 7, 0)
    memory.set_result(RADIO, ARM, 9, 4)
    assert memory.find_duplicate(ARM, later, confirmed=True, relative=False) == later
    assert memory.find_duplicate(ARM, ON, confirmed=False, relative=False) == replace(ON, result=0)
