"""Processes of tests: waiting for conditions, process lists, and devices of a boat that run in a thread."""

import contextlib
import threading
import time
from pathlib import Path

TIMEOUT_S = 60.0


def wait_until(condition, what="condition", timeout_s=TIMEOUT_S):
    """Return the first true value of a condition; fail after a timeout."""
    end_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < end_s, f"timeout: {what}"
        time.sleep(0.02)
    return value


def command_line(pid):
    """Return the command line of a process; empty if it has ended or is a zombie."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def children(pid):
    """Return the child processes of a process."""
    pids = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            pids += map(int, (task / "children").read_text().split())
    return pids


def descendants(pid):
    """Return the child processes of a process and all of theirs."""
    return [pid_below for child in children(pid) for pid_below in (child, *descendants(child))]


def autopilots(text):
    """Return the processes of autopilots whose command line contains a text."""
    pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    lines = {pid: command_line(pid) for pid in pids}
    return [pid for pid, line in lines.items() if b"firmware_py" in line and text.encode() in line]


@contextlib.contextmanager
def running_devices(boat):
    """Run the simulated boat and its devices in a thread, in real time."""
    is_over = threading.Event()

    def run():
        while not is_over.is_set():
            boat.time.step(boat.board, boat.now_s + 0.05)

    boat.time.begin(boat.board, None)
    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
