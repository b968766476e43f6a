"""Campaigns as processes: after kills, restarts and on clusters, the results are the same."""

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
from functools import partial

import pytest

from hil.lab.campaign import store
from support.harness import INTERRUPTED, rambler_hil, start_rambler_hil
from support.paths import ROOT
from support.processes import children, command_line, wait_until

pytestmark = pytest.mark.timeout(600)  # includes half a minute for compilation of the loop

wait = partial(wait_until, timeout_s=300.0)
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


def workers(pid):
    """Return the worker processes of a process."""
    return [child for child in children(pid) if b"spawn_main" in command_line(child)]


def start_campaign(spec, out, *words):
    """Write the specification and start the campaign."""
    path = out.with_suffix(".toml")
    path.write_text(spec)
    return start_rambler_hil("campaign", path, "--out", out, *words)


def run_campaign(spec, out, *words):
    """Run a campaign to its end and return the bytes of its results."""
    campaign = start_campaign(spec, out, *words)
    output, errors = campaign.communicate()
    assert campaign.returncode == 0, errors
    assert str(out / store.RUNS) in output
    return (out / store.RUNS).read_bytes()


def count_batches(out):
    """Return the number of stored batches."""
    return len(list((out / store.PARTS).glob("*.parquet")))


@pytest.mark.proof
def test_campaign_with_a_killed_worker_and_a_restart_gives_equal_results(tmp_path):
    undisturbed = run_campaign(COMPILED, tmp_path / "whole", "--workers", "1")
    out = tmp_path / "killed"
    campaign = start_campaign(COMPILED, out, "--workers", "1")
    wait(lambda: count_batches(out) >= 2)
    os.kill(workers(campaign.pid)[0], signal.SIGKILL)
    wait(lambda: count_batches(out) >= 5)
    worker_pids = workers(campaign.pid)
    campaign.kill()
    campaign.communicate()
    wait(lambda: not any(b"spawn_main" in command_line(pid) for pid in worker_pids))
    assert not (out / store.RUNS).exists()
    code, _, errors = rambler_hil("campaign", out.with_suffix(".toml"), "--out", out)
    assert (code, "continue with --resume" in errors) == (2, True)
    assert run_campaign(COMPILED, out, "--workers", "2", "--resume") == undisturbed


@pytest.mark.proof
def test_terminated_campaign_names_the_option_that_resumes_it(tmp_path):
    old_name = COMPILED.replace('"compiled"', '"twin"')
    campaign = start_campaign(old_name, tmp_path / "out", "--workers", "1")
    wait(lambda: count_batches(tmp_path / "out") >= 1)
    worker_pids = workers(campaign.pid)
    campaign.send_signal(signal.SIGTERM)
    _, errors = campaign.communicate()
    assert campaign.returncode == INTERRUPTED
    assert 'engine: "twin" is the old name of "compiled"' in errors
    assert errors.endswith("rambler-hil: interrupted; finished runs are stored, continue with --resume\n")
    assert "Traceback" not in errors
    wait(lambda: not any(b"spawn_main" in command_line(pid) for pid in worker_pids))


@pytest.mark.proof
def test_repeated_campaign_and_replayed_run_are_bit_identical(tmp_path):
    out, run = tmp_path / "first", tmp_path / "run"
    results = run_campaign(FIRMWARE, out, "--workers", "1")
    assert run_campaign(FIRMWARE, tmp_path / "second", "--workers", "2") == results
    runs = store.read_table(out / store.RUNS).to_pylist()
    assert [row["ended"] for row in runs] == ["finished", "finished"]
    assert runs[0]["digest"] != runs[1]["digest"]
    code, output, errors = rambler_hil("campaign", "replay", out, "1", "--out", run)
    assert (code, output.splitlines()[0]) == (0, "run 1: identical to the last bit"), errors
    assert hashlib.sha256((run / "truth.csv").read_bytes()).hexdigest() == runs[1]["digest"]
    assert (run / "report.html").exists()


@pytest.mark.proof
def test_compiled_run_equals_its_replay_by_the_autopilot(tmp_path):
    out = tmp_path / "out"
    run_campaign(COMPILED.replace("runs = 640", "runs = 4"), out)
    for row in range(4):
        code, output, errors = rambler_hil("campaign", "replay", out, row, "--out", tmp_path / "run")
        assert (code, output.splitlines()[0]) == (0, f"run {row}: identical to the last bit"), errors
    (out / store.RUNS).unlink()
    (out / store.PARTS).mkdir()
    code, _, errors = rambler_hil("campaign", "replay", out, "1", "--out", tmp_path / "run")
    assert (code, "is not finished" in errors) == (2, True)


@contextlib.contextmanager
def dask_cluster():
    """Start a dask scheduler with two workers; yield its process and its address."""
    command = [sys.executable, str(ROOT / "tests" / "support" / "dask_cluster.py")]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.stdin.close()


@pytest.mark.proof
def test_dask_cluster_with_killed_processes_gives_equal_results(tmp_path):
    undisturbed = run_campaign(COMPILED, tmp_path / "whole", "--workers", "1")
    with dask_cluster() as (_, address):
        assert run_campaign(COMPILED, tmp_path / "cluster", "--scheduler", address) == undisturbed
    out = tmp_path / "killed"
    with dask_cluster() as (process, address):
        campaign = start_campaign(COMPILED, out, "--scheduler", address)
        wait(lambda: count_batches(out) >= 2)
        os.kill(workers(process.pid)[0], signal.SIGKILL)
        wait(lambda: count_batches(out) >= 10)
        process.kill()  # it contains the scheduler
        _, errors = campaign.communicate()
        assert (campaign.returncode, "continue with --resume" in errors) == (1, True), errors
        assert "Traceback" not in errors
    with dask_cluster() as (_, address):
        assert run_campaign(COMPILED, out, "--scheduler", address, "--resume") == undisturbed
    code, _, errors = rambler_hil(
        "campaign", out.with_suffix(".toml"), "--out", tmp_path / "fish", "--scheduler", "fish"
    )
    assert (code, errors) == (2, "rambler-hil: --scheduler fish: write tcp://HOST:PORT\n")
