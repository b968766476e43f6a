"""Speed of campaigns, printed without a limit: `pytest -m proof -s tests/process/test_campaign_speed.py`."""

import json

import pytest

from hil.lab.campaign import store
from support.harness import rambler_hil

pytestmark = [pytest.mark.proof, pytest.mark.timeout(7200)]

MILLION = 1e6
FIRMWARE = """
engine = "firmware"
runs = {runs}
seconds = 600
goals = "0:0,120:60"
scenarios = ["tank", "sea", "swell", "weak+float"]
[ship]
K = {{uniform = [0.8, 1.25]}}
T = {{uniform = [0.8, 1.25]}}
speed = {{uniform = [0.85, 1.15]}}
[with]
receiver = {{lost = {{uniform = [0.0, 0.1]}}}}
[set]
CTL_PRICE = [0.7, 1.0, 1.4]
"""
COMPILED = """
engine = "compiled"
runs = {runs}
seconds = 1200
goals = "0:0,120:60,720:-30"
scenarios = ["tank", "sea", "swell", "weak+float"]
[ship]
K = {{uniform = [0.8, 1.25]}}
T = {{uniform = [0.8, 1.25]}}
speed = {{uniform = [0.85, 1.15]}}
"""


def run_campaign(directory, text, workers, *words):
    """Run a campaign; return its figures and the bytes of its results."""
    path = directory / f"{workers}.toml"
    path.write_text(text)
    out = directory / f"by-{workers}"
    code, _, errors = rambler_hil("campaign", path, "--out", out, "--workers", workers, *words)
    assert code == 0, errors
    return json.loads((out / store.SUMMARY).read_text()), (out / store.RUNS).read_bytes()


@pytest.mark.parametrize(("name", "text", "runs"), [("autopilot", FIRMWARE, 200), ("twin", COMPILED, 4096)])
def test_one_and_two_workers_give_equal_results(tmp_path, name, text, runs):
    one_worker, results_of_one = run_campaign(tmp_path, text.format(runs=runs), 1)
    two_workers, results_of_two = run_campaign(tmp_path, text.format(runs=runs), 2)
    assert results_of_one == results_of_two
    assert {row["ended"] for row in store.read_table(tmp_path / "by-2" / store.RUNS).to_pylist()} == {"finished"}
    efficiency = two_workers["runs_per_s"] / (2.0 * one_worker["runs_per_s"])
    for figures in (one_worker, two_workers):
        per_run_s = figures["processor_s"] / runs
        print(
            f"\n{name}, workers {figures['workers']}: {runs} runs of {figures['seconds']:g} s"
            f" in {figures['wall_s']:.0f} s, {figures['runs_per_s']:.3g} a second, {per_run_s:.3g} s of processor each;"
            f" a million would take {MILLION / figures['runs_per_s'] / 3600.0:.2f} h"
        )
    print(f"parallel efficiency of two workers: {100.0 * efficiency:.0f} %")
