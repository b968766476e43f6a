"""A harness that is killed leaves no autopilot behind, which would take up the ports of the next one."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE_S = 30.0


def autopilots(marker):
    """The processes whose command line names the directory of this test."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                line = (entry / "cmdline").read_bytes()
                zombie = b") Z" in (entry / "stat").read_bytes()
            except OSError:
                continue
            if marker.encode() in line and b"firmware_py" in line and not zombie:
                found.append(int(entry.name))
    return found


def until(condition):
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up_s, "waited in vain"
        time.sleep(0.05)


def test_a_killed_harness_takes_its_autopilot_with_it(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "hil", "run", "calm", "--seconds", "600", "--out", str(out)]
    harness = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until(lambda: autopilots(str(out)))
        until((out / "state" / "logs").is_dir)
    finally:
        harness.send_signal(signal.SIGKILL)
        harness.wait()
    until(lambda: not autopilots(str(out)))


def descendants(pid):
    """The processes that one has started, and those that these have."""
    found = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in map(int, (task / "children").read_text().split()):
                found += [child, *descendants(child)]
    return found


def runs(pid):
    """Whether there is such a process still."""
    try:
        return b") Z" not in Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return False


@pytest.mark.parametrize(
    ("words", "number"),
    [
        (("compare", "tank", "--only", "paper", "--seeds", "8"), signal.SIGKILL),
        (("drill", "--jobs", "2"), signal.SIGTERM),
    ],
)
def test_workers_end_with_the_process_that_started_them(words, number, tmp_path):
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "hil", *words]
    harness = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    try:
        until(lambda: len(autopilots(str(tmp_path))) >= 2)
        begun = descendants(harness.pid)
    finally:
        harness.send_signal(number)
        harness.wait()
    assert len(begun) >= 4  # two workers, and an autopilot of each
    until(lambda: not any(map(runs, begun)))
    until(lambda: not autopilots(str(tmp_path)))
