"""A boat with an emulated Iridium modem, the gateway ashore, and a ground station that commands the boat."""

import subprocess
import sys

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from support.harness import NIMBLE_BOAT
from support.paths import ROOT
from support.program import Program, unused_ports

IMEI = "300234010753370"
HOLD, GUIDED = 4, 15


@pytest.fixture
def start_program():
    """Return a function that starts a program; the program ends with the test."""
    running = []

    def start(name, directory, *arguments):
        running.append(Program(name, [sys.executable, "-m", *map(str, arguments)], directory))
        return running[-1]

    yield start
    for program in reversed(running):
        program.close()


def test_station_receives_reports_and_sets_a_mode_by_satellite(tmp_path, start_program, request):
    key_file, state_directory, message_directory = tmp_path / "key.txt", tmp_path / "state", tmp_path / "messages"
    key_file.write_text("a passphrase\n")
    state_directory.mkdir()
    arguments = ["key", "set", "--state", str(state_directory), "--key-file", str(key_file)]
    subprocess.run([sys.executable, "-m", "firmware_py", *arguments], cwd=ROOT, check=True, capture_output=True)
    (tmp_path / "boat.toml").write_text(NIMBLE_BOAT)
    message_directory.mkdir()
    (port,) = unused_ports(["udpin"])
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="common", source_system=255)
    request.addfinalizer(station.close)
    gateway = start_program(
        "gateway", tmp_path, "hil", "sbd-gateway", message_directory,
        "--station", f"udpout:127.0.0.1:{port}", "--key-file", key_file,
    )  # fmt: skip
    hil = start_program(
        "hil", tmp_path, "hil", "run", "calm", "--play", "--seconds", 600, "--out", tmp_path / "run",
        "--vehicle", tmp_path / "boat.toml", "--state", state_directory, "--link", f"sbd:{message_directory}",
    )  # fmt: skip
    log_path = tmp_path / "run" / "firmware.log"

    def receive(kind, is_wanted):
        def find_message():
            message = station.recv_match(type=kind, blocking=False)
            return message if message is not None and is_wanted(message) else None

        return gateway.wait_for(find_message, f"no {kind}: {log_path.exists() and log_path.read_text()[-2000:]}")

    report = receive("HIGH_LATENCY2", lambda message: message.custom_mode == HOLD)
    assert report.get_srcSystem() == 1
    station.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
    assert receive("COMMAND_ACK", lambda _: True).result == mavlink.MAV_RESULT_IN_PROGRESS
    hil.wait_for(lambda: "Mode GUIDED" in log_path.read_text(), "the mode does not change")
    receive("HIGH_LATENCY2", lambda message: message.custom_mode == GUIDED)
    command = [sys.executable, "-m", "firmware_py", "status", "--state", str(tmp_path / "run" / "state")]
    output = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True).stdout
    assert f"modem {IMEI}" in output
    assert "credits" in output
    assert log_path.read_text().count("Mode GUIDED") == 1
