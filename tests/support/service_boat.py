"""A boat on a mission with the autopilot as a service; frames on the servo line show the time between two starts."""

import math
import os
import sys
import time

import pytest

from firmware_py.install.service_files import TRIAL, Service, build_trial_script, build_unit
from firmware_py.plans.items import Command
from firmware_py.system.endings import ENDINGS_FILE, from_bytes
from firmware_py.system.slots import read_content
from hil.bench.rig import GoalRecorder
from support.paths import ROOT
from support.plans import item
from support.retrying_station import RetryingStation, send_once
from support.service_manager import ServiceManager

SETTINGS = {"BOOT_RESUME": 2, "WP_RADIUS": 5.0, "CLK_SET": 0}
AUTO, ARMED = 10, 128
ARM, SET_MODE, SET_CURRENT = 400, 176, 224
FORCE_ARM = 21196.0  # skips the arming checks
HEARTBEAT, CURRENT, TARGET = 0, 42, 87
ITEMS = tuple(item(Command.WAYPOINT, 4000.0 * math.cos(0.7 * n), 4000.0 * math.sin(0.7 * n)) for n in range(8))
PATIENCE_S = 45.0


class GoalTap:
    """Observer of the servo line: stores the monotonic time of each complete goal frame."""

    def __init__(self, servo):
        self._receive, servo.receive = servo.receive, self._take
        self._watch = GoalRecorder()
        self.times_s = self._watch.times_s

    def _take(self, now_s, data):
        self._watch.receive(time.monotonic(), data)
        self._receive(now_s, data)

    def first_after(self, t_s):
        """Wait for the first frame after t_s; return its time."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            if self.times_s and self.times_s[-1] > t_s:
                return next(frame_s for frame_s in self.times_s if frame_s > t_s)
            time.sleep(0.005)
        return pytest.fail(f"no rudder frame within {PATIENCE_S} s")


class ServiceBoat:
    """A boat on a mission with the autopilot as a service."""

    def __init__(self, boat, program=(sys.executable, "-m", "firmware_py"), environment=()):
        self.boat, self.goals, self.station = boat, GoalTap(boat.servo), RetryingStation()
        port = self.station.connect()
        vehicle = boat.directory / "boat.toml"
        vehicle.write_text(vehicle.read_text() + f'[link]\nurls = ["udpin:127.0.0.1:{port}"]\n')
        self.runtime = boat.directory / "run"
        self.log = boat.directory / "service.log"
        trial = boat.directory / "rambler/trial"
        trial.parent.mkdir()
        trial.write_text(build_trial_script())
        unit = build_unit(Service(tuple(map(str, program)), vehicle, boat.state)).replace(str(TRIAL), str(trial))
        self.unit = boat.directory / "rambler.service"
        self.unit.write_text(unit)
        more = {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", **dict(environment)}
        self.manager = ServiceManager(unit, self.runtime, self.log, more)
        self.number = 1

    def get_under_way(self):
        """Arm, start the mission, and steer to its first item."""
        self.goals.first_after(0.0)
        give_up_s = time.monotonic() + PATIENCE_S
        while not (self.order(SET_MODE, 1.0, float(AUTO)) and self.order(ARM, 1.0, FORCE_ARM)):
            assert time.monotonic() < give_up_s  # it is refused without heading and position
        self.go_to(1)

    def order(self, number, *values):
        steps = send_once(self.station, self.station.command(number, *values), number)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value

    def go_to(self, number):
        assert self.order(SET_CURRENT, float(number))
        self.number = number

    def assert_state_kept(self):
        """Assert that mode, arming, goal and item are those at the end of the previous run."""
        beat = self.station.request(HEARTBEAT)
        assert (beat.custom_mode, beat.base_mode & ARMED) == (AUTO, ARMED), self.log.read_text()[-2000:]
        assert self.station.request(CURRENT).seq == self.number
        target, wanted = self.station.request(TARGET), ITEMS[self.number - 1]
        assert (target.lat_int, target.lon_int) == (wanted.x, wanted.y)

    def wait_for_runs(self, count):
        """Wait until this number of runs has started; return the last one."""
        give_up_s = time.monotonic() + PATIENCE_S
        while len(self.manager.runs) < count:
            assert time.monotonic() < give_up_s, self.log.read_text()[-2000:]
            time.sleep(0.005)
        return self.manager.runs[-1]

    def endings(self):
        return from_bytes(read_content(self.boat.state, ENDINGS_FILE))[0]

    def disturb_run(self, disturb):
        """Disturb the running service; return the ended run, the next run, and the time of its first frame."""
        count = len(self.manager.runs)
        disturb(self.manager.runs[-1].pid)
        after = self.wait_for_runs(count + 1)
        return self.manager.runs[-2], after, self.goals.first_after(after.begun_s)
