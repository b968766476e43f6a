"""A running HIL and the programs around it: each a process of its own, read as it talks, ended in good order."""

import importlib
import math
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.truth import read

ROOT = Path(__file__).parents[2]
PATIENCE_S = 45.0  # for anything at all: the machine may be busy with other tests
LOOK_S = 0.05
TAIL_LINES = 25
SECONDS = 600  # simulated or real: a run that nobody ends stops by itself
INTERRUPTED = 130
GROUND_STATION, NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID

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


def fail(directory, complaint):
    """Fail with the last words of every program that has written a log in the directory of the test."""
    said = [complaint]
    for path in sorted(directory.rglob("*.log")):
        said += [f"--- the last of {path.name}:", *path.read_text(errors="replace").splitlines()[-TAIL_LINES:]]
    pytest.fail("\n".join(said))


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


class Station:
    """A third party's mavutil connection, and waits that say what did not come."""

    def __init__(self, link, directory):
        self.link = link
        self._directory = directory
        self.mav = link.mav
        self.heard("HEARTBEAT")

    def heard(self, kind, wanted=lambda _: True):
        """Return the next message of a kind that is wanted."""
        give_up_s = time.monotonic() + PATIENCE_S
        last = None
        while time.monotonic() < give_up_s:
            message = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            if message is not None:
                if wanted(message):
                    return message
                last = message
        return fail(self._directory, f"no {kind} as wanted within {PATIENCE_S:g} s; the last one: {last}")

    def command(self, number, *parameters):
        """Send a COMMAND_LONG and return the result."""
        self.mav.command_long_send(1, 1, number, 0, *parameters, *[0.0] * (7 - len(parameters)))
        return self.heard("COMMAND_ACK", lambda ack: ack.command == number).result

    def set_parameter(self, name, value, kind):
        """Send a PARAM_SET and return the value that comes back."""
        self.mav.param_set_send(1, 1, name.encode(), value, kind)
        return self.heard("PARAM_VALUE", lambda row: row.param_id == name).param_value

    def parameter(self, name):
        """Ask for the value of a parameter."""
        self.mav.param_request_read_send(1, 1, name.encode(), -1)
        return self.heard("PARAM_VALUE", lambda row: row.param_id == name).param_value

    def wait_for_goal(self, goal_deg, tolerance_deg):
        """Wait until she shows this heading as her goal."""
        self.heard("ATTITUDE_TARGET", lambda shown: abs(off_deg(yaw_deg(shown.q), goal_deg)) < tolerance_deg)

    def wait_until_steady(self, goal_deg, tolerance_deg, steady_s):
        """Wait until she has lain on a goal for a while; return the ATTITUDE messages of it."""
        kept = []
        while not kept or kept[-1].time_boot_ms - kept[0].time_boot_ms < 1000.0 * steady_s:
            kept.append(self.heard("ATTITUDE"))
            if abs(off_deg(math.degrees(kept[-1].yaw), goal_deg)) > tolerance_deg:
                kept.clear()
        return kept


def yaw_deg(q):
    return math.degrees(2.0 * math.atan2(q[3], q[0]))


def off_deg(heading_deg, goal_deg):
    """How far a heading is off another, -180 to 180 degrees."""
    return math.remainder(heading_deg - goal_deg, 360.0)


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
