"""`rambler calibrate rudder` as a process, with an emulated servo in real time."""

import json
import subprocess
import sys

import pytest

from support.paths import ROOT


@pytest.mark.parametrize("servo", ["dynamixel", pytest.param("volz", marks=pytest.mark.proof)])
def test_rudder_is_measured_in_small_steps(make_boat, servo):
    boat = make_boat(speed=None, servo=servo, settings={"RUD_LIMIT_DEG": 1})
    boat.time.begin(boat.board, None)
    command = [sys.executable, "-m", "firmware_py", "calibrate", "rudder", str(boat._vehicle), "--json"]
    command += ["--state", str(boat.state)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as program:
        while program.poll() is None:
            boat.run(0.2)
        result = json.loads(program.stdout.read())
    assert (program.returncode, result["stopped"]) == (0, [False, False])
    assert result["proposed_deg"] == {"RUD_LIMIT_DEG": 1.0}
    assert result["reached_deg"] == pytest.approx([6.0, 6.0], abs=0.5)
    assert result["scale"] == pytest.approx(1.0, abs=0.05)
