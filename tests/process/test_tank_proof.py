"""The tank task of the paper with five seeds, with default parameters and with fixed gains. Run by `make proof`."""

import json

import pytest

from support.harness import is_replay_identical, rambler_hil

pytestmark = [pytest.mark.proof, pytest.mark.timeout(900)]


# Prefix of the names of the figures -> options.
CONTROLLERS = {"tank_proof_delivered": [], "tank_proof": ["--set", "CTL_MODE=0", "EST_MODE=0"]}


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("compass", ["nmea", "pni"])
@pytest.mark.parametrize("servo", ["dynamixel", "volz", "feetech"])
def test_tank_task_meets_the_error_limits(tmp_path, figures, name, seed, compass, servo):
    words = ["run", "tank", "--speed", "max", "--seed", str(seed), "--compass", compass, "--servo", servo]
    code, _, errors = rambler_hil(*words, *CONTROLLERS[name], "--out", tmp_path)
    assert code == 0, errors
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [goal["goal_deg"] for goal in summary["goals"]] == [0.0, 60.0, -90.0]
    case = f"seed {seed}, {compass}, {servo}"
    figures.keep(f"{name}_overshoot_60_deg", summary["goals"][1]["overshoot_deg"], "deg", case)
    for figure in ("p95_error_deg", "rms_error_deg"):
        largest = max(goal[figure] for goal in summary["goals"])
        figures.keep(f"{name}_{figure.removesuffix('_error_deg')}", largest, "deg", case)
    for goal in summary["goals"]:
        assert goal["p95_error_deg"] <= 3.0
        assert goal["overshoot_deg"] <= 3.0
    assert is_replay_identical(tmp_path)
