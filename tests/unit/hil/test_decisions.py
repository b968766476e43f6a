"""Comparison of two recomputations of a log, for tests/process/test_other_processor.py."""

import math
import subprocess
import sys

import pytest

from support import decisions
from support.decisions import MAX_DIFFERENCE_RAD, Agreement, Tick, compare, discrete_parts, read, recompute
from support.paths import REPLAY, ROOT

SAME = [Tick(0.1, {".mode": "1"}), Tick(0.2, {}), Tick(0.3, {})]


def with_third(rudder_rad, decisions):
    return [*SAME[:2], Tick(rudder_rad, decisions)]


def test_equal_commands_agree():
    assert compare(SAME, list(SAME)) == Agreement(3, 0.0, "")


@pytest.mark.parametrize(("difference_rad", "is_within"), [(4e-10, True), (2e-9, False), (math.nan, False)])
def test_difference_of_commands_is_compared_with_the_bound(difference_rad, is_within):
    compared = compare(SAME, with_third(0.3 + difference_rad, {}))
    assert (compared.ticks, compared.first_difference) == (3, "")
    assert (compared.max_difference_rad <= MAX_DIFFERENCE_RAD) == is_within


def test_ticks_after_a_different_decision_are_ignored():
    later = [*with_third(0.9, {".side": "-1", ".taken": "True"}), Tick(1.0, {})]
    assert compare([*SAME, Tick(0.4, {})], later) == Agreement(2, 0.0, "tick 2: .side")


def test_nan_commands_agree():
    assert compare(with_third(math.nan, {}), with_third(math.nan, {})) == Agreement(3, 0.0, "")


def test_missing_tick_is_a_difference():
    assert compare(SAME, SAME[:2]).first_difference == "tick 2 is missing in one of them"


def test_all_values_but_floats_are_decisions():
    assert dict(discrete_parts((1, 2.0, None, (b"", "text")))) == {".0": "1", ".2": "None", ".3.1": "'text'"}


def test_another_process_makes_the_same_decisions(tmp_path):
    log = tmp_path / "begin.BIN"
    content = (REPLAY / "tank_pni_volz.BIN").read_bytes()
    log.write_bytes(content[: len(content) // 4])
    output = subprocess.run(
        [sys.executable, decisions.__file__, str(log)], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    ticks = list(recompute(log))
    assert len(ticks) > 10
    assert any(tick.decisions for tick in ticks[1:])
    assert compare(ticks, read(output)) == Agreement(len(ticks), 0.0, "")
