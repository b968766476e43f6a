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
def test_the_tank_task(tmp_path, seed, compass, servo):
    words = ["run", "tank", "--speed", "max", "--seed", str(seed), "--compass", compass, "--servo", servo]
    words += ["--set", "CTL_MODE=0", "EST_MODE=0"]
    command = [sys.executable, "-m", "hil", *words, "--out", str(tmp_path)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [goal["goal_deg"] for goal in summary["goals"]] == [0.0, 60.0, -90.0]
    line = [seed, compass, servo]
    for goal in summary["goals"]:
        line += [goal["overshoot_deg"], goal["p95_error_deg"], goal["rms_error_deg"]]
        assert goal["p95_error_deg"] <= 3.0
        assert goal["overshoot_deg"] <= 3.0
    print(*line, f"{summary['rudder_travel_deg_per_h']:.0f}", f"{summary['speed_ratio']:.0f}x")
    for log in (tmp_path / "state" / "logs").glob("*.BIN"):
        replay = [sys.executable, "-m", "firmware_py", "replay", str(log)]
        assert subprocess.run(replay, cwd=ROOT, capture_output=True, check=False).returncode == 0
