"""In a simulated day and in an hour of real time, harness and autopilot do not grow and no tick is lost.

`pytest -m proof tests/process/test_soak.py -s`; `-k real` takes an hour and little processor time, `-k simulated` the
time that the machine needs for a day in lockstep.
"""

import json
import os
import socket
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from hil.bench.machine import children_of, memory_of
from support import bare_sleep
from support.program import Program

DAY_S, HOUR_S = 86_400.0, 3600.0
SAMPLE_INTERVAL_S = 5.0
SETTLING_FRACTION = 0.1  # of a run, in which memory may still grow
RATE_HZ = 10
TAIL_BYTES = 4096


def goals(seconds, every_s):
    """Return goals in all directions, one per interval."""
    return ",".join(f"{n * every_s:g}:{n * 100 % 360}" for n in range(int(seconds / every_s)))


def simulated_s(truth):
    """Return the simulated time of the last complete row of truth.csv."""
    with truth.open("rb") as file:
        file.seek(max(0, truth.stat().st_size - TAIL_BYTES))
        rows = file.read().split(b"\n")[1:-1]
    return float(rows[-1].split(b",")[0]) if rows else 0.0


def resources_of(pid):
    """Return resident memory [MiB], number of descriptors and number of threads of a process."""
    proc = Path("/proc") / str(pid)
    return memory_of(pid).now_mib, len(list((proc / "fd").iterdir())), len(list((proc / "task").iterdir()))


def autopilots_of(pid):
    """Return the autopilots that a harness has started; it also starts short-lived processes."""
    words = {child: (Path("/proc") / str(child) / "cmdline") for child in children_of(pid)}
    try:
        return [child for child, path in words.items() if b"firmware_py" in path.read_bytes()]
    except OSError:  # a process has ended meanwhile
        return []


def run_and_sample(tmp_path, seconds, words):
    """Run the harness; return the resources of both processes over simulated time, and the summary."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "hil", "run", "sea", "--with", "supply", "--seconds", str(seconds), *words]
    samples = {"harness": [], "autopilot": []}
    with closing(Program("hil", [*command, "--out", str(out)], tmp_path)) as program:
        (autopilot,) = program.wait_for(
            lambda: (out / "truth.csv").exists() and autopilots_of(program.pid), "no autopilot"
        )
        while program.running():
            try:
                resources = {
                    name: resources_of(pid) for name, pid in (("harness", program.pid), ("autopilot", autopilot))
                }
            except OSError:  # it ends
                break
            now_s = simulated_s(out / "truth.csv")
            if now_s >= seconds - 1.0:
                break  # the harness now writes its page
            for name, values in resources.items():
                samples[name].append((now_s, *values))
            time.sleep(SAMPLE_INTERVAL_S)
        assert program.exit_code(600.0) == 0, program.text()
    return samples, json.loads((out / "summary.json").read_text())


def assert_no_growth(samples, seconds):
    for name, rows in samples.items():
        settled_rows = [row for row in rows if row[0] >= SETTLING_FRACTION * seconds]
        assert len(settled_rows) > 20, "too few samples"
        _, memory, descriptors, threads = zip(*settled_rows, strict=True)
        tenths = [round(memory[len(memory) * n // 10], 2) for n in range(10)]
        growth_mib = max(memory) - memory[0]
        print(f"{name}: {tenths} MiB, growth up to {growth_mib:.2f} MiB", end="; ")
        excess_count = sum(count > descriptors[0] for count in descriptors)
        print(f"descriptors {min(descriptors)} to {max(descriptors)}, {descriptors[-1]} in the end", end=", ")
        print(f"more than at first in {excess_count} of {len(settled_rows)}; threads {min(threads)} to {max(threads)}")
    for rows in samples.values():
        settled_rows = [row for row in rows if row[0] >= SETTLING_FRACTION * seconds]
        _, memory, descriptors, threads = zip(*settled_rows, strict=True)
        assert max(memory) - memory[0] <= 1.0
        # Files may be open for a moment; a leaked one is open in every sample of the last tenth.
        tail_count = len(settled_rows) // 10 + 1
        assert min(descriptors[-tail_count:]) <= descriptors[0]
        assert min(threads[-tail_count:]) <= threads[0]


@pytest.mark.proof
@pytest.mark.timeout(6 * HOUR_S)
def test_resources_do_not_grow_in_a_simulated_day(tmp_path):
    seconds = float(os.environ.get("SOAK_SIMULATED_S", DAY_S))
    samples, summary = run_and_sample(tmp_path, seconds, ["--speed", "max", "--goal", goals(seconds, seconds / 24.0)])
    print(f"simulated: {summary['speed_ratio']:.0f} times real time, {summary['loop']}")
    assert_no_growth(samples, seconds)
    assert summary["loop"]["skipped"] == 0


@pytest.mark.proof
@pytest.mark.timeout(2 * HOUR_S)
def test_resources_do_not_grow_and_no_tick_is_lost_in_a_real_hour(tmp_path):
    """A tick may be lost where a process that only sleeps loses one, too."""
    seconds = float(os.environ.get("SOAK_REAL_S", HOUR_S))
    command = bare_sleep.command(RATE_HZ, int(seconds * RATE_HZ))
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as station:
        station.bind(("127.0.0.1", 0))
        link = ["--link", f"udpout:127.0.0.1:{station.getsockname()[1]}", "--set", f"LOOP_RATE_HZ={RATE_HZ}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as bare:
            try:
                samples, summary = run_and_sample(tmp_path, seconds, ["--goal", goals(seconds, seconds / 12.0), *link])
                late_s = json.loads(bare.communicate(timeout=60.0)[0])
            finally:
                bare.kill()
    lost_ticks = sum(int(value_s * RATE_HZ) for value_s in late_s)
    print(f"real: {summary['loop']}; a sleeping process was at most {max(late_s) * 1e6:.0f} us late, lost {lost_ticks}")
    assert_no_growth(samples, seconds)
    assert summary["loop"]["skipped"] <= lost_ticks
