"""A harness that is killed leaves no autopilot behind, which would take up the ports of the next one."""

import signal
import subprocess
import sys
import time
from pathlib import Path

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
