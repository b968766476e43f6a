"""`rambler-hil serve-json`: an external autopilot with the protocol of ArduPilot steers the simulated ship."""

import json
import math
import re
import signal
import socket
import struct
import sys
from contextlib import closing

import pytest

from support.harness import without_pictures
from support.program import Program

MAGIC = 18458  # of a packet with 16 servo outputs
RATE_HZ = 100  # the time of 6000 frames is a little less than a minute


def test_external_autopilot_is_scored_and_a_second_one_is_ignored(tmp_path):
    out = tmp_path / "out"
    words = ["serve-json", "tank", "--port", "0", "--seconds", "60", "--goal", "0:20", "--out", str(out)]
    with (
        closing(Program("ship", [sys.executable, "-m", "hil", *words], tmp_path, env=without_pictures())) as ship,
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as autopilot,
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other_autopilot,
    ):
        ship.expect("waiting on udp")
        port = int(re.search(r"udp 127\.0\.0\.1:(\d+);", ship.text())[1])
        autopilot.settimeout(20.0)
        autopilot.sendto(b"not a packet", ("127.0.0.1", port))
        steering_us, state = 1500, {"timestamp": 0.0}
        frame = 0
        while state["timestamp"] < 60.0 - 0.5 / RATE_HZ:
            frame += 1
            if frame == 100:  # another autopilot starts
                other_autopilot.sendto(struct.pack("<HHI16H", MAGIC, RATE_HZ, 1, *[1900] * 16), ("127.0.0.1", port))
            pulses = [steering_us] + [1500] * 15
            autopilot.sendto(struct.pack("<HHI16H", MAGIC, RATE_HZ, frame, *pulses), ("127.0.0.1", port))
            state = json.loads(autopilot.recv(4096))
            assert abs(state["timestamp"] * RATE_HZ - frame) < 1e-6
            error_rad = math.radians(20.0) - state["attitude"][2]
            command = 1.0 * error_rad - 3.0 * state["imu"]["gyro"][2]
            steering_us = round(1500 + 400 * max(-1.0, min(command / math.radians(30.0), 1.0)))
        assert ship.exit_code() == 0
    assert "a packet of 12 bytes" in ship.text()
    assert ship.text().count("is ignored while another one is active") == 1
    (goal,) = json.loads((out / "summary.json").read_text())["goals"]
    assert goal["rms_error_deg"] < 5.0
    assert (out / "report.html").exists()


@pytest.mark.proof
def test_interrupted_run_writes_a_page_and_reports_what_it_replaces(tmp_path):
    out = tmp_path / "out"
    words = [sys.executable, "-m", "hil", "serve-json", "tank", "--port", "0", "--out", str(out)]
    for replaced in (False, True):
        (out / "report.html").unlink(missing_ok=True)
        with closing(Program("ship", words, tmp_path, env=without_pictures())) as ship:
            ship.expect("waiting on udp")
            ship.send_signal(signal.SIGTERM)
            assert ship.exit_code() == 0
        assert "interrupted after 0 s" in ship.text()
        assert ("is replaced; another --out keeps both" in ship.text()) is replaced
        assert (out / "report.html").exists()
