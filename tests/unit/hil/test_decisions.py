"""The comparison of two recomputations of a log, on made-up ones; tests/process/test_other_processor.py needs it."""

import json
import math

import pytest

from support.decisions import BOUND_RAD, Agreement, Tick, agreement, parts, read, recomputed
from support.paths import REPLAY

SAME = [Tick(0.1, {".mode": "1"}), Tick(0.2, {}), Tick(0.3, {})]


def with_third(rudder_rad, decisions):
    return [*SAME[:2], Tick(rudder_rad, decisions)]


def test_the_same_commands_agree_to_the_bit():
    assert agreement(SAME, list(SAME)) == Agreement(3, 0.0, "")


@pytest.mark.parametrize(("off_rad", "within"), [(4e-10, True), (2e-9, False), (math.nan, False)])
def test_commands_that_differ_are_measured_by_the_bound(off_rad, within):
    found = agreement(SAME, with_third(0.3 + off_rad, {}))
    assert (found.ticks, found.differs) == (3, "")
    assert (found.largest_rad <= BOUND_RAD) == within


def test_what_follows_a_decision_that_differs_does_not_count():
    later = [*with_third(0.9, {".side": "-1", ".taken": "True"}), Tick(1.0, {})]
    assert agreement([*SAME, Tick(0.4, {})], later) == Agreement(2, 0.0, "tick 2: .side")


def test_commands_that_are_no_numbers_agree_with_each_other():
    assert agreement(with_third(math.nan, {}), with_third(math.nan, {})) == Agreement(3, 0.0, "")


def test_a_tick_too_few_is_a_difference():
    assert agreement(SAME, SAME[:2]).differs == "tick 2 is missing in one of them"


def test_decisions_are_what_is_no_float():
    assert dict(parts((1, {"a": 2.0, "b": None}, [b"", "text"]))) == {".0": "1", ".1.b": "None", ".2.1": "'text'"}


def test_what_is_printed_of_a_log_reads_as_it_was():
    ticks = list(recomputed(REPLAY / "tank_pni_volz.BIN"))
    assert len(ticks) > 10
    assert any(tick.decisions for tick in ticks[1:])
    assert read("\n".join(map(json.dumps, ticks))) == ticks
