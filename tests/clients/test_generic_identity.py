"""Parameters with LNK_IDENTITY 0: the same numbers for clients with and without integer conversion."""

import importlib.util
import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from firmware_py.common.parameter_table import TABLE

CLIENT = Path(__file__).with_name("mavsdk_parameters.py")
NOT_USABLE, SESSION_S = 77, 60.0
INT32, REAL32 = 6, 9
EXPECTED = {row.name: row.default for row in TABLE} | {"LNK_IDENTITY": 0.0, "STAT_BOOTCNT": 1.0}


@pytest.fixture
def generic_boat(tmp_path, boot, free_ports):
    """Start a boat without devices that is identified as a generic autopilot; return the port of the station."""
    with (tmp_path / "boat.toml").open("a") as file:
        file.write("[parameters]\nLNK_IDENTITY = 0\n")
    (port,) = free_ports(["udpin"])
    boot("boat", f"udpout:127.0.0.1:{port}")
    return port


def test_mavsdk_reads_and_sets_integer_parameters(tmp_path, start, generic_boat):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    result_file = tmp_path / "results.json"
    command = [sys.executable, str(CLIENT), f"udpin://127.0.0.1:{generic_boat}", str(result_file)]
    client = start("mavsdk", command)
    code = client.exit_code(SESSION_S)
    if code == NOT_USABLE:
        pytest.skip(client.text().strip().splitlines()[-1])
    assert code == 0, client.text()
    results = json.loads(result_file.read_text())
    assert results["ints"] == 0
    assert results["floats"] == pytest.approx(EXPECTED)
    assert results["read_back"] == 12.0
    assert (results["as_int"], results["after_int"]) in (("WRONG_TYPE", 12.0), ("SUCCESS", 13.0))


def test_pymavlink_reads_and_sets_integer_parameters_as_either_type(connect, generic_boat):
    station = connect(f"udpin:127.0.0.1:{generic_boat}")
    station.mav.param_request_list_send(1, 1)
    rows = {}
    while len(rows) < len(TABLE):
        row = station.receive("PARAM_VALUE")
        rows[row.param_id] = row
    assert {name: row.param_value for name, row in rows.items()} == pytest.approx(EXPECTED)
    assert {row.param_type for row in rows.values()} == {REAL32}
    assert station.set_parameter("LOOP_RATE_HZ", 12, REAL32) == 12.0
    assert station.set_parameter("LOOP_RATE_HZ", 13, INT32) == 13.0


@pytest.mark.proof
def test_mavproxy_reads_and_sets_integer_parameters(tmp_path, start, generic_boat):
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    command = [sys.executable, script, f"--master=udpin:127.0.0.1:{generic_boat}", f"--state-basedir={tmp_path}"]
    env = {**os.environ, "HOME": str(tmp_path), "PYTHONUNBUFFERED": "1"}
    client = start("mavproxy", command, cwd=tmp_path, env=env)
    client.expect(f"Saved {len(TABLE)} parameters")
    client.say("param show LOOP_RATE_HZ")
    client.expect(r"LOOP_RATE_HZ +10(\.0)?\s")
    client.say("param set LOOP_RATE_HZ 12")

    def is_set():
        client.say("param show LOOP_RATE_HZ")
        return float(client.expect(r"LOOP_RATE_HZ +(\S+)")[1]) == 12.0

    client.wait_for(is_set, "LOOP_RATE_HZ was not set")
