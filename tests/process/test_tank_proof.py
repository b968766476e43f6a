"""The whole tank task of the paper: five seeds, both compasses, both servos. Run by `make proof`."""

import json

import pytest

from support.harness import rambler_hil, replays

pytestmark = [pytest.mark.proof, pytest.mark.timeout(900)]


@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("compass", ["nmea", "pni"])
@pytest.mark.parametrize("servo", ["dynamixel", "volz"])
def test_the_tank_task(tmp_path, figures, seed, compass, servo):
    words = ["run", "tank", "--speed", "max", "--seed", str(seed), "--compass", compass, "--servo", servo]
    words += ["--set", "CTL_MODE=0", "EST_MODE=0"]
    code, _, errors = rambler_hil(*words, "--out", tmp_path)
    assert code == 0, errors
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [goal["goal_deg"] for goal in summary["goals"]] == [0.0, 60.0, -90.0]
    case = f"seed {seed}, {compass}, {servo}"
    figures.keep("tank_proof_overshoot_60_deg", summary["goals"][1]["overshoot_deg"], "deg", case)
    for name in ("p95_error_deg", "rms_error_deg"):
        largest = max(goal[name] for goal in summary["goals"])
        figures.keep(f"tank_proof_{name.removesuffix('_error_deg')}", largest, "deg", case)
    for goal in summary["goals"]:
        assert goal["p95_error_deg"] <= 3.0
        assert goal["overshoot_deg"] <= 3.0
    assert replays(tmp_path)
