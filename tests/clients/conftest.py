"""A running HIL and the programs around it: each a process of its own, read as it talks, ended in good order."""

import importlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from relay import Relay
from station import PATIENCE_S, Station, fail

from hil.sim.truth import read

ROOT = Path(__file__).parents[2]
LOOK_S = 0.05
SECONDS = 600  # simulated or real: a run that nobody ends stops by itself
INTERRUPTED = 130
GROUND_STATION, NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID

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
# The stock boat needs a minute to turn; this one is there in a few seconds of real time.
NIMBLE_BOAT = """
[compass]
driver = "nmea"
port = "given by the HIL"
baud = 38400
[rudder]
driver = "dynamixel"
port = "given by the HIL"
baud = 57600
id = 1
[parameters]
MDL_K = 0.4
MDL_T_S = 0.5
MDL_ALPHA_S2 = 0.0
"""


def unused_ports(kinds):
    """Ports that nobody has, one for each kind of link, all different."""
    held = [
        socket.socket(socket.AF_INET, socket.SOCK_STREAM if kind.startswith("tcp") else socket.SOCK_DGRAM)
        for kind in kinds
    ]
    try:
        for one in held:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in held]
    finally:
        for one in held:
            one.close()


class Program:
    """A process whose words go to a file; whoever waits for it in vain gets to see the last of them."""

    def __init__(self, name, command, directory, *, cwd=ROOT, env=None):
        self._name = name
        self._directory = directory
        self._log_path = directory / f"{name}.log"
        self._mark = 0
        with self._log_path.open("wb") as log:
            self._process = subprocess.Popen(
                command, cwd=cwd, env=env, stdin=subprocess.PIPE, stdout=log, stderr=subprocess.STDOUT
            )

    @property
    def pid(self):
        return self._process.pid

    def text(self):
        return self._log_path.read_text(errors="replace")

    def running(self):
        return self._process.poll() is None

    def say(self, line):
        """Type a line; what `expect` finds from now on came after it."""
        self._mark = len(self.text())
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def expect(self, pattern):
        """Wait until it has written something, and go on behind that."""
        found = self.wait_for(lambda: re.compile(pattern).search(self.text(), self._mark), f"{pattern!r} was not said")
        self._mark = found.end()
        return found

    def wait_for(self, look, complaint):
        """Wait for something that the running program brings about."""
        give_up_s = time.monotonic() + PATIENCE_S
        while True:
            ended = not self.running()
            if found := look():
                return found
            if ended:
                self.fail(f"{complaint}, and the program has ended with code {self._process.returncode}")
            if time.monotonic() > give_up_s:
                self.fail(f"{complaint} within {PATIENCE_S:g} s")
            time.sleep(LOOK_S)

    def fail(self, complaint):
        fail(self._directory, f"{self._name}: {complaint}")

    def send_signal(self, number):
        self._process.send_signal(number)

    def hang_up(self):
        """Close its standard input."""
        self._process.stdin.close()

    def exit_code(self, patience_s=PATIENCE_S):
        """Wait for its end."""
        try:
            return self._process.wait(patience_s)
        except subprocess.TimeoutExpired:
            pass  # told without the trace of it
        return self.fail(f"it has not ended within {patience_s:g} s")

    def close(self):
        """Leave nothing behind, whatever has happened."""
        if self.running():
            self._process.kill()
        self._process.wait()
        self._process.stdin.close()


class Hil:
    """`rambler-hil run` with links of its own; `ports` are theirs, in the order of the kinds."""

    def __init__(self, directory, kinds, *, scenario="calm", goal="0:-10", speed="real", seconds=SECONDS, nimble=True):
        self.out = directory / "run"
        self.ports = unused_ports(kinds)
        self.firmware_log = self.out / "firmware.log"
        urls = [f"{kind}:127.0.0.1:{port}" for kind, port in zip(kinds, self.ports, strict=True)]
        words = ["run", scenario, "--goal", goal, "--speed", speed, "--seconds", str(seconds), "--out", str(self.out)]
        if nimble:
            (directory / "boat.toml").write_text(NIMBLE_BOAT)
            words += ["--vehicle", str(directory / "boat.toml")]
        command = [sys.executable, "-m", "hil", *words, "--link", *urls]
        self.program = Program("hil", command, directory)

    def wait_under_way(self):
        """Until the HIL's own operator has armed her and given the mode: from then on he is silent."""
        log = self.firmware_log
        for sign in ("Mode GUIDED", "Armed"):
            self.program.wait_for(lambda sign=sign: log.exists() and sign in log.read_text(), f"no {sign!r} in the log")

    def end(self):
        """Interrupt the run as an operator does, and return what really happened."""
        self.program.send_signal(signal.SIGINT)
        code = self.program.exit_code()
        if code != INTERRUPTED:
            self.program.fail(f"it ended with code {code} instead of {INTERRUPTED}")
        assert_nobody_left(self.out)
        return read(self.out / "truth.csv")

    def close(self):
        """After a test that has failed, too: interrupted first, so that the HIL ends its autopilot."""
        try:
            if self.program.running():
                self.program.send_signal(signal.SIGINT)
                self.program.exit_code()
        finally:
            self.program.close()
        assert_nobody_left(self.out)


def assert_nobody_left(path):
    """No process has this path on its command line: neither HIL nor autopilot."""
    left = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes()
        except OSError:  # it has ended in between
            continue
        if os.fsencode(path) in words:
            left.append(words.replace(b"\0", b" ").decode(errors="replace"))
    assert left == []


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
        # To be heard by a link that waits for whoever asks.
        link.mav.heartbeat_send(GROUND_STATION, NO_AUTOPILOT, 0, 0, 0)
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
def start_hil(tmp_path):
    """Starts a HIL with links of the given kinds and waits until she is under way."""
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
