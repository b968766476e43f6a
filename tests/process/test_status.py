"""`rambler status` of an autopilot that runs, hangs, was killed or has ended."""

import contextlib
import io
import json
import os
import signal
import socket
import stat
from contextlib import closing
from pathlib import Path

import pytest

from firmware_py import __version__
from firmware_py.__main__ import main
from firmware_py.system.status_file import DIRECTORIES, MAX_AGE_S, file_name
from support.json_keys import keys

CONTRACT = Path(__file__).parents[1] / "data" / "contract.json"
GUIDED = 15


def status_of(boat, *options):
    """Return the exit code and the output of the command."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        code = main(["status", "--state", str(boat.state), *options])
    return code, json.loads(output.getvalue()) if "--json" in options else output.getvalue()


def run_until_status(boat, expected):
    """Run the boat until it has a status."""
    return run_until(boat, lambda status: status["status"] == expected, "--json")


def run_until(boat, is_expected, *options):
    """Run the boat until the output of the command meets a condition; return exit code and output."""
    for _ in range(30):
        code, output = status_of(boat, *options)
        if is_expected(output):
            return code, output
        boat.run(1.0)
    pytest.fail(f"{output}\n{boat.output_text()}")
    return None


@pytest.fixture
def boat(make_boat):
    return make_boat(goals="0:25", speed=None)


def test_status_of_a_running_autopilot_and_its_age_after_a_hang_or_a_kill(boat):
    assert status_of(boat, "--json")[1]["status"] == "absent"
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as ground_station:
        ground_station.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{ground_station.getsockname()[1]}"
        boat.start("--link", url)
        boat.get_under_way(GUIDED)
        boat.run(4.0)
        code, status = status_of(boat, "--json")
    assert code == 0
    assert (status["status"], status["mode"], status["armed"]) == ("running", "GUIDED", True)
    assert set(json.loads(CONTRACT.read_text())["status"]) <= keys(status)
    assert status["goal_deg"] == pytest.approx(25.0, abs=0.01)
    assert status["pid"] == boat.process._process.pid
    assert status["versions"]["rambler"] == __version__
    assert status["starts"] == 1
    assert status["uptime_s"] > 3.0
    devices = {device["device"]: device for device in status["devices"]}
    assert devices["compass"]["state"] == devices["rudder"]["state"] == devices["position"]["state"] == "running"
    assert devices["compass"]["rate_hz"] > 5.0
    assert devices["compass"]["port"].endswith("compass")
    assert devices["storage"]["accepted"] > 0
    serial, udp = status["links"]
    assert (serial["url"].split(":")[0], serial["rates"]) == ("serial", "radio")
    (station,) = serial["peers"]
    assert station["ground_station"]
    assert station["heard_age_s"] < 5.0
    assert (udp["url"], udp["peers"][0]["heard_age_s"]) == (url, None)
    assert status["disk"]["free_mb"] > 0
    assert status["position"]["fix"] == "FIX_3D"
    assert status["energy"]["servo_power_w"] is not None
    path = next(path for path in (directory / file_name(boat.state) for directory in DIRECTORIES) if path.exists())
    assert stat.S_IMODE(path.stat().st_mode) == 0o640

    code, text = run_until(boat, lambda text: "faults        none" in text)
    assert (code, text.splitlines()[0].split(", updated")[0][-7:]) == (0, "running")
    for text_part in ("compass    nmea", "GUIDED", "station line  last frame", "nothing received", "free_mb"):
        assert text_part in text, text

    moved_state = boat.state.rename(boat.state.with_name("away"))  # as if the disk were unplugged
    code, status = status_of(boat, "--json")
    assert (code, status["status"], status["mode"]) == (0, "running", "GUIDED")
    assert "error" in status["disk"]
    moved_state.rename(boat.state)

    os.kill(boat.process._process.pid, signal.SIGSTOP)
    code, status = run_until_status(boat, "stale")
    assert (code, status["mode"]) == (1, "GUIDED")
    assert "hangs or is stopped" in status["reason"]
    assert status["age_s"] >= MAX_AGE_S  # rounded
    os.kill(boat.process._process.pid, signal.SIGCONT)
    run_until_status(boat, "running")
    boat.kill()
    code, status = status_of(boat, "--json")
    assert (code, status["status"], status["mode"]) == (1, "stale", "GUIDED")
    assert "ended unexpectedly" in status["reason"]
    assert "stale" in status_of(boat)[1].splitlines()[0]


def test_status_after_an_orderly_end_is_absent(boat):
    boat.start()
    run_until_status(boat, "running")
    boat.finish()
    code, status = status_of(boat, "--json")
    assert (code, status["status"]) == (1, "absent")
    assert "ended normally" in status["reason"]
    assert not any((directory / file_name(boat.state)).exists() for directory in DIRECTORIES)
