"""The drill book beside the firmware's own table of faults, which it is written apart from."""

import pytest

from firmware_py.faults.table import TABLE, Fault
from hil.lab.drill.book import BOOK
from hil.lab.drill.sail import MOMENTS, cases
from hil.lab.drill.together import NEEDS, TAKES, explained, is_blind, is_hidden, stops_her

# Each with the reason: what provokes it takes more than devices, a sea and an operator, and has a test of its own.
ELSEWHERE = {
    Fault.STORAGE_FULL: "fills the disk",
    Fault.KEY_LOST: "needs files of a key that are damaged",
    Fault.RUDDER_ASTRAY: "needs a hand at the shaft",
    Fault.ESTIMATE_INCONSISTENT: "needs a filter with wrong noise levels (test_prediction_check.py)",
    Fault.VESSEL_NEAR: "needs other vessels, whose encounters are proven by the hundred",
}


@pytest.mark.parametrize("drill", [drill for drill in BOOK if drill.text], ids=lambda drill: drill.name)
def test_what_the_book_waits_for_is_said_by_one_fault(drill):
    (row,) = [row for row in TABLE.values() if row.text.startswith(drill.text)]
    assert row.recovery.startswith(drill.recovery)


def test_every_fault_has_a_drill_or_a_reason():
    drilled = {
        fault for fault, row in TABLE.items() for drill in BOOK if drill.text and row.text.startswith(drill.text)
    }
    assert drilled | set(ELSEWHERE) == set(TABLE)
    assert not drilled & set(ELSEWHERE)


def test_each_is_sailed_at_each_moment_and_in_pairs():
    names = [drill.name for drill in BOOK]
    assert len(set(names)) == len(names)
    single, both = cases(BOOK, 1, pairs=False), cases(BOOK, 1, pairs=True)
    free = [drill for drill in BOOK if not drill.moment]
    assert len(single) == len(free) * len(MOMENTS) + len(BOOK) - len(free)
    able = sum(drill.pair for drill in BOOK)
    assert len(both) - len(single) == able * (able - 1) // 2


def named(*names):
    return [drill for name in names for drill in BOOK if drill.name == name]


def test_what_one_takes_from_another_is_asked_of_pairs_of_the_book_alone():
    able = {drill.name for drill in BOOK if drill.pair}
    assert set(TAKES) | set(NEEDS) <= able
    assert {one for needs in NEEDS.values() for one in needs} <= {one for takes in TAKES.values() for one in takes}
    for drill in BOOK:
        assert not any((is_hidden(drill, [drill]), is_blind([drill]), explained([drill]), stops_her(drill, [drill])))


def test_a_pair_is_not_asked_for_what_one_of_it_hides():
    silent, frozen = both = named("compass silent", "compass frozen")
    assert (is_hidden(silent, both), is_hidden(frozen, both)) == (False, True)
    assert not is_blind(both)
    without = named("compass frozen", "position lost")
    assert is_blind(without)
    assert "No valid heading" in explained(without)
    assert not any(is_hidden(drill, without) for drill in without)
    cable, low = pair = named("servo's cable out", "battery low")
    assert (stops_her(cable, pair), stops_her(low, pair)) == (True, False)
