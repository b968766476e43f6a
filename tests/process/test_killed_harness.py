"""A harness that is killed or terminated leaves no process behind that would use the ports of the next one."""

import os
import signal
import subprocess
import sys

import pytest

from support.processes import autopilots, command_line, descendants, wait_until


def start_harness(words, **options):
    command = [sys.executable, "-m", "hil", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options)


def test_autopilot_ends_with_a_killed_harness(tmp_path):
    out = tmp_path / "out"
    harness = start_harness(["run", "calm", "--seconds", "600", "--out", str(out)])
    try:
        wait_until(lambda: autopilots(str(out)))
        wait_until((out / "state" / "logs").is_dir)
    finally:
        harness.kill()
        harness.wait()
    wait_until(lambda: not autopilots(str(out)))


@pytest.mark.parametrize(
    ("words", "number"),
    [
        (("compare", "tank", "--only", "paper", "--seeds", "8"), signal.SIGKILL),
        (("drill", "--jobs", "2"), signal.SIGTERM),
    ],
)
def test_workers_end_with_the_process_that_started_them(words, number, tmp_path):
    harness = start_harness(words, env={**os.environ, "TMPDIR": str(tmp_path)})
    try:
        wait_until(lambda: len(autopilots(str(tmp_path))) >= 2)
        pids = descendants(harness.pid)
    finally:
        harness.send_signal(number)
        harness.wait()
    assert len(pids) >= 4  # two workers, and an autopilot of each
    wait_until(lambda: not any(map(command_line, pids)))
    wait_until(lambda: not autopilots(str(tmp_path)))
