"""Campaigns from outside: killed and gone on with, compiled and by the autopilot itself, with the same results."""

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.lab.campaign import store
from support.harness import INTERRUPTED, rambler_hil, start_rambler_hil
from support.paths import ROOT

pytestmark = pytest.mark.timeout(600)  # the loop is compiled first: half a minute of one processor

TIMEOUT_S = 300.0
COMPILED = """
engine = "compiled"
runs = 640
seed = 3
seconds = 60
goals = "0:0,20:60"
scenarios = ["tank", "swell+leeway=3"]
[ship]
K = {uniform = [0.7, 1.4]}
[with]
receiver = {latency_s = 0.5, lost = [0.02, 1.0]}
[set]
CTL_PRICE = [0.5, 1.0, 2.0]
"""
FIRMWARE = """
engine = "firmware"
runs = 2
seconds = 20
scenarios = ["tank", "swell"]
[ship]
K = {uniform = [0.7, 1.4]}
"""


def until(condition):
    """Wait for something that another process brings about, and return it."""
    give_up_s = time.monotonic() + TIMEOUT_S
    while not (found := condition()):
        assert time.monotonic() < give_up_s, "waited in vain"
        time.sleep(0.02)
    return found


def children(pid):
    """Return the processes that a process has started."""
    found = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += [int(word) for word in (task / "children").read_text().split()]
    return found


def workers(pid):
    """Return the worker processes of a campaign."""
    return [one for one in children(pid) if b"spawn_main" in command_line(one)]


def command_line(pid):
    """Return the command line of a process, nothing when it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def started(spec, out, *words):
    """Start a campaign; return it and its specification's path."""
    path = out.with_suffix(".toml")
    path.write_text(spec)
    return start_rambler_hil("campaign", path, "--out", out, *words)


def finished_campaign(spec, out, *words):
    """Sail a campaign to its end and return the bytes that it came to."""
    campaign = started(spec, out, *words)
    output, errors = campaign.communicate()
    assert campaign.returncode == 0, errors
    assert str(out / store.RUNS) in output
    return (out / store.RUNS).read_bytes()


def parts(out):
    """Return the number of stored batches."""
    return len(list((out / store.PARTS).glob("*.parquet")))


@pytest.mark.proof
def test_a_campaign_with_a_killed_worker_and_a_restart_gives_equal_results(tmp_path):
    whole = finished_campaign(COMPILED, tmp_path / "whole", "--workers", "1")
    out = tmp_path / "killed"
    campaign = started(COMPILED, out, "--workers", "1")
    until(lambda: parts(out) >= 2)
    os.kill(workers(campaign.pid)[0], signal.SIGKILL)
    until(lambda: parts(out) >= 5)
    worker_pids = workers(campaign.pid)
    campaign.kill()
    campaign.communicate()
    until(lambda: not any(b"spawn_main" in command_line(one) for one in worker_pids))
    assert not (out / store.RUNS).exists()
    code, _, errors = rambler_hil("campaign", out.with_suffix(".toml"), "--out", out)
    assert (code, "go on with --resume" in errors) == (2, True)
    assert finished_campaign(COMPILED, out, "--workers", "2", "--resume") == whole


@pytest.mark.proof
def test_a_terminated_campaign_names_the_command_that_resumes_it(tmp_path):
    old_name = COMPILED.replace('"compiled"', '"twin"')
    campaign = started(old_name, tmp_path / "out", "--workers", "1")
    until(lambda: parts(tmp_path / "out") >= 1)
    worker_pids = workers(campaign.pid)
    campaign.send_signal(signal.SIGTERM)
    _, errors = campaign.communicate()
    assert campaign.returncode == INTERRUPTED
    assert 'engine: "twin" is the old name of "compiled"' in errors
    assert errors.endswith("rambler-hil: interrupted; finished runs are stored, continue with --resume\n")
    assert "Traceback" not in errors
    until(lambda: not any(b"spawn_main" in command_line(one) for one in worker_pids))


@pytest.mark.proof
def test_a_repeated_campaign_and_a_single_run_of_it_are_bit_identical(tmp_path):
    out, run = tmp_path / "first", tmp_path / "run"
    first = finished_campaign(FIRMWARE, out, "--workers", "1")
    assert finished_campaign(FIRMWARE, tmp_path / "second", "--workers", "2") == first
    runs = store.read_table(out / store.RUNS).to_pylist()
    assert [row["ended"] for row in runs] == ["finished", "finished"]
    assert runs[0]["digest"] != runs[1]["digest"]
    code, output, errors = rambler_hil("campaign", "replay", out, "1", "--out", run)
    assert (code, output.splitlines()[0]) == (0, "run 1: identical to the last bit"), errors
    assert hashlib.sha256((run / "truth.csv").read_bytes()).hexdigest() == runs[1]["digest"]
    assert (run / "report.html").exists()


@pytest.mark.proof
def test_a_compiled_run_replays_as_the_autopilot_sails_it(tmp_path):
    out = tmp_path / "out"
    finished_campaign(COMPILED.replace("runs = 640", "runs = 4"), out)
    for row in range(4):
        code, output, errors = rambler_hil("campaign", "replay", out, row, "--out", tmp_path / "run")
        assert (code, output.splitlines()[0]) == (0, f"run {row}: identical to the last bit"), errors
    (out / store.RUNS).unlink()
    (out / store.PARTS).mkdir()
    code, _, errors = rambler_hil("campaign", "replay", out, "1", "--out", tmp_path / "run")
    assert (code, "is not finished" in errors) == (2, True)


@contextlib.contextmanager
def cluster():
    """A dask scheduler with two workers: its process and its address."""
    command = [sys.executable, str(ROOT / "tests" / "support" / "dask_cluster.py")]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.stdin.close()


@pytest.mark.proof
def test_a_dask_cluster_with_killed_processes_gives_equal_results(tmp_path):
    whole = finished_campaign(COMPILED, tmp_path / "whole", "--workers", "1")
    with cluster() as (_, address):
        assert finished_campaign(COMPILED, tmp_path / "cluster", "--scheduler", address) == whole
    out = tmp_path / "killed"
    with cluster() as (process, address):
        campaign = started(COMPILED, out, "--scheduler", address)
        until(lambda: parts(out) >= 2)
        os.kill(next(one for one in children(process.pid) if b"spawn_main" in command_line(one)), signal.SIGKILL)
        until(lambda: parts(out) >= 10)
        process.kill()  # the scheduler lives in it
        _, errors = campaign.communicate()
        assert (campaign.returncode, "go on with --resume" in errors) == (1, True), errors
        assert "Traceback" not in errors
    with cluster() as (_, address):
        assert finished_campaign(COMPILED, out, "--scheduler", address, "--resume") == whole
    code, _, errors = rambler_hil(
        "campaign", out.with_suffix(".toml"), "--out", tmp_path / "fish", "--scheduler", "fish"
    )
    assert (code, errors) == (2, "rambler-hil: --scheduler fish: write tcp://HOST:PORT\n")
