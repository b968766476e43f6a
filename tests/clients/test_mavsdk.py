"""MAVSDK 4 with a running HIL: correct telemetry, and commands that are executed."""

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
MANUAL = Path(__file__).parents[2] / "docs/how-to/ground-stations.md"
NOT_USABLE = 77
SESSION_S = 90.0  # maximum; 15 s on an idle machine
METRES_PER_DEGREE = 111_195.0


def test_mavsdk_reads_and_commands_the_boat(tmp_path, start, start_hil):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    hil = start_hil("udpout")
    results = run_client(CLIENT, tmp_path, start, hil)
    truth = hil.end()
    check_identity(results)
    check_telemetry(results)
    check_parameters(results)
    check_commands(results)
    check_against_truth(results, truth)


def run_client(script, tmp_path, start, hil):
    """Run a client to its end and return its results."""
    result_file = tmp_path / "results.json"
    client = start("mavsdk", [sys.executable, str(script), f"udpin://127.0.0.1:{hil.ports[0]}", str(result_file)])
    code = client.exit_code(SESSION_S)
    if code == NOT_USABLE:
        pytest.skip(client.text().strip().splitlines()[-1])
    if code != 0:
        client.fail(f"the client ended with code {code}")
    return json.loads(result_file.read_text())


def test_example_of_the_manual_finds_the_boat(tmp_path, start, free_ports):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    (port,) = free_ports(["udpin"])
    (lines,) = re.findall(r"```python\n(from mavsdk .*?)```", MANUAL.read_text(), re.DOTALL)
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
    results = run_client(VOYAGE, tmp_path, start, hil)
    truth = hil.end()
    assert [number for number in results["progress"] if number] == [1, 2, 3]
    for north_m, east_m in ((20.0, 0.0), (20.0, 15.0)):
        assert np.hypot(truth.north_m - north_m, truth.east_m - east_m).min() < 6.0


def check_identity(results):
    assert (results["system"], results["components"], results["autopilot"]) == (1, [1], "ARDUPILOT")
    version = results["version"]
    number = [version[f"flight_sw_{part}"] for part in ("major", "minor", "patch")]
    assert number == [int(part) for part in __version__.split(".")[:3]]


def check_telemetry(results):
    assert all(results["health"].values()), results["health"]
    assert results["mode"] == "OFFBOARD"  # MAVSDK's name for ArduRover's GUIDED
    for name in ("position", "home"):
        assert metres_from_start(results[name]) < 50.0
    assert -13.0 < results["attitude_euler"]["yaw_deg"] < 3.0  # turning from 0 to -10
    assert results["gps_info"]["fix_type"] == 3
    assert 4.0 < results["battery"]["voltage_v"] < 30.0
    assert 0.0 < math.hypot(results["velocity_ned"]["north_m_s"], results["velocity_ned"]["east_m_s"]) < 1.0


def metres_from_start(position):
    north_m = METRES_PER_DEGREE * (position["latitude_deg"] - START_LATITUDE_DEG)
    east_m = METRES_PER_DEGREE * (position["longitude_deg"] - START_LONGITUDE_DEG)
    return math.hypot(north_m, east_m * math.cos(math.radians(START_LATITUDE_DEG)))


def check_parameters(results):
    changed = {"MDL_K": 0.4, "MDL_T_S": 0.5, "MDL_ALPHA_S2": 0.0, "STAT_BOOTCNT": 1}  # in the vehicle file
    expected = {row.name: changed.get(row.name, row.default) for row in TABLE}
    reals = {row.name for row in TABLE if row.kind is Kind.REAL}
    assert results["float_params"] == pytest.approx({name: expected[name] for name in reals})
    assert results["int_params"] == {name: expected[name] for name in expected.keys() - reals}
    assert results["custom_params"] == 0
    assert results["read_back"] == [33.25, 12]
    assert (results["too_large"], results["not_a_number"]) == ("VALUE_OUT_OF_RANGE", "VALUE_OUT_OF_RANGE")
    assert results["unknown"] == "DOES_NOT_EXIST"
    assert results["custom"] == ["WRONG_TYPE", "UNKNOWN"]  # the name of MAVSDK for a value that is not supported
    assert results["extended"] == pytest.approx({**expected, "CTL_K1": 33.25})
    assert (results["extended_too_large"], results["extended_back"]) == ("UNKNOWN", [34.5, 10])


def check_commands(results):
    assert results["no_such_command"] == "UNSUPPORTED"
    assert results["mode_after_refusals"] == "HOLD"
    assert results["attitude"][1] == results["goto"][1] == "OFFBOARD"


def check_against_truth(results, truth):
    """The true heading reaches the goals, and position and heading agree with MAVSDK at the end."""
    heading_deg = truth.heading_low_rad * 180.0 / math.pi
    assert (abs(heading_deg - 10.0) < 3.0).sum() > ROWS_PER_SECOND // 2
    assert abs(math.remainder(heading_deg[-1] - 30.0, 360.0)) < 8.0
    # The boat still turns by some degrees per second, and the values of MAVSDK are slightly older.
    last_deg = heading_deg[-3 * ROWS_PER_SECOND :]
    assert min(abs(math.remainder(one_deg - results["goto"][0], 360.0)) for one_deg in last_deg) < 3.0
    position = results["last_position"]
    north_m = METRES_PER_DEGREE * (position["latitude_deg"] - START_LATITUDE_DEG)
    assert north_m == pytest.approx(truth.north_m[-1], abs=3.0)
