"""Detection of retries and duplicates of commands."""

import pytest
from msgspec.structs import replace

from firmware_py.link.commands.server import CommandMemory, CommandRecord
from firmware_py.link.peers import PeerPath, Station

DUPLICATE_S = 10.0

RETRY_S, SATELLITE_RETRY_S, RELATIVE_RETRY_S, REPEAT_S, OVERTAKEN_S = 5.0, 600.0, 30.0, 1.0, 2.0
MAX_COMMANDS = 32
ARM = 400
STATION = (255, 190)  # system and component
EPSILON_S = 1e-3


class Peer:
    """The attributes of a peer that the memory reads."""

    def __init__(self, *, is_satellite=False):
        self.is_satellite = is_satellite
        self.path = PeerPath(None, 0.0)


RADIO, SATELLITE = Station(Peer(), STATION), Station(Peer(is_satellite=True), STATION)
ON = CommandRecord(1000.0, 7, b"on", is_int=True, station=RADIO)
OFF = replace(ON, content=b"off")


def find_original(new, *records, is_retry=False, relative=False):
    memory = CommandMemory()
    for stored in records:
        memory.store(ARM, stored, relative=relative)
    return memory.find_duplicate(ARM, new, is_retry=is_retry, relative=relative)


@pytest.mark.parametrize(("peer", "max_age_s"), [(RADIO, RETRY_S), (SATELLITE, SATELLITE_RETRY_S)])
def test_retry_belongs_to_the_last_command_within_a_time(peer, max_age_s):
    record = replace(ON, station=peer)
    soon, late = (replace(record, t_s=1000.0 + max_age_s + excess_s, sequence=99) for excess_s in (-EPSILON_S, 0.0))
    assert find_original(soon, record, is_retry=True) is record
    assert find_original(late, record, is_retry=True) is None
    assert find_original(replace(soon, content=b"off"), record, is_retry=True) is None
    assert find_original(replace(soon, is_int=False), record, is_retry=True) is None


@pytest.mark.parametrize("sequence", [7, 200])
@pytest.mark.parametrize(("ahead", "is_duplicate"), [(0, True), (-1, True), (-127, True), (-128, False), (1, False)])
def test_recent_frame_without_a_later_sequence_number_is_a_duplicate(sequence, ahead, is_duplicate):
    record = replace(ON, sequence=sequence)
    new = replace(record, t_s=1000.0 + OVERTAKEN_S - EPSILON_S, sequence=(sequence + ahead) % 256)
    assert find_original(new, record) is (record if is_duplicate else None)
    assert find_original(replace(new, t_s=1000.0 + OVERTAKEN_S), record) is None


@pytest.mark.parametrize(
    ("peer", "max_age_s"), [(Peer(), RELATIVE_RETRY_S), (Peer(is_satellite=True), SATELLITE_RETRY_S)]
)
@pytest.mark.parametrize("others", [(), (OFF,)])
def test_retry_of_a_relative_command_is_detected_longer_and_on_any_path(peer, max_age_s, others):
    retry = replace(ON, sequence=99, station=Station(peer, STATION))
    soon, late = (replace(retry, t_s=1000.0 + max_age_s + excess_s) for excess_s in (-EPSILON_S, 0.0))
    assert find_original(soon, ON, *others, is_retry=True, relative=True) is ON
    assert find_original(late, ON, *others, is_retry=True, relative=True) is None
    assert find_original(soon, ON, *others, relative=True) is None
    assert find_original(soon, ON, *others, is_retry=True) is None
    assert find_original(replace(soon, content=b"other"), ON, *others, is_retry=True, relative=True) is None


def test_duplicate_of_a_relative_command_on_another_path_that_existed_then_is_detected():
    old_path, new_path = Peer(), Peer()
    new_path.path = PeerPath(None, ON.t_s + OVERTAKEN_S)
    duplicate, restarted = (
        replace(ON, t_s=1000.0 + DUPLICATE_S - EPSILON_S, station=Station(peer, STATION))
        for peer in (old_path, new_path)
    )
    assert find_original(duplicate, ON, relative=True) is ON
    assert find_original(replace(duplicate, t_s=1000.0 + DUPLICATE_S), ON, relative=True) is None
    assert find_original(replace(duplicate, sequence=8), ON, relative=True) is None
    assert find_original(duplicate, ON) is None
    assert find_original(restarted, ON, relative=True) is None
    assert (
        find_original(replace(duplicate, station=RADIO), ON, relative=True) is None
    )  # on the same path it is a new command


@pytest.mark.parametrize("is_int", [True, False])
def test_relative_command_int_that_is_repeated_soon_is_a_retry(is_int):
    record = replace(ON, is_int=is_int)
    soon, late = (replace(record, t_s=1000.0 + REPEAT_S + excess_s, sequence=8) for excess_s in (-EPSILON_S, 0.0))
    assert find_original(soon, record, relative=True) is (record if is_int else None)
    assert find_original(soon, record) is None
    assert find_original(late, record, relative=True) is None


def test_delayed_duplicate_after_the_opposite_command_is_detected():
    opposite = replace(OFF, t_s=1000.1, sequence=8)
    duplicate = replace(ON, t_s=1000.0 + OVERTAKEN_S - EPSILON_S)
    assert find_original(duplicate, ON, opposite) is ON
    assert find_original(replace(duplicate, t_s=1000.0 + OVERTAKEN_S), ON, opposite) is None
    assert find_original(replace(duplicate, sequence=9), ON, opposite) is None  # a new command
    assert find_original(replace(duplicate, content=b"other"), ON, opposite) is None
    assert find_original(duplicate, ON, replace(opposite, sequence=7)) is None  # a sender that does not count


def test_four_records_of_each_command_are_stored():
    records = [replace(ON, content=bytes([number]), sequence=number) for number in range(5)]
    assert [find_original(replace(record, t_s=1000.5), *records) for record in records] == [None, *records[1:]]


def test_commands_of_other_stations_and_peers_are_separate():
    memory = CommandMemory()
    memory.store(ARM, ON)
    options = {"is_retry": True, "relative": False}
    assert memory.find_duplicate(ARM, ON, **options) is ON
    other = replace(ON, station=Station(RADIO.peer, (254, 190)))
    assert memory.find_duplicate(ARM, other, **options) is None
    assert memory.find_duplicate(ARM + 1, ON, **options) is None
    assert memory.find_duplicate(ARM, replace(ON, station=SATELLITE), **options) is None


def test_number_of_commands_is_limited_and_the_oldest_are_removed():
    memory = CommandMemory()
    for command in range(MAX_COMMANDS):
        memory.store(command, ON)
    memory.store(0, ON)
    for command in range(MAX_COMMANDS, MAX_COMMANDS + 5):
        memory.store(command, ON)
    commands = range(MAX_COMMANDS + 5)
    stored = [number for number in commands if memory.find_duplicate(number, ON, is_retry=True, relative=False)]
    assert stored == [0, *range(6, MAX_COMMANDS + 5)]
    assert len(memory) == MAX_COMMANDS


def test_result_is_stored_with_its_sequence_number():
    memory = CommandMemory()
    later = replace(OFF, sequence=8)
    memory.store(ARM, ON)
    memory.store(ARM, later)
    memory.set_result(RADIO, ARM, 7, 0)
    memory.set_result(RADIO, ARM, 9, 4)
    assert memory.find_duplicate(ARM, later, is_retry=True, relative=False) == later
    assert memory.find_duplicate(ARM, ON, is_retry=False, relative=False) == replace(ON, result=0)
