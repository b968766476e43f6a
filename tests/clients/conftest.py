"""A running HIL and client programs, for tests with clients of third parties."""

import importlib
import os
import shutil
import sys
from pathlib import Path

import pytest

from support.harness import Hil
from support.program import Program, unused_ports
from support.relay import Relay
from support.station import Station

# Without devices, for tests that use only the link.
BARE_BOAT = """
[compass]
driver = "nmea"
port = "{directory}/no-compass"
baud = 38400
[rudder]
driver = "volz"
port = "{directory}/no-rudder"
baud = 115200
id = 1
"""


@pytest.fixture
def free_ports():
    return unused_ports


@pytest.fixture
def connect(tmp_path, monkeypatch):
    """Return a function that makes a station of a mavutil URL, with MAVLink 2; its link is closed after the test."""
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil = importlib.import_module("pymavlink.mavutil")  # it reads MAVLINK20 at import
    links = []

    def connect_station(url, source_system=200):
        link = mavutil.mavlink_connection(url, source_system=source_system, dialect="ardupilotmega")
        links.append(link)
        return Station(link, tmp_path)

    yield connect_station
    for link in links:
        link.close()


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a program, given a name and a command; it is ended after the test."""
    programs = []

    def start_program(name, command, **more):
        programs.append(Program(name, command, tmp_path, **more))
        return programs[-1]

    yield start_program
    for program in programs:
        program.close()


@pytest.fixture
def mavproxy(tmp_path, start):
    """Return a function that starts MAVProxy on a port, with a home directory of its own for all its files."""
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    home = tmp_path / "home"
    home.mkdir()

    def start_mavproxy(port):
        command = [sys.executable, script, f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={home}"]
        env = {**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"}
        return start("mavproxy", command, cwd=home, env=env)

    return start_mavproxy


@pytest.fixture
def start_hil(tmp_path):
    """Return a function that starts a HIL with links of the given kinds and waits until the boat is under way."""
    runs = []

    def start_run(*kinds, **more):
        runs.append(Hil(tmp_path, kinds, **more))
        runs[-1].wait_under_way()
        return runs[-1]

    yield start_run
    for run in runs:
        run.close()


@pytest.fixture
def boot(tmp_path, start):
    """Return a function that starts `rambler run` without devices, given a name and link URLs.

    All starts of a test use the same state directory.
    """
    (tmp_path / "boat.toml").write_text(BARE_BOAT.format(directory=tmp_path))

    def boot_boat(name, *urls):
        arguments = ["run", str(tmp_path / "boat.toml"), "--wait", "--state", str(tmp_path / "state")]
        program = start(name, [sys.executable, "-m", "firmware_py", *arguments, *(f"--link={url}" for url in urls)])
        program.expect("state in")
        return program

    return boot_boat


@pytest.fixture
def lossy(boot, free_ports, connect):
    """Return a function that starts a boat without devices; it returns a relay with a seed and a station behind it."""
    relays = []

    def start_behind_relay(seed):
        (station_port,) = free_ports(["udpin"])
        relays.append(Relay(station_port, seed))
        relays[-1].__enter__()
        boot("boat", f"udpout:127.0.0.1:{relays[-1].port}")
        return relays[-1], connect(f"udpin:127.0.0.1:{station_port}")

    yield start_behind_relay
    for relay in relays:
        relay.__exit__(None, None, None)
