"""Programs as processes, whose output is searched, and which are ended in any case."""

import os
import re
import socket
import subprocess
import time
from pathlib import Path

from support.paths import ROOT
from support.station import PATIENCE_S, fail

POLL_INTERVAL_S = 0.05


def unused_ports(kinds):
    """Return unused ports, one for each kind of link, all different."""
    sockets = [
        socket.socket(socket.AF_INET, socket.SOCK_STREAM if kind.startswith("tcp") else socket.SOCK_DGRAM)
        for kind in kinds
    ]
    try:
        for opened in sockets:
            opened.bind(("127.0.0.1", 0))
        return [opened.getsockname()[1] for opened in sockets]
    finally:
        for opened in sockets:
            opened.close()


class Program:
    """A process with its output in a file; the error of a time-out contains the last lines of it."""

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
        """Write a line to its standard input; `expect` searches only output after it."""
        self._mark = len(self.text())
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def expect(self, pattern):
        """Wait until the output matches a pattern; the next search starts after the match."""
        match = self.wait_for(
            lambda: re.compile(pattern).search(self.text(), self._mark), f"{pattern!r} was not written"
        )
        self._mark = match.end()
        return match

    def wait_for(self, condition, complaint):
        """Wait until `condition` returns a true value, and return it; fail if the program ends before."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            has_ended = not self.running()
            if value := condition():
                return value
            if has_ended:
                self.fail(f"{complaint}, and the program has ended with code {self._process.returncode}")
            if time.monotonic() > deadline_s:
                self.fail(f"{complaint} within {PATIENCE_S:g} s")
            time.sleep(POLL_INTERVAL_S)

    def fail(self, complaint):
        fail(self._directory, f"{self._name}: {complaint}")

    def send_signal(self, number):
        self._process.send_signal(number)

    def hang_up(self):
        """Close the standard input of the program."""
        self._process.stdin.close()

    def exit_code(self, patience_s=PATIENCE_S):
        """Wait for the end of the program; return its exit code."""
        try:
            return self._process.wait(patience_s)
        except subprocess.TimeoutExpired:
            pass  # reported without its traceback
        return self.fail(f"it has not ended within {patience_s:g} s")

    def close(self):
        """Kill the program if it is still running."""
        if self.running():
            self._process.kill()
        self._process.wait()
        self._process.stdin.close()


def assert_no_process_left(path):
    """Fail if a process has this path in its command line."""
    commands = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = entry.read_bytes()
        except OSError:  # the process has ended
            continue
        if os.fsencode(path) in command:
            commands.append(command.replace(b"\0", b" ").decode(errors="replace"))
    assert commands == []
