"""Hardware watchdog: only the loop feeds it, a hang ends the keep-alives, and only an orderly end disarms it.

A pseudo-terminal replaces the device: it records the writes and their times, and accepts no ioctl. The restart of the
computer after the timeout is done by the kernel driver and is not tested here.
"""

import os
import pty
import signal
import sys
import time
import tty
from itertools import pairwise
from pathlib import Path

import pytest

from firmware_py.system.watchdogs import INTERVAL_S, TIMEOUT_S
from support.paths import ROOT
from support.program import Program

KEEP_ALIVE, DISARM = b"\0", b"V"
RUN_S = 5.0
MAX_LATENESS_S = 1.5  # of a keep-alive on a busy machine


class WatchedBoat:
    """A boat in real time whose autopilot feeds a watchdog."""

    def __init__(self, boat, directory):
        self._boat, self.hangs = boat, directory / "hangs"
        self.hangs.mkdir()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.written = []  # (time, data) of each write to the watchdog
        arguments = ["run", boat.directory / "boat.toml", "--state", boat.state, "--watchdog", os.ttyname(self._slave)]
        environment = {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "HANG_DIRECTORY": str(self.hangs)}
        command = [sys.executable, str(Path(ROOT) / "tests/support/hanging.py"), *map(str, arguments)]
        self.program = Program("boat", command, directory, env={**os.environ, **environment})
        boat.time.begin(boat.board, None)

    def close(self):
        self.program.close()
        os.close(self._master)
        os.close(self._slave)

    def sail(self, seconds):
        """Run the boat and record the writes."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._boat.time.step(self._boat.board, self._boat.now_s + 0.05)
            try:
                self.written.append((time.monotonic(), os.read(self._master, 4096)))
            except BlockingIOError:
                pass

    def sail_until(self, ready):
        give_up_s = time.monotonic() + 30.0
        while not ready():
            assert time.monotonic() < give_up_s, self.program.text()
            self.sail(0.1)

    def keep_alives(self):
        return b"".join(data for _, data in self.written)


@pytest.fixture
def watched(make_boat, tmp_path):
    boat = make_boat(speed=None, settings={"CLK_SET": 0}, without=("link",))  # the GPS sends simulated time
    boat_with_watchdog = WatchedBoat(boat, tmp_path)
    try:
        boat_with_watchdog.sail_until(lambda: boat_with_watchdog.written)
        yield boat_with_watchdog
    finally:
        boat_with_watchdog.close()


def test_watchdog_is_disarmed_only_at_an_orderly_end(watched):
    watched.sail(INTERVAL_S + MAX_LATENESS_S)
    assert set(watched.keep_alives()) == set(KEEP_ALIVE)
    watched.program.send_signal(signal.SIGTERM)
    watched.sail_until(lambda: not watched.program.running())
    watched.sail(0.1)
    assert watched.program.exit_code() == 0
    assert watched.keep_alives().endswith(DISARM)
    assert watched.keep_alives().count(DISARM) == 1


@pytest.mark.proof
@pytest.mark.parametrize("kind", ["stopped", "killed", "tick"])
def test_hang_leaves_the_watchdog_armed_without_keep_alives(watched, kind):
    """`pytest -m proof tests/process/test_hardware_watchdog.py -s`: stopped, killed, or in an endless computation."""
    watched.sail(RUN_S)
    times_s = [t_s for t_s, _ in watched.written]
    longest_s = max(later_s - earlier_s for earlier_s, later_s in pairwise(times_s))
    hung_s = time.monotonic()
    if kind == "tick":
        (watched.hangs / "tick").touch()
    else:
        watched.program.send_signal(signal.SIGSTOP if kind == "stopped" else signal.SIGKILL)
    watched.sail(TIMEOUT_S + 2.0)
    last_keep_alive_s = watched.written[-1][0]
    print(
        f"{kind}: keep-alives at most {longest_s:.2f} s apart, the last one {last_keep_alive_s - hung_s:+.2f} s after "
        f"the hang; computer restarts {last_keep_alive_s + TIMEOUT_S - hung_s:.1f} s after the hang"
    )
    assert longest_s < INTERVAL_S + MAX_LATENESS_S
    assert -INTERVAL_S - MAX_LATENESS_S < last_keep_alive_s - hung_s < MAX_LATENESS_S
    assert set(watched.keep_alives()) == set(KEEP_ALIVE)
