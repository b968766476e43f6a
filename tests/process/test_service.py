"""The autopilot as a service: killed, frozen and stuck at any moment, it is back under way by the unit's own rules.

systemd's part is played by a stand-in that reads the unit (support/service_manager.py). The proofs do it 200 and
50 times, or `KILLS=20 FREEZES=5 pytest -m proof tests/process/test_service.py -s`, and print what took how long.
"""

import json
import os
import random
import signal
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from support.asking_station import ACCEPTED, REQUEST
from support.paths import ROOT
from support.service_boat import HEARTBEAT, ITEMS, SET_CURRENT
from support.service_manager import seconds

KILLS, FREEZES = int(os.environ.get("KILLS", "200")), int(os.environ.get("FREEZES", "50"))
BACK_S = 2.0  # from the start of a run to its first rudder frame
HANGS = ("tick", "store", "log", "ended", "samples", "actuation")
FAILS, WORKS = "Storage error: logs or settings not saved", "Storage error cleared"


def kill(pid):
    os.kill(pid, signal.SIGKILL)


def freeze(pid):
    os.kill(pid, signal.SIGSTOP)


def spread(name, values_s):
    values_s = sorted(values_s)
    p50, p99 = (values_s[min(len(values_s) - 1, round(share * (len(values_s) - 1)))] for share in (0.5, 0.99))
    print(f"{name}: {len(values_s)} times, p50 {p50:.3f} s, p99 {p99:.3f} s, max {values_s[-1]:.3f} s")
    return values_s


def sail_and_disturb(make_service, what, times):
    """Disturb a boat on its mission again and again; return how long each run took to its first frame."""
    numbers = random.Random(20180825)
    back_s, away_s, found_s = [], [], []
    with make_service() as service:
        service.under_way()
        for count in range(1, times + 1):
            if numbers.random() < 0.5:
                service.go_to(numbers.randrange(1, 1 + len(ITEMS)))
            time.sleep(numbers.uniform(0.0, 1.0))
            done_s = time.monotonic()
            before, after, frame_s = service.disturbed(what)
            back_s.append(frame_s - after.begun_s)
            away_s.append(frame_s - done_s)
            found_s.append((before.alarm_s or before.ended_s) - done_s)
            service.assert_as_before()
            endings = service.endings()
            why = "killed" if what is kill else "watchdog"
            assert (endings.counts[why], endings.last[-1].why) == (count, why)
    spread(f"{what.__name__}: found after", found_s)
    spread(f"{what.__name__}: without a rudder frame", away_s)
    return spread(f"{what.__name__}: first rudder frame after the start", back_s)


def test_after_a_kill_the_service_resumes_mode_goal_and_item(make_service):
    sail_and_disturb(make_service, kill, 1)


@pytest.mark.proof
def test_a_frozen_autopilot_is_detected_and_restarted(make_service):
    sail_and_disturb(make_service, freeze, 1)


@pytest.mark.proof
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(("what", "times"), [(kill, KILLS), (freeze, FREEZES)], ids=["kills", "freezes"])
def test_each_restart_steers_within_two_seconds(make_service, what, times):
    begun_s = time.monotonic()
    back_s = sail_and_disturb(make_service, what, times)
    print(f"in {time.monotonic() - begun_s:.0f} s, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    assert back_s[-1] < BACK_S


@pytest.mark.timeout(300)
@pytest.mark.parametrize("part", ["tick", *(pytest.param(part, marks=pytest.mark.proof) for part in HANGS[1:])])
def test_a_hang_is_detected_and_ended_by_a_restart(make_service, tmp_path, part):
    hang_and_restart(make_service, tmp_path, part)


def have_something_stored(service):
    """Request a change that is acknowledged when it is stored, without waiting."""
    for number in (2.0, float(service.number)):
        service.station.send(*service.station.command(SET_CURRENT, number))


def wait_for_text(station, text):
    """Wait for a text and keep sending: a silent peer receives nothing."""
    station.ask(station.command(REQUEST, HEARTBEAT), lambda one: one if getattr(one, "text", "") == text else None)


@pytest.mark.proof
@pytest.mark.timeout(300)
def test_a_disk_blocked_in_the_kernel_is_reported_and_control_continues(make_service, tmp_path):
    """`pytest -m proof tests/process/test_service.py -k kernel -s`: a restart would not end the thread either."""
    (hangs := tmp_path / "hangs").mkdir()
    os.mkfifo(hangs / "pipe")
    program = (sys.executable, Path(ROOT) / "tests/support/hanging.py")
    with make_service(program=program, environment={"HANG_DIRECTORY": str(hangs)}) as service:
        service.under_way()
        (hangs / "disk").touch()
        done_s = time.monotonic()
        have_something_stored(service)
        wait_for_text(service.station, FAILS)
        reported_s = time.monotonic()
        frames = len(service.goals.times_s)
        time.sleep(10.0)
        assert len(service.goals.times_s) > frames + 50
        os.close(os.open(hangs / "pipe", os.O_WRONLY))
        wait_for_text(service.station, WORKS)
        assert len(service.manager.runs) == 1
        service.assert_as_before()
    longest_s = max(after - before for before, after in pairwise(service.goals.times_s) if after > done_s)
    print(f"reported after {reported_s - done_s:.1f} s, longest without a rudder frame {longest_s:.2f} s")


def hang_and_restart(make_service, tmp_path, part):
    """Have a part hang; return when it did, the run that had it, and when the first frame of the next run came."""
    (hangs := tmp_path / "hangs").mkdir()
    program = (sys.executable, Path(ROOT) / "tests/support/hanging.py")
    with make_service(program=program, environment={"HANG_DIRECTORY": str(hangs)}) as service:
        service.under_way()
        time.sleep(2.0)

        def hang(_pid):
            (hangs / part).touch()
            if part == "store":
                have_something_stored(service)

        done_s = time.monotonic()
        before, after, frame_s = service.disturbed(hang)
        service.assert_as_before()
        last = service.endings().last[-1]
    print(
        json.dumps(
            {
                "part": part, "found_s": round((before.alarm_s or before.ended_s) - done_s, 2), "why": last.why,
                "text": last.text, "back_s": round(frame_s - after.begun_s, 3),
            }
        )
    )  # fmt: skip
    assert last.why == ("watchdog" if part == "tick" else "stuck"), last
    return last


def test_the_simulated_systemd_reads_the_unit_file():
    assert seconds("200ms") == 0.2
    assert seconds("5") == 5.0
    assert ACCEPTED == 0
