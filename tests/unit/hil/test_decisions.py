"""The comparison of two recomputations of a log, which tests/process/test_other_processor.py needs."""

import math
import subprocess
import sys

import pytest

from support import decisions
from support.decisions import BOUND_RAD, Agreement, Tick, agreement, parts, read, recomputed
from support.paths import REPLAY, ROOT

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
    assert dict(parts((1, 2.0, None, (b"", "text")))) == {".0": "1", ".2": "None", ".3.1": "'text'"}


def test_another_process_makes_the_same_decisions_in_every_tick_of_a_log(tmp_path):
    log = tmp_path / "begin.BIN"
    whole = (REPLAY / "tank_pni_volz.BIN").read_bytes()
    log.write_bytes(whole[: len(whole) // 4])
    printed = subprocess.run(
        [sys.executable, decisions.__file__, str(log)], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    ticks = list(recomputed(log))
    assert len(ticks) > 10
    assert any(tick.decisions for tick in ticks[1:])
    assert agreement(ticks, read(printed)) == Agreement(len(ticks), 0.0, "")
