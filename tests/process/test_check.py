"""`rambler check` from outside, on devices that speak."""

import json
import subprocess
import sys

from support.paths import ROOT


def check(boat, *words):
    """Check a boat whose devices go on speaking meanwhile."""
    command = [sys.executable, "-m", "firmware_py", "check", str(boat._vehicle), "--state", str(boat.state), *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as program:
        while program.poll() is None:
            boat.run(0.2)
        return program.returncode, json.loads(program.stdout.read())


def by_subject(result):
    return {row["subject"]: row for row in result["findings"]}


def test_a_device_with_another_protocol_is_distinguished_from_a_silent_one(make_boat):
    boat = make_boat(speed=None)
    boat.time.begin(boat.board, None)
    code, result = check(boat, "--json")
    found = by_subject(result)
    assert (code, result["verdict"] in ("pass", "warn")) == (0, True), result
    assert [found[name]["level"] for name in ("compass", "position", "rudder", "links")] == ["pass"] * 4
    assert found["compass"]["rate_hz"] > 5.0
    assert found["position"]["fix"] == "FIX_3D"

    boat._vehicle.write_text(boat._vehicle.read_text().replace('driver = "nmea"', 'driver = "pni_tcm"', 1))
    code, result = check(boat, "--json")
    found = by_subject(result)
    assert (code, result["verdict"], found["compass"]["level"]) == (1, "fail", "fail")
    assert "data not understood: wrong baud rate?" in found["compass"]["text"]
    assert found["position"]["level"] == "pass"
