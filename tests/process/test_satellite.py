"""A boat with an emulated Iridium modem, the gateway ashore, and a ground station that commands the boat."""

import subprocess
import sys

import pytest
from pymavlink import mavutil

from support.harness import NIMBLE_BOAT
from support.paths import ROOT
from support.program import Program, unused_ports

IMEI = "300234010753370"
HOLD, GUIDED = 4, 15


@pytest.fixture
def programs():
    """Return a function that starts programs, which end with the test."""
    running = []

    def start(name, directory, *words):
        running.append(Program(name, [sys.executable, "-m", *map(str, words)], directory))
        return running[-1]

    yield start
    for program in reversed(running):
        program.close()


def test_station_receives_reports_and_sets_a_mode_by_satellite(tmp_path, programs, request):
    key, state, post = tmp_path / "key.txt", tmp_path / "state", tmp_path / "post"
    key.write_text("a passphrase\n")
    state.mkdir()
    words = ["key", "set", "--state", str(state), "--key-file", str(key)]
    subprocess.run([sys.executable, "-m", "firmware_py", *words], cwd=ROOT, check=True, capture_output=True)
    (tmp_path / "boat.toml").write_text(NIMBLE_BOAT)
    post.mkdir()
    (port,) = unused_ports(["udpin"])
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="common", source_system=255)
    request.addfinalizer(station.close)
    gateway = programs(
        "gateway", tmp_path, "hil", "sbd-gateway", post, "--station", f"udpout:127.0.0.1:{port}", "--key-file", key
    )
    hil = programs(
        "hil", tmp_path, "hil", "run", "calm", "--play", "--seconds", 600, "--out", tmp_path / "run",
        "--vehicle", tmp_path / "boat.toml", "--state", state, "--link", f"sbd:{post}",
    )  # fmt: skip
    log = tmp_path / "run" / "firmware.log"

    def receive(kind, is_wanted):
        def find_message():
            message = station.recv_match(type=kind, blocking=False)
            return message if message is not None and is_wanted(message) else None

        return gateway.wait_for(find_message, f"no {kind}: {log.exists() and log.read_text()[-2000:]}")

    report = receive("HIGH_LATENCY2", lambda message: message.custom_mode == HOLD)
    assert report.get_srcSystem() == 1
    station.mav.command_long_send(1, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0)
    assert receive("COMMAND_ACK", lambda _: True).result == 5  # in progress
    hil.wait_for(lambda: "Mode GUIDED" in log.read_text(), "the mode does not change")
    receive("HIGH_LATENCY2", lambda message: message.custom_mode == GUIDED)
    words = [sys.executable, "-m", "firmware_py", "status", "--state", str(tmp_path / "run" / "state")]
    output = subprocess.run(words, cwd=ROOT, check=False, capture_output=True, text=True).stdout
    assert f"modem {IMEI}" in output
    assert "credits" in output
    assert log.read_text().count("Mode GUIDED") == 1
