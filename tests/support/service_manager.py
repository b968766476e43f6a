"""Replacement for systemd: runs the service of a unit by the settings of the unit, with a notify socket.

Settings of systemd.service(5): Type=notify, Restart=always with RestartSec and RestartPreventExitStatus, WatchdogSec
with SIGABRT and TimeoutAbortSec, TimeoutStartSec, TimeoutStopSec, ExecStartPre, ExecStopPost with its variables.
"""

import os
import re
import secrets
import select
import shlex
import signal
import socket
import subprocess
import threading
import time
from dataclasses import dataclass

POLL_INTERVAL_S = 0.005
UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}


@dataclass
class Run:
    """A run of the service: monotonic times and result."""

    pid: int
    begun_s: float
    ready_s: float | None = None
    alarm_s: float | None = None  # time of the abort by the watchdog or a time-out
    ended_s: float | None = None
    result: str = ""
    status: str = ""


def parse(text):
    """Return the settings of a unit by section and name; the last value of a name applies."""
    sections, section = {}, None
    for line in text.splitlines():
        if match := re.fullmatch(r"\[(\w+)\]", line):
            section = sections.setdefault(match[1], {})
        elif line and not line.startswith(("#", ";")):
            name, value = line.split("=", 1)
            section[name] = value
    return sections


def seconds(text):
    number, unit = re.fullmatch(r"([0-9.]+)([a-z]*)", text).groups()
    return float(number) * UNITS[unit]


def words(command):
    return [word.replace("%%", "%").replace("$$", "$") for word in shlex.split(command.lstrip("-+"))]


class ServiceManager:
    """A context that keeps the service of a unit running."""

    def __init__(self, unit, runtime, log, environment=()):
        settings = parse(unit)
        self.service = settings["Service"]
        assert (self.service["Type"], self.service["Restart"]) == ("notify", "always")
        assert settings["Unit"]["StartLimitIntervalSec"] == "0"
        self.runs = []
        self.watchdog_times_s = []  # of WATCHDOG=1 messages
        self.status = ""
        self._stopping = threading.Event()
        self._address = "\0rambler-test-" + secrets.token_hex(8)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self._address)
        self._environment = {
            **os.environ,
            **dict(environment),
            "NOTIFY_SOCKET": "@" + self._address[1:],
            "WATCHDOG_USEC": str(round(seconds(self.service["WatchdogSec"]) * 1e6)),
            "RUNTIME_DIRECTORY": str(runtime),
        }
        runtime.mkdir(exist_ok=True)
        self._log = log.open("ab")
        self._thread = threading.Thread(target=self._keep, name="service manager")

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_error):
        self._stopping.set()
        self._thread.join()
        self._socket.close()
        self._log.close()

    def _keep(self):
        final_statuses = self.service["RestartPreventExitStatus"].split()
        while not self._stopping.is_set():
            run = self._run()
            if run.result != "watchdog" and run.status in final_statuses:
                return
            self._stopping.wait(seconds(self.service["RestartSec"]))

    def _run(self):
        while select.select([self._socket], [], [], 0)[0]:
            self._socket.recv(4096)  # a message of the previous run
        pre_command = words(self.service["ExecStartPre"])
        subprocess.run(pre_command, env=self._environment, stdout=self._log, stderr=self._log, check=False)
        begun_s = time.monotonic()
        process = subprocess.Popen(
            words(self.service["ExecStart"]), env=self._environment, stdin=subprocess.DEVNULL, stdout=self._log,
            stderr=self._log, start_new_session=True,
        )  # fmt: skip
        run = Run(process.pid, begun_s)
        self.runs.append(run)
        self._watch(process, run)
        code = process.returncode
        run.status = str(code) if code >= 0 else signal.Signals(-code).name.removeprefix("SIG")
        # 10 is the SuccessExitStatus of the unit: the exit code after a shut-down command.
        run.result = run.result or ("success" if code in (0, 10) else "exit-code" if code > 0 else "signal")
        variables = {
            "SERVICE_RESULT": run.result, "EXIT_CODE": "exited" if code >= 0 else "killed", "EXIT_STATUS": run.status,
        }  # fmt: skip
        run.ended_s = time.monotonic()
        subprocess.run(words(self.service["ExecStopPost"]), env={**self._environment, **variables}, check=True)
        return run

    def _watch(self, process, run):
        due_s = run.begun_s + seconds(self.service["TimeoutStartSec"])
        watchdog_s = seconds(self.service["WatchdogSec"])
        stop_s = None  # start of the stop
        while process.poll() is None:
            if select.select([self._socket], [], [], POLL_INTERVAL_S)[0]:
                lines = self._socket.recv(4096).decode().splitlines()
                if "READY=1" in lines:
                    run.ready_s = time.monotonic()
                if "WATCHDOG=1" in lines:
                    self.watchdog_times_s.append(time.monotonic())
                    due_s = time.monotonic() + watchdog_s
                if "STOPPING=1" in lines and stop_s is None:
                    stop_s = time.monotonic()
                self.status = next((line[7:] for line in lines if line.startswith("STATUS=")), self.status)
            if self._stopping.is_set() and stop_s is None:
                stop_s = time.monotonic()
                os.kill(process.pid, signal.SIGTERM)
                os.kill(process.pid, signal.SIGCONT)
            if stop_s is not None:
                due_s = stop_s + seconds(self.service["TimeoutStopSec"])
            if time.monotonic() > due_s:
                self._abort(process, run, "watchdog" if run.ready_s and stop_s is None else "timeout")

    def _abort(self, process, run, why):
        run.result, run.alarm_s = why, time.monotonic()
        os.kill(process.pid, signal.SIGABRT)
        os.kill(process.pid, signal.SIGCONT)  # as in systemd, so that a stopped process handles the signal
        try:
            process.wait(seconds(self.service["TimeoutAbortSec"]))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
