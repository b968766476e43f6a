"""The drills agree with the firmware's table of faults, which is written independently of them."""

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

# fault without a drill -> reason; other tests cover these faults
WITHOUT_DRILL = {
    Fault.STORAGE_FULL: "fills the disk",
    Fault.KEY_LOST: "needs files of a key that are damaged",
    Fault.RUDDER_ASTRAY: "needs an external force on the shaft",
    Fault.ESTIMATE_INCONSISTENT: "needs a filter with wrong noise levels (test_prediction_check.py)",
    Fault.VESSEL_NEAR: "needs other vessels (tests of encounters)",
}


@pytest.mark.parametrize("drill", [drill for drill in BOOK if drill.text], ids=lambda drill: drill.name)
def test_text_of_a_drill_belongs_to_one_fault(drill):
    (row,) = [row for row in TABLE.values() if row.text.startswith(drill.text)]
    assert row.recovery.startswith(drill.recovery)


def test_each_fault_has_a_drill_or_a_reason():
    faults_with_drill = {
        fault for fault, row in TABLE.items() for drill in BOOK if drill.text and row.text.startswith(drill.text)
    }
    assert faults_with_drill | set(WITHOUT_DRILL) == set(TABLE)
    assert not faults_with_drill & set(WITHOUT_DRILL)


def test_cases_are_all_situations_and_all_pairs():
    names = [drill.name for drill in BOOK]
    assert len(set(names)) == len(names)
    single_cases, all_cases = cases(BOOK, 1, pairs=False), cases(BOOK, 1, pairs=True)
    without_moment = [drill for drill in BOOK if not drill.moment]
    assert len(single_cases) == len(without_moment) * len(MOMENTS) + len(BOOK) - len(without_moment)
    combinable = sum(drill.can_pair for drill in BOOK)
    assert len(all_cases) - len(single_cases) == combinable * (combinable - 1) // 2


def drills_named(*names):
    return [drill for name in names for drill in BOOK if drill.name == name]


def test_inputs_are_listed_only_for_drills_with_pairs():
    combinable = {drill.name for drill in BOOK if drill.can_pair}
    assert set(REMOVED_INPUTS) | set(NEEDED_INPUTS) <= combinable
    assert {one for inputs in NEEDED_INPUTS.values() for one in inputs} <= {
        one for inputs_removed in REMOVED_INPUTS.values() for one in inputs_removed
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


def test_pair_in_which_one_fault_hides_the_other():
    silent, frozen = silent_pair = drills_named("compass silent", "compass frozen")
    assert (is_undetectable(silent, silent_pair), is_undetectable(frozen, silent_pair)) == (False, True)
    assert not has_no_heading(silent_pair)
    pair_without_heading = drills_named("compass frozen", "position lost")
    assert has_no_heading(pair_without_heading)
    assert "No valid heading" in explained_texts(pair_without_heading)
    assert not any(is_undetectable(drill, pair_without_heading) for drill in pair_without_heading)
    cable, low = pair = drills_named("servo's cable out", "battery low")
    assert (prevents_steering(cable, pair), prevents_steering(low, pair)) == (True, False)
