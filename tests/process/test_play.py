"""`rambler-hil run --play`: a ground station commands and ends the run."""

import contextlib
import json
import signal
import sys
from contextlib import closing

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.modes import Mode
from support.harness import without_pictures
from support.program import Program
from support.station import Station


@contextlib.contextmanager
def playing(tmp_path, speed):
    """Start a run with --play at a speed; yield the program and a ground station."""
    with closing(mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="ardupilotmega")) as link:
        url = "udpout:{}:{}".format(*link.port.getsockname())
        words = ["run", "calm", "--play", "--speed", speed, "--link", url, "--out", tmp_path / "out"]
        command = [sys.executable, "-m", "hil", *map(str, words)]
        with closing(Program("play", command, tmp_path, env=without_pictures())) as program:
            yield program, Station(link, tmp_path)


def read_summary(tmp_path):
    return json.loads((tmp_path / "out" / "summary.json").read_text())


def test_station_commands_a_run_and_a_signal_ends_it(tmp_path):
    with playing(tmp_path, "20") as (program, station):
        program.expect("Ctrl-C ends the run")
        heartbeat = station.receive("HEARTBEAT")
        assert not heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED  # without a goal
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED
        for mode in (Mode.GUIDED, Mode.HOLD, Mode.MANUAL):
            assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, mode.value) == mavlink.MAV_RESULT_ACCEPTED
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == mavlink.MAV_RESULT_ACCEPTED
        program.send_signal(signal.SIGINT)
        assert program.exit_code() == 0
    summary = read_summary(tmp_path)
    assert (summary["ending"], 0.0 < summary["seconds"] < 1e6) == ("finished", True)
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.proof
def test_shutdown_by_the_station_ends_the_run_with_its_figures(tmp_path):
    with playing(tmp_path, "real") as (program, station):
        station.receive("HEARTBEAT")
        assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 2.0) == mavlink.MAV_RESULT_ACCEPTED
        assert program.exit_code() == 0
    assert "shut down the autopilot" in program.text()
    assert read_summary(tmp_path)["ending"] == "finished"
