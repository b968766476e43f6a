"""`rambler check` as a process, with devices that send data."""

import json
import subprocess
import sys

from support.paths import ROOT


def check(boat, *words):
    """Run the check while the devices of the boat send data; return exit code and result."""
    command = [sys.executable, "-m", "firmware_py", "check", str(boat._vehicle), "--state", str(boat.state), *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as program:
        while program.poll() is None:
            boat.run(0.2)
        return program.returncode, json.loads(program.stdout.read())


def findings_by_subject(result):
    return {row["subject"]: row for row in result["findings"]}


def test_devices_pass_and_another_protocol_is_distinguished_from_silence(make_boat):
    boat = make_boat(speed=None)
    boat.time.begin(boat.board, None)
    code, result = check(boat, "--json")
    findings = findings_by_subject(result)
    assert (code, result["verdict"] in ("pass", "warn")) == (0, True), result
    assert [findings[name]["level"] for name in ("compass", "position", "rudder", "links")] == ["pass"] * 4
    assert findings["compass"]["rate_hz"] > 5.0
    assert findings["position"]["fix"] == "FIX_3D"

    boat._vehicle.write_text(boat._vehicle.read_text().replace('driver = "nmea"', 'driver = "pni_tcm"', 1))
    code, result = check(boat, "--json")
    findings = findings_by_subject(result)
    assert (code, result["verdict"], findings["compass"]["level"]) == (1, "fail", "fail")
    assert "data not understood: wrong baud rate?" in findings["compass"]["text"]
    assert findings["position"]["level"] == "pass"
