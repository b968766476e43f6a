"""The computer's watchdog hears of the loop alone: whatever hangs, the signs of life end, and nothing disarms it.

A terminal stands in for the device: it shows what is written to it and when, and takes no ioctl. That the kernel starts
the computer after the timeout is the driver's part and is not tested here.
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

SIGN, DISARM = b"\0", b"V"
UNDER_WAY_S = 5.0
LATE_S = 1.5  # on a busy machine


class Watched:
    """A boat under way in real time whose autopilot feeds a watchdog."""

    def __init__(self, boat, directory):
        self._boat, self.hangs = boat, directory / "hangs"
        self.hangs.mkdir()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.written = []  # what was written to the watchdog, each with its time
        words = ["run", boat.directory / "boat.toml", "--state", boat.state, "--watchdog", os.ttyname(self._slave)]
        more = {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "HANG_DIRECTORY": str(self.hangs)}
        command = [sys.executable, str(Path(ROOT) / "tests/support/hanging.py"), *map(str, words)]
        self.program = Program("boat", command, directory, env={**os.environ, **more})
        boat.time.begin(boat.board, None)

    def close(self):
        self.program.close()
        os.close(self._master)
        os.close(self._slave)

    def sail(self, seconds):
        """Let time go by."""
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

    def signs(self):
        return b"".join(data for _, data in self.written)


@pytest.fixture
def watched(make_boat, tmp_path):
    boat = make_boat(speed=None, without=("link",))
    one = Watched(boat, tmp_path)
    try:
        one.sail_until(lambda: one.written)
        yield one
    finally:
        one.close()


def test_the_watchdog_is_disarmed_only_at_an_orderly_end(watched):
    watched.sail(INTERVAL_S + LATE_S)
    assert set(watched.signs()) == set(SIGN)
    watched.program.send_signal(signal.SIGTERM)
    watched.sail_until(lambda: not watched.program.running())
    watched.sail(0.1)
    assert watched.program.exit_code() == 0
    assert watched.signs().endswith(DISARM)
    assert watched.signs().count(DISARM) == 1


@pytest.mark.proof
@pytest.mark.parametrize("how", ["stopped", "killed", "tick"])
def test_a_hang_of_any_kind_leaves_the_watchdog_armed_and_unfed(watched, how):
    """`pytest -m proof tests/process/test_hardware_watchdog.py -s`: it stands still, is gone, or computes for ever."""
    watched.sail(UNDER_WAY_S)
    times_s = [t_s for t_s, _ in watched.written]
    longest_s = max(after - before for before, after in pairwise(times_s))
    hung_s = time.monotonic()
    if how == "tick":
        (watched.hangs / "tick").touch()
    else:
        watched.program.send_signal(signal.SIGSTOP if how == "stopped" else signal.SIGKILL)
    watched.sail(TIMEOUT_S + 2.0)
    last_s = watched.written[-1][0]
    print(
        f"{how}: a sign at most every {longest_s:.2f} s, the last one {last_s - hung_s:+.2f} s from then: "
        f"restarted {last_s + TIMEOUT_S - hung_s:.1f} s after"
    )
    assert longest_s < INTERVAL_S + LATE_S
    assert -INTERVAL_S - LATE_S < last_s - hung_s < LATE_S
    assert set(watched.signs()) == set(SIGN)
