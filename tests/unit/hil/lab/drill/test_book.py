"""The drill book beside the firmware's own table of faults, which it is written apart from."""

import pytest

from firmware_py.faults.table import TABLE, Fault
from hil.lab.drill.book import BOOK
from hil.lab.drill.sail import MOMENTS, cases

# Each with the reason: what provokes it takes more than devices, a sea and an operator, and has a test of its own.
ELSEWHERE = {
    Fault.STORAGE_FULL: "fills the disk",
    Fault.KEY_LOST: "needs files of a key that are damaged",
    Fault.RUDDER_ASTRAY: "needs a hand at the shaft",
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
