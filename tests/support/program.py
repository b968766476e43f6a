"""Programs as processes of their own, read as they talk and ended whatever has happened."""

import os
import re
import socket
import subprocess
import time
from pathlib import Path

from support.paths import ROOT
from support.station import PATIENCE_S, fail

LOOK_S = 0.05


def unused_ports(kinds):
    """Return unused ports, one for each kind of link, all different."""
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
    """A process with its output in a file; a timeout shows the last lines of it."""

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
            pass  # reported without its traceback
        return self.fail(f"it has not ended within {patience_s:g} s")

    def close(self):
        """Leave nothing behind, whatever has happened."""
        if self.running():
            self._process.kill()
        self._process.wait()
        self._process.stdin.close()


def assert_no_process_left(path):
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
