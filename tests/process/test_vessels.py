"""A crossing vessel, from AIS sentences to the log, with the real program."""

import json
import time
from contextlib import ExitStack

import pytest

from hil.bench.machine import children_of, memory_of
from support.harness import rambler_hil, replays, start_rambler_hil

WORDS = ("run", "tank", "--speed", "max", "--seconds", "40", "--goal", "0:0", "--with", "vessels=crossing:0")


def test_a_crossing_ship_is_reported_avoided_and_replayed(tmp_path):
    settings = ("--set", "AIS_ACT=1", "--set", "AIS_NEAR_S=2400")
    code, _, errors = rambler_hil(*WORDS, *settings, "--out", str(tmp_path))
    assert (code, errors) == (0, "")
    output = (tmp_path / "firmware.log").read_text()
    assert ": closest " in output
    assert "Vessel approaching" in output
    assert "Avoidance: heading" in output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["with"] == "vessels=crossing:0:40"
    (ship,) = summary["vessels"]
    assert ship["name"] == "CROSSING LADY"
    assert ship["closest_m"] > 10_000.0
    assert ship["at_s"] > 38.0  # it comes nearer to the last row
    assert replays(tmp_path)


@pytest.mark.proof
@pytest.mark.timeout(600)
def test_ten_thousand_ships_delay_no_tick(tmp_path):
    """In real time, as much as a line of 38400 baud carries: `pytest -m proof tests/process/test_vessels.py -s`.

    Beside the boat sails another one among six ships: what the machine does to one, it does to the other.
    """
    most_mib, loops = {"anchored": 0.0, "flood": 0.0}, {}
    with ExitStack() as stack:
        runs = {}
        for scene in most_mib:
            words = ["run", "sea", "--seconds", "120", "--goal", "0:30", "--with", f"vessels={scene}"]
            runs[scene] = stack.enter_context(start_rambler_hil(*words, "--out", tmp_path / scene))
        while any(run.poll() is None for run in runs.values()):
            for scene, run in runs.items():
                most_mib[scene] = max(most_mib[scene], *map(resident_mib, children_of(run.pid)), 0.0)
            time.sleep(1.0)
        assert [run.returncode for run in runs.values()] == [0, 0]
    for scene in runs:
        loops[scene] = loop = json.loads((tmp_path / scene / "summary.json").read_text())["loop"]
        print(f"{scene}: skipped {loop['skipped']}, late {loop['lateness_us']}, at most {most_mib[scene]:.1f} MiB")
    few, many = (loops[scene] for scene in ("anchored", "flood"))
    assert many["skipped"] <= 1.5 * few["skipped"]
    assert many["lateness_us"]["p50"] <= 2.0 * few["lateness_us"]["p50"] + 100.0
    assert many["lateness_us"]["p99"] <= 2.0 * few["lateness_us"]["p99"] + 1000.0


def resident_mib(pid):
    try:
        return memory_of(pid).now_mib
    except (OSError, KeyError):  # it has ended
        return 0.0
