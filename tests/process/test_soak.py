"""A day simulated and an hour in real time: nothing of harness or autopilot grows, and no tick is lost.

`pytest -m proof tests/process/test_soak.py -s`; `-k real` takes an hour and hardly any processor, `-k simulated` as
long as the machine needs for a day in lockstep.
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
LOOK_S = 5.0
SETTLED = 0.1  # of a run, after which it has all that it needs
RATE_HZ = 10
TAIL = 4096


def goals(seconds, every_s):
    """Another heading now and then, all the way round."""
    return ",".join(f"{n * every_s:g}:{n * 100 % 360}" for n in range(int(seconds / every_s)))


def simulated_s(truth):
    """How far a run has come, by the last whole row that it has written."""
    with truth.open("rb") as file:
        file.seek(max(0, truth.stat().st_size - TAIL))
        rows = file.read().split(b"\n")[1:-1]
    return float(rows[-1].split(b",")[0]) if rows else 0.0


def held(pid):
    """Resident memory [MiB], descriptors and threads of a process."""
    proc = Path("/proc") / str(pid)
    return memory_of(pid).now_mib, len(list((proc / "fd").iterdir())), len(list((proc / "task").iterdir()))


def autopilots(pid):
    """The processes of autopilots that a harness has started; it starts others for a moment."""
    words = {child: (Path("/proc") / str(child) / "cmdline") for child in children_of(pid)}
    try:
        return [child for child, path in words.items() if b"firmware_py" in path.read_bytes()]
    except OSError:  # one has ended meanwhile
        return []


def soaked(tmp_path, seconds, words):
    """Make a run; return what each of its two processes held while it went, by the time of the boat, and its loop."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "hil", "run", "sea", "--with", "supply", "--seconds", str(seconds), *words]
    seen = {"harness": [], "autopilot": []}
    with closing(Program("hil", [*command, "--out", str(out)], tmp_path)) as program:
        (autopilot,) = program.wait_for(
            lambda: (out / "truth.csv").exists() and autopilots(program.pid), "no autopilot"
        )
        while program.running():
            try:
                looked = {name: held(pid) for name, pid in (("harness", program.pid), ("autopilot", autopilot))}
            except OSError:  # it ends
                break
            now_s = simulated_s(out / "truth.csv")
            if now_s >= seconds - 1.0:
                break  # from now on the harness makes its page
            for name, one in looked.items():
                seen[name].append((now_s, *one))
            time.sleep(LOOK_S)
        assert program.exit_code(600.0) == 0, program.text()
    return seen, json.loads((out / "summary.json").read_text())


def assert_level(seen, seconds):
    for name, looks in seen.items():
        settled = [look for look in looks if look[0] >= SETTLED * seconds]
        assert len(settled) > 20, "it was looked at"
        _, memory, descriptors, threads = zip(*settled, strict=True)
        tenths = [round(memory[len(memory) * n // 10], 2) for n in range(10)]
        print(f"{name}: {tenths} MiB, at most {max(memory) - memory[0]:.2f} MiB more than at first", end="; ")
        more = sum(one > descriptors[0] for one in descriptors)
        print(f"descriptors {min(descriptors)} to {max(descriptors)}, {descriptors[-1]} in the end", end=", ")
        print(f"more than at first in {more} of {len(settled)} looks; threads {min(threads)} to {max(threads)}")
    for looks in seen.values():
        settled = [look for look in looks if look[0] >= SETTLED * seconds]
        _, memory, descriptors, threads = zip(*settled, strict=True)
        assert max(memory) - memory[0] <= 1.0
        # Files are open for a moment, as when a log is packed: what is lost is open in every look of the last tenth.
        last = len(settled) // 10 + 1
        assert min(descriptors[-last:]) <= descriptors[0]
        assert min(threads[-last:]) <= threads[0]


@pytest.mark.proof
@pytest.mark.timeout(6 * HOUR_S)
def test_nothing_grows_in_a_simulated_day(tmp_path):
    seconds = float(os.environ.get("SOAK_SIMULATED_S", DAY_S))
    seen, summary = soaked(tmp_path, seconds, ["--speed", "max", "--goal", goals(seconds, seconds / 24.0)])
    print(f"simulated: {summary['speed_ratio']:.0f} times real time, {summary['loop']}")
    assert_level(seen, seconds)
    assert summary["loop"]["skipped"] == 0


@pytest.mark.proof
@pytest.mark.timeout(2 * HOUR_S)
def test_nothing_grows_in_a_real_hour_and_no_tick_is_lost(tmp_path):
    """With a station that listens; a tick may be lost where a process that only sleeps loses one, too."""
    seconds = float(os.environ.get("SOAK_REAL_S", HOUR_S))
    sleeper = bare_sleep.command(RATE_HZ, int(seconds * RATE_HZ))
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as station:
        station.bind(("127.0.0.1", 0))
        link = ["--link", f"udpout:127.0.0.1:{station.getsockname()[1]}", "--set", f"LOOP_RATE_HZ={RATE_HZ}"]
        with subprocess.Popen(sleeper, stdout=subprocess.PIPE, text=True) as bare:
            try:
                seen, summary = soaked(tmp_path, seconds, ["--goal", goals(seconds, seconds / 12.0), *link])
                late_s = json.loads(bare.communicate(timeout=60.0)[0])
            finally:
                bare.kill()
    lost = sum(int(one_s * RATE_HZ) for one_s in late_s)
    print(f"real: {summary['loop']}; one who only sleeps was at most {max(late_s) * 1e6:.0f} us late, lost {lost}")
    assert_level(seen, seconds)
    assert summary["loop"]["skipped"] <= lost
