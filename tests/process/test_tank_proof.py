"""The whole tank task of the paper: five seeds, both compasses, both servos. Run by `make proof`."""

import json
import subprocess
import sys

import pytest

from support.paths import ROOT

pytestmark = [pytest.mark.proof, pytest.mark.timeout(900)]


@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("compass", ["nmea", "pni"])
@pytest.mark.parametrize("servo", ["dynamixel", "volz"])
def test_the_tank_task(tmp_path, figures, seed, compass, servo):
    words = ["run", "tank", "--speed", "max", "--seed", str(seed), "--compass", compass, "--servo", servo]
    words += ["--set", "CTL_MODE=0", "EST_MODE=0"]
    command = [sys.executable, "-m", "hil", *words, "--out", str(tmp_path)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
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
    for log in (tmp_path / "state" / "logs").glob("*.BIN"):
        replay = [sys.executable, "-m", "firmware_py", "replay", str(log)]
        assert subprocess.run(replay, cwd=ROOT, capture_output=True, check=False).returncode == 0
