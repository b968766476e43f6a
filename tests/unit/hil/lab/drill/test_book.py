"""The drills agree with the firmware's table of faults, which is written independently."""

import pytest

from firmware_py.faults.table import TABLE, Fault
from hil.lab.drill.book import BOOK
from hil.lab.drill.cases import (
    MOMENTS,
    NEEDED_INPUTS,
    REMOVED_INPUTS,
    cases,
    explained_texts,
    has_no_heading,
    is_undetectable,
    prevents_steering,
)

# Faults without a drill and the reason; they have tests of their own.
ELSEWHERE = {
    Fault.STORAGE_FULL: "fills the disk",
    Fault.KEY_LOST: "needs files of a key that are damaged",
    Fault.RUDDER_ASTRAY: "needs an external force on the shaft",
    Fault.ESTIMATE_INCONSISTENT: "needs a filter with wrong noise levels (test_prediction_check.py)",
    Fault.VESSEL_NEAR: "needs other vessels (tests of encounters)",
}


@pytest.mark.parametrize("drill", [drill for drill in BOOK if drill.text], ids=lambda drill: drill.name)
def test_each_text_belongs_to_one_fault(drill):
    (row,) = [row for row in TABLE.values() if row.text.startswith(drill.text)]
    assert row.recovery.startswith(drill.recovery)


def test_every_fault_has_a_drill_or_a_reason():
    drilled = {
        fault for fault, row in TABLE.items() for drill in BOOK if drill.text and row.text.startswith(drill.text)
    }
    assert drilled | set(ELSEWHERE) == set(TABLE)
    assert not drilled & set(ELSEWHERE)


def test_cases_are_all_situations_and_all_pairs():
    names = [drill.name for drill in BOOK]
    assert len(set(names)) == len(names)
    single, both = cases(BOOK, 1, pairs=False), cases(BOOK, 1, pairs=True)
    free = [drill for drill in BOOK if not drill.moment]
    assert len(single) == len(free) * len(MOMENTS) + len(BOOK) - len(free)
    able = sum(drill.pair for drill in BOOK)
    assert len(both) - len(single) == able * (able - 1) // 2


def named(*names):
    return [drill for name in names for drill in BOOK if drill.name == name]


def test_inputs_are_named_for_drills_with_pairs_only():
    able = {drill.name for drill in BOOK if drill.pair}
    assert set(REMOVED_INPUTS) | set(NEEDED_INPUTS) <= able
    assert {one for needs in NEEDED_INPUTS.values() for one in needs} <= {
        one for takes in REMOVED_INPUTS.values() for one in takes
    }
    for drill in BOOK:
        assert not any(
            (
                is_undetectable(drill, [drill]),
                has_no_heading([drill]),
                explained_texts([drill]),
                prevents_steering(drill, [drill]),
            )
        )


def test_a_fault_that_hides_the_other_of_a_pair():
    silent, frozen = both = named("compass silent", "compass frozen")
    assert (is_undetectable(silent, both), is_undetectable(frozen, both)) == (False, True)
    assert not has_no_heading(both)
    without = named("compass frozen", "position lost")
    assert has_no_heading(without)
    assert "No valid heading" in explained_texts(without)
    assert not any(is_undetectable(drill, without) for drill in without)
    cable, low = pair = named("servo's cable out", "battery low")
    assert (prevents_steering(cable, pair), prevents_steering(low, pair)) == (True, False)
