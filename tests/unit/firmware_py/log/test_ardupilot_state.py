"""ArduPilot's tools on a log of ours: what they look for is there, true, and thin."""

import dataclasses
import importlib.util
import math
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from pymavlink import mavutil

from firmware_py.common.intents import ManualRudder, ReplacePlan, Request
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import (
    Activity,
    Energy,
    Estimate,
    Home,
    Navigation,
    Output,
    Power,
    Water,
)
from firmware_py.faults.fault import Fault
from firmware_py.log import ardupilot_formats
from firmware_py.log.ardupilot_state import version_bytes
from firmware_py.log.recorder import LogRecorder
from support.link import SNAPSHOT

TICKS, ARM_TICK, BREACH_TICK, STICK_TICK = 600, 100, 300, 400
ESTIMATE = Estimate(0, 1.02, *[0.1] * 15, 1.2)
FENCE = Plan.of(
    PlanKind.FENCE,
    [PlanItem(5001, 0, params=(3.0, 0, 0, 0), x=x, y=y) for x, y in ((1, 2), (3, 4), (5, 9))]
    + [PlanItem(5004, 0, params=(50.0, 0, 0, 0), x=7, y=8)],
)
MISSION = Plan.of(
    PlanKind.MISSION,
    [PlanItem(16, 3, x=400_000_000, y=-100_000_000), PlanItem(177, 2, params=(0.0, 2.0, 0, 0))],
)
RALLY = Plan.of(PlanKind.RALLY, [PlanItem(5100, 3, x=11, y=12, z=1.0)])


def inputs_of(index, requests=()):
    t_s = 100.0 + 0.1 * index
    return Inputs(
        tick=Tick(index, t_s, 0.001, 0, 10.0),
        headings=(HeadingSample(t_s, 1.0, NorthReference.TRUE, roll_rad=0.1, pitch_rad=0.02),),
        positions=(PositionSample(t_s, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, 1.5, 8, 1.25, 1.7e9 + index),)
        if index % 5 == 0
        else (),
        rudder=(RudderFeedback(t_s, 0.1, 31.0, 12.0, 0.2),),
        requests=requests,
    )


