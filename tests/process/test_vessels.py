"""A crossing vessel with the real program, from AIS sentences to the log."""

import json
import time
from contextlib import ExitStack

import pytest

from hil.bench.machine import children_of, memory_of
from support.harness import is_replay_identical, rambler_hil, start_rambler_hil

RUN_WITH_VESSEL = ("run", "tank", "--speed", "max", "--seconds", "40", "--goal", "0:0", "--with", "vessels=crossing:0")


def test_crossing_vessel_is_reported_avoided_and_replayed(tmp_path):
    settings = ("--set", "AIS_ACT=1", "--set", "AIS_NEAR_S=2400")
    code, _, errors = rambler_hil(*RUN_WITH_VESSEL, *settings, "--out", str(tmp_path))
    assert (code, errors) == (0, "")
    output = (tmp_path / "firmware.log").read_text()
    assert ": closest " in output
    assert "Vessel approaching" in output
    assert "Avoidance: heading" in output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["with"] == "vessels=crossing:0:40"
    (vessel,) = summary["vessels"]
    assert vessel["name"] == "CROSSING LADY"
    assert vessel["closest_m"] > 10_000.0
    assert vessel["at_s"] > 38.0  # it approaches until the end
    assert is_replay_identical(tmp_path)


@pytest.mark.proof
@pytest.mark.timeout(600)
def test_ten_thousand_vessels_delay_no_tick(tmp_path):
    """In real time, at the capacity of 38400 baud: `pytest -m proof tests/process/test_vessels.py -s`.

    A second run with six vessels at the same time is the reference for the load of the machine.
    """
    max_mib, loops = {"anchored": 0.0, "flood": 0.0}, {}
    with ExitStack() as stack:
        runs = {}
        for kind in max_mib:
            words = ["run", "sea", "--seconds", "120", "--goal", "0:30", "--with", f"vessels={kind}"]
            runs[kind] = stack.enter_context(start_rambler_hil(*words, "--out", tmp_path / kind))
        while any(run.poll() is None for run in runs.values()):
            for kind, run in runs.items():
                max_mib[kind] = max(max_mib[kind], *map(resident_mib, children_of(run.pid)), 0.0)
            time.sleep(1.0)
        assert [run.returncode for run in runs.values()] == [0, 0]
    for kind in runs:
        loops[kind] = loop = json.loads((tmp_path / kind / "summary.json").read_text())["loop"]
        print(f"{kind}: skipped {loop['skipped']}, late {loop['lateness_us']}, at most {max_mib[kind]:.1f} MiB")
    anchored, flood = (loops[kind] for kind in ("anchored", "flood"))
    assert flood["skipped"] <= 1.5 * anchored["skipped"]
    assert flood["lateness_us"]["p50"] <= 2.0 * anchored["lateness_us"]["p50"] + 100.0
    assert flood["lateness_us"]["p99"] <= 2.0 * anchored["lateness_us"]["p99"] + 1000.0


def resident_mib(pid):
    try:
        return memory_of(pid).now_mib
    except (OSError, KeyError):  # the process has ended
        return 0.0
