"""A running HIL and the programs around it, for tests with the clients of third parties."""

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

# Without any device: for what is asked over the link alone.
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
    """Makes stations of mavutil URLs and closes them; in MAVLink 2, as MAVLINK20=1 gives it."""
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil = importlib.import_module("pymavlink.mavutil")  # it looks at the environment
    links = []

    def connect_one(url, source_system=200):
        link = mavutil.mavlink_connection(url, source_system=source_system, dialect="ardupilotmega")
        links.append(link)
        return Station(link, tmp_path)

    yield connect_one
    for link in links:
        link.close()


@pytest.fixture
def start(tmp_path):
    """Starts programs, given a name and a command, and ends what still runs after the test."""
    programs = []

    def start_one(name, command, **more):
        programs.append(Program(name, command, tmp_path, **more))
        return programs[-1]

    yield start_one
    for program in programs:
        program.close()


@pytest.fixture
def mavproxy(tmp_path, start):
    """Starts MAVProxy on a port, in a home of its own that takes all its files."""
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    home = tmp_path / "home"
    home.mkdir()

    def start_it(port):
        command = [sys.executable, script, f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={home}"]
        env = {**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"}
        return start("mavproxy", command, cwd=home, env=env)

    return start_it


@pytest.fixture
def start_hil(tmp_path):
    """Starts a HIL with links of the given kinds and waits until the boat is under way."""
    runs = []

    def start_one(*kinds, **more):
        runs.append(Hil(tmp_path, kinds, **more))
        runs[-1].wait_under_way()
        return runs[-1]

    yield start_one
    for run in runs:
        run.close()


@pytest.fixture
def boot(tmp_path, start):
    """`boot(name, url, ...)` starts `rambler run` without any device, on the same state directory each time."""
    (tmp_path / "boat.toml").write_text(BARE_BOAT.format(directory=tmp_path))

    def boot_one(name, *urls):
        words = ["run", str(tmp_path / "boat.toml"), "--wait", "--state", str(tmp_path / "state")]
        program = start(name, [sys.executable, "-m", "firmware_py", *words, *(f"--link={url}" for url in urls)])
        program.expect("state in")
        return program

    return boot_one


@pytest.fixture
def lossy(boot, free_ports, connect):
    """Starts a boat without devices and gives a relay of a seed, and a station behind it."""
    relays = []

    def begin(seed):
        (station_port,) = free_ports(["udpin"])
        relays.append(Relay(station_port, seed))
        relays[-1].__enter__()
        boot("boat", f"udpout:127.0.0.1:{relays[-1].port}")
        return relays[-1], connect(f"udpin:127.0.0.1:{station_port}")

    yield begin
    for relay in relays:
        relay.__exit__(None, None, None)
