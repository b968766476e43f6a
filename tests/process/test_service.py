"""The autopilot as a service: killed, frozen and stuck at any moment, it is back under way by the unit's own rules.

systemd's part is played by a stand-in that reads the unit (support/service_manager.py). The proofs do it 200 and
50 times, or `KILLS=20 FREEZES=5 pytest -m proof tests/process/test_service.py -s`, and print what took how long.
"""

import json
import math
import os
import random
import signal
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from firmware_py.install.service_files import Service, unit_text
from firmware_py.system.endings import ENDINGS_FILE, from_text
from firmware_py.system.slots import stored_content
from hil.bench.rig import GoalWatch
from support.asking_station import ACCEPTED, AskingStation, answered
from support.paths import ROOT
from support.plans import item, mission_file
from support.service_manager import ServiceManager, seconds

KILLS, FREEZES = int(os.environ.get("KILLS", "200")), int(os.environ.get("FREEZES", "50"))
SETTINGS = {"BOOT_RESUME": 2, "WP_RADIUS": 5.0, "CLK_SET": 0}
AUTO, ARMED = 10, 128
ARM, SET_MODE, SET_CURRENT = 400, 176, 224
HEARTBEAT, CURRENT, TARGET = 0, 42, 87
ITEMS = tuple(item(16, 4000.0 * math.cos(0.7 * n), 4000.0 * math.sin(0.7 * n)) for n in range(8))
PATIENCE_S = 45.0
BACK_S = 2.0  # from the start of a run to its first rudder frame
HANGS = ("tick", "store", "log", "ended")


class GoalTap:
    """Between the servo and its line: notes when each whole goal frame had come, in monotonic time."""

    def __init__(self, servo):
        self._receive, servo.receive = servo.receive, self._take
        self._watch = GoalWatch()
        self.times_s = self._watch.times_s

    def _take(self, now_s, data):
        self._watch.take(time.monotonic(), data)
        self._receive(now_s, data)

    def first_after(self, t_s):
        """When the first frame after a moment came; it is waited for."""
        give_up_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up_s:
            if self.times_s and self.times_s[-1] > t_s:
                return next(frame_s for frame_s in self.times_s if frame_s > t_s)
            time.sleep(0.005)
        return pytest.fail(f"no rudder frame within {PATIENCE_S} s")


class ServiceBoat:
    """A boat on a mission whose autopilot is a service."""

    def __init__(self, boat, program=(sys.executable, "-m", "firmware_py"), environment=()):
        self.boat, self.goals, self.station = boat, GoalTap(boat.servo), AskingStation()
        port = self.station.connect()
        vehicle = boat.directory / "boat.toml"
        vehicle.write_text(vehicle.read_text() + f'[link]\nurls = ["udpin:127.0.0.1:{port}"]\n')
        self.runtime = boat.directory / "run"
        self.log = boat.directory / "service.log"
        unit = unit_text(Service(tuple(map(str, program)), vehicle, boat.state))
        more = {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", **dict(environment)}
        self.manager = ServiceManager(unit, self.runtime, self.log, more)
        self.number = 1

    def under_way(self):
        """Arm, begin the mission, and go to its first item."""
        self.goals.first_after(0.0)
        give_up_s = time.monotonic() + PATIENCE_S
        while not (self.order(SET_MODE, 1.0, float(AUTO)) and self.order(ARM, 1.0, 21196.0)):
            assert time.monotonic() < give_up_s  # it wants a heading and a place
        self.go_to(1)

    def order(self, number, *values):
        steps = answered(self.station, self.station.command(number, *values), number)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value

    def go_to(self, number):
        assert self.order(SET_CURRENT, float(number))
        self.number = number

    def assert_as_before(self):
        """Mode, arming, goal and item are what they were when the run before has ended."""
        beat = self.station.told(HEARTBEAT)
        assert (beat.custom_mode, beat.base_mode & ARMED) == (AUTO, ARMED), self.log.read_text()[-2000:]
        assert self.station.told(CURRENT).seq == self.number
        target, wanted = self.station.told(TARGET), ITEMS[self.number - 1]
        assert (target.lat_int, target.lon_int) == (wanted.x, wanted.y)

    def runs(self, count):
        """Wait until so many runs have begun; return the last one."""
        give_up_s = time.monotonic() + PATIENCE_S
        while len(self.manager.runs) < count:
            assert time.monotonic() < give_up_s, self.log.read_text()[-2000:]
            time.sleep(0.005)
        return self.manager.runs[-1]

    def endings(self):
        return from_text(stored_content(self.boat.state, ENDINGS_FILE).decode())

    def disturbed(self, disturb):
        """Disturb the running service; return the run that was ended, the next one, and when its first frame came."""
        count = len(self.manager.runs)
        disturb(self.manager.runs[-1].pid)
        after = self.runs(count + 1)
        return self.manager.runs[-2], after, self.goals.first_after(after.begun_s)


@pytest.fixture
def make_service(make_boat):
    """Make a boat that lives in a thread of its own, and its service."""
    ended, threads = threading.Event(), []

    @contextmanager
    def make(**more):
        boat = make_boat(speed=None, settings=SETTINGS, without=("link",), plans=[mission_file(*ITEMS)])
        boat.time.begin(boat.board, None)

        def live():
            while not ended.is_set():
                boat.time.step(boat.board, boat.now_s + 0.05)

        service = ServiceBoat(boat, **more)
        threads.append(threading.Thread(target=live))
        threads[-1].start()
        with service.manager, service.station.socket:
            yield service

    yield make
    ended.set()
    for thread in threads:
        thread.join()


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


def test_killed_she_is_back_under_way_with_mode_goal_and_item(make_service):
    sail_and_disturb(make_service, kill, 2)


def test_frozen_she_is_found_and_back_under_way(make_service):
    sail_and_disturb(make_service, freeze, 1)


@pytest.mark.proof
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(("what", "times"), [(kill, KILLS), (freeze, FREEZES)], ids=["kills", "freezes"])
def test_back_under_way_within_two_seconds_of_each_restart(make_service, what, times):
    begun_s = time.monotonic()
    back_s = sail_and_disturb(make_service, what, times)
    print(f"in {time.monotonic() - begun_s:.0f} s, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    assert back_s[-1] < BACK_S


@pytest.mark.parametrize("part", ["tick", pytest.param("store", marks=pytest.mark.proof)])
def test_what_hangs_is_found_and_mended_by_a_restart(make_service, tmp_path, part):
    hang_and_restart(make_service, tmp_path, part)


def hang_and_restart(make_service, tmp_path, part):
    """Have a part hang; return when it did, the run that had it, and when the first frame of the next run came."""
    (hangs := tmp_path / "hangs").mkdir()
    program = (sys.executable, Path(ROOT) / "tests/support/hanging.py")
    with make_service(program=program, environment={"HANG_DIRECTORY": str(hangs)}) as service:
        service.under_way()
        time.sleep(2.0)

        def hang(_pid):
            (hangs / part).touch()
            if part == "store":  # it has something to store; nobody is told that it is
                message = service.station.command(SET_CURRENT, float(service.number))
                other = service.station.command(SET_CURRENT, 2.0)
                for one in (*other, *message):
                    service.station.send(one)

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


@pytest.mark.proof
@pytest.mark.timeout(600)
def test_the_watchdog_table(make_service, tmp_path):
    for part in HANGS:
        (folder := tmp_path / part).mkdir()
        hang_and_restart(make_service, folder, part)


def test_the_stand_in_reads_the_unit_as_it_is():
    assert seconds("200ms") == 0.2
    assert seconds("5") == 5.0
    assert ACCEPTED == 0
