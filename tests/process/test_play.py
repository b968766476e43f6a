"""`rambler-hil run --play`: a ground station steers and ends the run."""

import json
import signal
import sys
from contextlib import closing

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.modes import Mode
from support.harness import without_pictures
from support.program import Program, unused_ports
from support.station import Station


def test_a_station_steers_and_ends_a_run_with_play(tmp_path):
    (port,) = unused_ports(["udpin"])
    out = tmp_path / "out"
    words = ["run", "calm", "--play", "--speed", "20", "--link", f"udpout:127.0.0.1:{port}", "--out", str(out)]
    with (
        closing(Program("play", [sys.executable, "-m", "hil", *words], tmp_path, env=without_pictures())) as play,
        closing(mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")) as link,
    ):
        play.expect("Ctrl-C ends the run")
        station = Station(link, tmp_path)
        assert not station.receive("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED  # no goal was given
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED
        for mode in (Mode.GUIDED, Mode.HOLD, Mode.MANUAL):
            assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, mode.value) == mavlink.MAV_RESULT_ACCEPTED
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == mavlink.MAV_RESULT_ACCEPTED
        play.send_signal(signal.SIGINT)
        assert play.exit_code() == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["ending"] == "finished"
    assert 0.0 < summary["seconds"] < 1e6
    assert (out / "report.html").exists()


@pytest.mark.proof
def test_a_shutdown_by_the_station_ends_a_run_with_its_figures(tmp_path):
    (port,) = unused_ports(["udpin"])
    out = tmp_path / "out"
    words = ["run", "calm", "--play", "--speed", "real", "--link", f"udpout:127.0.0.1:{port}", "--out", str(out)]
    with (
        closing(Program("play", [sys.executable, "-m", "hil", *words], tmp_path, env=without_pictures())) as play,
        closing(mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")) as link,
    ):
        station = Station(link, tmp_path)
        station.receive("HEARTBEAT")
        command = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
        assert station.command(command, 2.0) == mavlink.MAV_RESULT_ACCEPTED
        assert play.exit_code() == 0
    assert "shut down the autopilot" in play.text()
    assert json.loads((out / "summary.json").read_text())["ending"] == "finished"