def boat(index):
    armed = index >= ARM_TICK
    return dataclasses.replace(
        SNAPSHOT,
        t_s=100.0 + 0.1 * index,
        tick=index,
        armed=armed,
        position=PositionSample(100.0, FixType.FIX_3D, 0.7, -0.2, 3.0, 0.5, 1.5),
        position_ok=True,
        home=Home(0.7, -0.2001, 1.0),
        bearing_rad=1.2,
        distance_m=40.0,
        faults=1 << Fault.FENCE_BREACHED if BREACH_TICK <= index < BREACH_TICK + 50 else 0,
        estimate=ESTIMATE,
        water=Water(0.4, 0.1, 0.2, -0.1, 0.1),
        navigation=Navigation(Activity.LINE, 0.7, -0.2, 20.0, 1.5, fence_enabled=index >= ARM_TICK),
        servo=RudderFeedback(100.0, 0.1, 31.0, 12.0, 0.2),
        energy=Energy(power_w=1.0, energy_j=10.0),
        power=Power(12.9, -0.5, 0.8, 15.0),
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A minute of a boat that knows all it can, as one file."""
    directory = tmp_path_factory.mktemp("logs")
    recorder = LogRecorder(
        directory,
        parameters=ParameterSet(),
        plans=Plans(fence=FENCE, rally=RALLY),
        file_bytes=1 << 24,
        keep_bytes=1 << 30,
        utc_s=1.7e9,
        software="rambler 1.2.3.dev0 (git 0123abcd-dirty)",
        background=False,
    )
    requests = {
        5: (Request(100.5, ReplacePlan(MISSION)),),
        STICK_TICK: (Request(100.0 + 0.1 * STICK_TICK, ManualRudder(0.5)),),
    }
    for index in range(TICKS):
        output = Output(RudderCommand(0.25, torque_on=True), boat(index))
        recorder.offer(inputs_of(index, requests.get(index, ())), output, lambda: "{}")
    recorder.close()
    return directory / "00000001.BIN"


@pytest.fixture(scope="module")
def read(log):
    """Every message, by name, and the state in which pymavlink's expressions are evaluated."""
    reader = mavutil.mavlink_connection(str(log))
    found, sizes = {}, {}
    while (message := reader.recv_match()) is not None:
        found.setdefault(message.get_type(), []).append(message)
    for file_format in reader.formats.values():
        sizes[file_format.name] = file_format.len
    yield found, dict(reader.messages), sizes
    reader.close()


def column(found, name, *fields):
    return [tuple(getattr(message, field) for field in fields) for message in found[name]]


def test_uavlogviewer_finds_attitude_track_mission_fence_and_arming(read):
    found, _, _ = read
    roll, pitch, yaw = column(found, "ATT", "Roll", "Pitch", "Yaw")[-1]
    assert (roll, pitch, yaw) == pytest.approx((math.degrees(0.1), math.degrees(-0.2), math.degrees(1.0)), abs=1e-3)
    latitude, longitude = column(found, "POS", "Lat", "Lng")[-1]
    assert (latitude, longitude) == pytest.approx((math.degrees(0.7), math.degrees(-0.2)), abs=1e-6)
    assert column(found, "CMD", "CTot", "CNum", "CId", "Prm1") == [(3, 1, 16, 0.0), (3, 2, 177, 1.0)]
    assert column(found, "CMD", "Lat", "Lng")[0] == pytest.approx((40.0, -10.0))
    assert column(found, "FNCE", "Tot", "Seq", "Type", "Count", "Radius") == [
        (4, 0, 98, 3, 0.0), (4, 1, 98, 3, 0.0), (4, 2, 98, 3, 0.0), (4, 3, 93, 0, 50.0),
    ]  # fmt: skip
    assert column(found, "RALY", "Tot", "Alt") == [(1, 1.0)]
    assert [state for (state,) in column(found, "EV", "Id")] == [11, 10, 41]
    assert column(found, "ARM", "ArmState") == [(0,), (1,)]
    assert found["STAT"][-1].Armed == 1


def test_faults_the_stick_the_version_and_the_batteries_are_told(read):
    found, _, _ = read
    assert column(found, "ERR", "Subsys", "ECode") == [(9, 1), (9, 0)]
    held = [(round(message.TimeUS * 1e-6, 1), message.C1) for message in found["RCIN"] if message.C1]
    assert held == [(140.0, 1750)]  # then it is silent, and released
    version = found["VER"][0]
    assert (version.Maj, version.Min, version.Pat, version.GH) == (1, 2, 3, 0x0123ABCD)
    assert {message.Inst: message.Volt for message in found["BAT"]} == pytest.approx({0: 12.9, 1: 12.0}, abs=1e-4)
    assert found["BAT"][-2].CurrTot == pytest.approx(0.5 * 50.0 / 3.6, rel=0.05)


def test_the_estimate_is_over_ground_and_from_home(read):
    found, _, _ = read
    north, east = column(found, "XKF1", "VN", "VE")[-1]
    assert (north, east) == pytest.approx((0.4 * math.cos(1.02) + 0.2, 0.4 * math.sin(1.02) - 0.1), abs=1e-4)
    assert pytest.approx(6371e3 * 1e-4 * math.cos(0.7), rel=0.01) == found["XKF1"][-1].PE


def test_the_log_grows_by_a_tenth_at_most(read, log):
    found, _, sizes = read
    names = {one.name for one in ardupilot_formats.TYPES}
    added = sum(len(messages) * sizes[name] for name, messages in found.items() if name in names)
    assert 0 < added <= 0.1 * (log.stat().st_size - added)


def test_mavexplorer_draws_sixty_of_its_graphs(read):
    package = importlib.util.find_spec("MAVProxy")
    if package is None:
        pytest.skip("MAVProxy is not installed; install the extra [clients]")
    _, messages, _ = read
    graphs = sorted(Path(package.origin).parent.glob("tools/graphs/*.xml"))
    expressions = [text for path in graphs for one in ET.parse(path).iter("expression") if (text := one.text)]

    def finite(field):
        try:
            value = mavutil.evaluate_expression(field.removesuffix(":1").removesuffix(":2"), messages)
        except (AttributeError, TypeError):  # as MAVExplorer, which leaves such a graph out
            return False
        return isinstance(value, int | float) and math.isfinite(value)

    assert len(expressions) > 500
    assert sum(all(map(finite, text.split())) for text in expressions) >= 60


TOOLS = {"mavflightmodes.py": "GUIDED", "mavsummarize.py": "Total distance", "mavtogpx.py": "points"}


@pytest.mark.parametrize(("tool", "says"), TOOLS.items())
def test_pymavlinks_tools_work(tool, says, log, tmp_path):
    script = shutil.which(tool, path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip(f"{tool} is not beside this Python")
    copy = tmp_path / "boat.BIN"
    shutil.copy(log, copy)
    done = subprocess.run([sys.executable, script, str(copy)], capture_output=True, text=True, check=True)
    assert says in done.stdout
    assert "bad" not in done.stdout


@pytest.mark.parametrize("software", ["rambler", "", "rambler 999.0.0 (git zzz)"])
def test_a_version_without_numbers_is_written_all_the_same(software):
    assert version_bytes(1.0, software)
