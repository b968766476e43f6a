"""MAVSDK 4 against a running HIL: what it reads is right, and what it asks for is done."""

import importlib
import importlib.util
import json
import math
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from firmware_py import __version__
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from hil.sim.truth import ROWS_PER_SECOND
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG

CLIENT = Path(__file__).with_name("mavsdk_client.py")
VOYAGE = Path(__file__).with_name("mavsdk_voyage.py")
STATIONS = Path(__file__).parents[2] / "docs/how-to/ground-stations.md"
CANNOT_BE_HAD = 77
SESSION_S = 90.0  # at most; a quarter of a minute on an idle machine
METRES_PER_DEGREE = 111_195.0


def test_mavsdk_reads_and_commands_the_boat(tmp_path, start, start_hil):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    hil = start_hil("udpout")
    seen = run_client(CLIENT, tmp_path, start, hil)
    truth = hil.end()
    check_identity(seen)
    check_telemetry(seen)
    check_parameters(seen)
    check_commands(seen)
    check_against_truth(seen, truth)


def run_client(script, tmp_path, start, hil):
    """Let a client do its work and return what it has seen."""
    results = tmp_path / "seen.json"
    client = start("mavsdk", [sys.executable, str(script), f"udpin://127.0.0.1:{hil.ports[0]}", str(results)])
    code = client.exit_code(SESSION_S)
    if code == CANNOT_BE_HAD:
        pytest.skip(client.text().strip().splitlines()[-1])
    if code != 0:
        client.fail(f"it ended with code {code}")
    return json.loads(results.read_text())


def test_the_lines_of_the_handbook_find_the_boat(tmp_path, start, free_ports):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    (port,) = free_ports(["udpin"])
    (lines,) = re.findall(r"```python\n(from mavsdk .*?)```", STATIONS.read_text(), re.DOTALL)
    assert lines.count("0.0.0.0:14550") == 1
    script = tmp_path / "lines.py"
    script.write_text(lines.replace("0.0.0.0:14550", f"127.0.0.1:{port}") + "print('system', boat.get_system_id())\n")
    client = start("mavsdk", [sys.executable, str(script)])
    mavutil = importlib.import_module("pymavlink.mavutil")  # takes 0.3 s
    boat = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1)
    while client.running():
        boat.mav.heartbeat_send(11, 3, 0, 0, 4)  # a surface boat with ArduPilot's identity, active
        time.sleep(0.1)
    boat.close()
    assert "system 1" in client.text()


@pytest.mark.proof
def test_mavsdk_runs_a_mission(tmp_path, start, start_hil):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    hil = start_hil("udpout", speed="10", seconds=3600)
    seen = run_client(VOYAGE, tmp_path, start, hil)
    truth = hil.end()
    assert [number for number in seen["progress"] if number] == [1, 2, 3]
    for north_m, east_m in ((20.0, 0.0), (20.0, 15.0)):
        assert np.hypot(truth.north_m - north_m, truth.east_m - east_m).min() < 6.0


def check_identity(seen):
    assert (seen["system"], seen["components"], seen["autopilot"]) == (1, [1], "ARDUPILOT")
    version = seen["version"]
    number = [version[f"flight_sw_{part}"] for part in ("major", "minor", "patch")]
    assert number == [int(part) for part in __version__.split(".")[:3]]


def check_telemetry(seen):
    assert all(seen["health"].values()), seen["health"]
    assert seen["mode"] == "OFFBOARD"  # MAVSDK's name for ArduRover's GUIDED
    for name in ("position", "home"):
        assert metres_from_start(seen[name]) < 50.0
    assert -13.0 < seen["attitude_euler"]["yaw_deg"] < 3.0  # turning from 0 to -10
    assert seen["gps_info"]["fix_type"] == 3
    assert 4.0 < seen["battery"]["voltage_v"] < 30.0
    assert 0.0 < math.hypot(seen["velocity_ned"]["north_m_s"], seen["velocity_ned"]["east_m_s"]) < 1.0


def metres_from_start(position):
    north_m = METRES_PER_DEGREE * (position["latitude_deg"] - START_LATITUDE_DEG)
    east_m = METRES_PER_DEGREE * (position["longitude_deg"] - START_LONGITUDE_DEG)
    return math.hypot(north_m, east_m * math.cos(math.radians(START_LATITUDE_DEG)))


def check_parameters(seen):
    changed = {"MDL_K": 0.4, "MDL_T_S": 0.5, "MDL_ALPHA_S2": 0.0, "STAT_BOOTCNT": 1}  # of the boat
    expected = {row.name: changed.get(row.name, row.default) for row in TABLE}
    reals = {row.name for row in TABLE if row.kind is Kind.REAL}
    assert seen["float_params"] == pytest.approx({name: expected[name] for name in reals})
    assert seen["int_params"] == {name: expected[name] for name in expected.keys() - reals}
    assert seen["custom_params"] == 0
    assert seen["read_back"] == [33.25, 12]
    assert (seen["too_large"], seen["not_a_number"]) == ("VALUE_OUT_OF_RANGE", "VALUE_OUT_OF_RANGE")
    assert seen["unknown"] == "DOES_NOT_EXIST"
    assert seen["custom"] == ["WRONG_TYPE", "UNKNOWN"]  # its name for a value that is not supported
    assert seen["extended"] == pytest.approx({**expected, "CTL_K1": 33.25})
    assert (seen["extended_too_large"], seen["extended_back"]) == ("UNKNOWN", [34.5, 10])


def check_commands(seen):
    assert seen["no_such_command"] == "UNSUPPORTED"
    assert seen["mode_after_refusals"] == "HOLD"
    assert seen["attitude"][1] == seen["goto"][1] == "OFFBOARD"


def check_against_truth(seen, truth):
    """The true heading reaches the goals, and position and heading agree with MAVSDK at the end."""
    heading_deg = truth.heading_low_rad * 180.0 / math.pi
    assert (abs(heading_deg - 10.0) < 3.0).sum() > ROWS_PER_SECOND // 2
    assert abs(math.remainder(heading_deg[-1] - 30.0, 360.0)) < 8.0
    # The boat still turns by some degrees per second, and the values of MAVSDK are slightly older.
    lately_deg = heading_deg[-3 * ROWS_PER_SECOND :]
    assert min(abs(math.remainder(one - seen["goto"][0], 360.0)) for one in lately_deg) < 3.0
    last = seen["last_position"]
    north_m = METRES_PER_DEGREE * (last["latitude_deg"] - START_LATITUDE_DEG)
    assert north_m == pytest.approx(truth.north_m[-1], abs=3.0)
