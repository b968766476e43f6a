"""`rambler-hil` and `rambler replay` as processes."""

import http.client
import os
import signal
import subprocess
import sys
from pathlib import Path

from firmware_py.log.disk import log_files
from hil.sim.truth import read
from support.paths import ROOT
from support.program import Program, assert_no_process_left, unused_ports

MAX_RUN_S = 600  # simulated or real
INTERRUPTED = 130  # exit code

# The default boat needs a minute for a turn; this boat needs a few seconds of real time.
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


def without_pictures(environment=os.environ):
    """Return the environment of a program without matplotlib, which makes no picture of a run."""
    paths = [str(Path(__file__).with_name("without_pictures")), environment.get("PYTHONPATH", "")]
    return {**environment, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def start_rambler_hil(*words, picture=False, **more):
    """Start a command of `rambler-hil` without waiting; its pages have a picture only with `picture`."""
    command = [sys.executable, "-m", "hil", *map(str, words)]
    env = more.pop("env", os.environ)
    if words[0] in ("run", "report") and not picture:
        env = without_pictures(env)
    more = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **more}
    return subprocess.Popen(command, cwd=ROOT, env=env, **more)


def rambler_hil(*words, picture=False):
    """Run a command of `rambler-hil`; return its exit code, standard output and standard error."""
    process = start_rambler_hil(*words, picture=picture)
    output, errors = process.communicate()
    return process.returncode, output, errors


def read_events(port):
    """Return all events that the page of a run receives until the end of the run."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    connection.request("GET", "/events")
    return connection.getresponse().read()


def replay(log, *words):
    """Run `rambler replay` on a log; return the completed process."""
    command = [sys.executable, "-m", "firmware_py", "replay", str(log), *words]
    return subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)


def is_replay_identical(out):
    """Return whether all rudder commands in the logs of a run are recomputed with the same bits."""
    logs = [path for _, path in sorted(log_files(out / "state" / "logs").items())]
    return bool(logs) and all(replay(log).returncode == 0 for log in logs)


class Hil:
    """`rambler-hil run` with a link of each kind, whose ports are `ports`; `links` are further ones."""

    def __init__(
        self,
        directory,
        kinds,
        *,
        links=(),
        scenario="calm",
        goal="0:-10",
        speed="real",
        seconds=MAX_RUN_S,
        nimble=True,
        disturbances="",
    ):
        self.out = directory / "run"
        self.ports = unused_ports(kinds)
        self.firmware_log = self.out / "firmware.log"
        urls = [f"{kind}:127.0.0.1:{port}" for kind, port in zip(kinds, self.ports, strict=True)]
        words = ["run", scenario, "--goal", goal, "--speed", speed, "--seconds", str(seconds), "--out", str(self.out)]
        words += ["--with", disturbances] if disturbances else []
        if nimble:
            (directory / "boat.toml").write_text(NIMBLE_BOAT)
            words += ["--vehicle", str(directory / "boat.toml")]
        command = [sys.executable, "-m", "hil", *words, "--link", *urls, *links]
        self.program = Program("hil", command, directory, env=without_pictures())

    def wait_under_way(self):
        """Wait until the ground station of the run has armed the boat and set the mode; then it sends no more."""
        log = self.firmware_log
        for text in ("Mode GUIDED", "Armed"):
            self.program.wait_for(lambda text=text: log.exists() and text in log.read_text(), f"no {text!r} in the log")

    def end(self):
        """Interrupt the run, and return its true track."""
        self.program.send_signal(signal.SIGINT)
        code = self.program.exit_code()
        if code != INTERRUPTED:
            self.program.fail(f"it ended with code {code} instead of {INTERRUPTED}")
        assert_no_process_left(self.out)
        return read(self.out / "truth.csv")

    def close(self):
        """End the run, also after a failed test; the interrupt lets the HIL end its autopilot."""
        try:
            if self.program.running():
                self.program.send_signal(signal.SIGINT)
                self.program.exit_code()
        finally:
            self.program.close()
        assert_no_process_left(self.out)
