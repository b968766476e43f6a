"""Missions on the real autopilot through ptys: sailed to the end, and gone on with after a kill in the middle."""

import math
import os
import signal
import subprocess
import sys
from itertools import count

import numpy as np
import pytest
from support.paths import ROOT

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.system.state_directory import PLAN_FILES
from firmware_py.system.store import Store
from hil.devices.emulator import METRES_PER_DEGREE
from hil.devices.pty_line import PtyLine
from hil.ship import scenarios
from hil.sim.board import Board
from hil.sim.device_factory import emulators
from hil.sim.ground_station import GroundStation
from hil.sim.lockstep import LockstepServer
from hil.sim.pace import Pacer
from hil.sim.process import AutopilotProcess
from hil.sim.truth import read
from hil.sim.vehicle_file import file_text, standard_vehicle
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, START_UTC_S, World

AUTO = 10
SHRINK = math.cos(math.radians(START_LATITUDE_DEG))


def item(command, north_m=None, east_m=None, *params):
    x = y = 0
    if north_m is not None:
        x = round((START_LATITUDE_DEG + north_m / METRES_PER_DEGREE) * 1e7)
        y = round((START_LONGITUDE_DEG + east_m / METRES_PER_DEGREE / SHRINK) * 1e7)
    return PlanItem(command, 3, True, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def stored(directory, items):
    """Put a mission into a state directory, as an upload leaves it there."""
    store = Store(directory)
    store.save(PLAN_FILES[PlanKind.MISSION], plan_to_text(Plan.of(PlanKind.MISSION, items)).encode())
    store.close()


class Voyage:
    """One sea, and one autopilot after the other on the same board."""

    def __init__(self, directory, scenario, settings):
        self.directory = directory
        self.vehicle, self.settings = standard_vehicle(), settings
        self.world = World(scenario, 1, (), end_s=math.inf)
        station = GroundStation((), AUTO)
        devices = {**emulators(self.world, self.vehicle, 1), "link": station}
        (directory / "ports").mkdir()
        self.board = Board(self.world, devices, directory / "ports", PtyLine.deliver)
        self.number = count()

    def sail(self, until_s, *, kill):
        """Run a new autopilot up to a moment, then kill it or end it in good order; return what it said."""
        number = next(self.number)
        vehicle, log = self.directory / "vehicle.toml", self.directory / f"firmware{number}.log"
        vehicle.write_text(file_text(self.vehicle, self.board.paths(), self.settings))
        clock = self.directory / f"clock{number}"
        arguments = ["run", str(vehicle), "--state", str(self.directory / "state"), "--lockstep", str(clock)]
        with (
            LockstepServer(clock, self.board, Pacer(math.inf)) as server,
            AutopilotProcess(arguments, log) as firmware,
        ):
            server.accept(firmware.running, START_UTC_S + self.world.now_s)
            while self.world.now_s < until_s:
                assert server.serve(until_s), firmware.last_words()
            if kill:
                os.kill(firmware._process.pid, signal.SIGKILL)
                firmware.wait(10.0)
            server.close()
        return log.read_text()

    def track(self, from_s):
        return np.array([(row[0], row[7], row[8]) for row in self.world.truth.rows if row[0] >= from_s])


def test_killed_in_the_middle_it_goes_on_with_the_mission(tmp_path):
    stored(tmp_path / "state", [item(16, 60, 0), item(16, 60, 90), item(17, 0, 90)])
    settings = {"BOOT_RESUME": 2, "LOIT_RADIUS": 40.0, "WP_RADIUS": 15.0}
    scenario = scenarios.Scenario("stream", "", 1.0, 6.0, 3.0, 2.0, 0.0, 0.2, 120.0)
    voyage = Voyage(tmp_path, scenario, settings)
    said = voyage.sail(110.0, kill=True)
    assert "Mission: item 1" in said
    assert "Mission: item 2" not in said
    said = voyage.sail(300.0, kill=False)
    voyage.board.close()
    assert "Resumed AUTO" in said
    assert "Mission: item 0" not in said
    assert "Mission: item 2" in said
    # On the same line as before, not on a new one from where it was killed.
    line = voyage.track(125.0)
    on_leg = line[: np.argmax(line[:, 2] > 70.0)]
    assert len(on_leg) > 20
    assert np.abs(on_leg[:, 1] - 60.0).max() < 15.0
    end = voyage.track(295.0)
    assert np.hypot(end[:, 1], end[:, 2] - 90.0).max() < 60.0


EVERY_KIND = [
    item(16, 200, 0),
    item(178, None, None, 0, 0.5),
    item(16, 200, 150, 60),
    item(115, None, None, 180, 0, 0, 0),
    item(93, None, None, 120),
    item(213, None, None, 90, 0, 1),
    item(18, 100, 250, 2, 0, 50),
    item(19, 0, 150, 120, 0, 60),
    item(179, 20, 20, 0),
    item(16, 0, 60),
    item(177, None, None, 9, 1),
    item(20),
    item(17, 0, 0),
]


@pytest.mark.proof
def test_a_mission_with_every_kind_of_item_is_sailed_to_its_end(tmp_path):
    stored(tmp_path / "memory", EVERY_KIND)
    command = [sys.executable, "-m", "hil", "run", "mission", "--mode", "auto", "--state", str(tmp_path / "memory")]
    more = ["--set", "LOIT_RADIUS=60", "--seconds", "4000", "--speed", "max", "--out", str(tmp_path / "out")]
    done = subprocess.run([*command, *more], cwd=ROOT, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    said = (tmp_path / "out" / "firmware.log").read_text()
    for index in (0, 2, 3, 4, 5, 6, 7, 9, 11, 12):
        assert f"Mission: item {index}\n" in said
    truth = read(tmp_path / "out" / "truth.csv")
    last = truth.time_s > truth.time_s[-1] - 600.0
    assert np.mean(np.hypot(truth.north_m[last], truth.east_m[last]) < 65.0) > 0.95
    logs = sorted((tmp_path / "out" / "state" / "logs").glob("*.BIN"))
    for log in logs:
        replay = [sys.executable, "-m", "firmware_py", "replay", str(log)]
        assert subprocess.run(replay, cwd=ROOT, check=False, capture_output=True).returncode == 0
