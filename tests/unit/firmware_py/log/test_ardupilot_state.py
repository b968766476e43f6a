"""ArduPilot's tools on a log of ours: what they look for is there, true, and thin."""

import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from pymavlink import mavutil

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import RudderCommand
from firmware_py.common.reports import Output
from firmware_py.log import ardupilot_formats
from firmware_py.log.ardupilot_state import ArduPilotState, version_bytes
from firmware_py.log.dataflash import Format
from support.full_log import TICKS, boat, inputs_of, write_log
from support.graphs import drawn


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_log(tmp_path_factory.mktemp("logs"))


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
    assert [state for (state,) in column(found, "EV", "Id")] == [11, 25, 10, 41]
    assert column(found, "ARM", "ArmState") == [(0,), (1,)]
    assert found["STAT"][-1].Armed == 1


def test_faults_stick_version_and_batteries_are_logged(read):
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


def messages_of(kind, ticks, **unknown):
    """The messages of a kind that these ticks tell, by the names of their columns; the first opens a file."""
    state, found = ArduPilotState(), []
    layout = Format(kind.number, kind.size, kind.name, kind.values, kind.labels)
    for number, inputs in ticks:
        output = Output(RudderCommand(0.0, torque_on=True), msgspec.structs.replace(boat(number), **unknown))
        data = state.tick_bytes(inputs, output, ParameterSet(), dropped=0, renew=number == ticks[0][0])
        while data:
            one = data[2]
            size = next(other.size for other in ardupilot_formats.TYPES if other.number == one)
            if one == kind.number:
                found.append(dict(zip(layout.labels, layout.unpack(data, 0), strict=True)))
            data = data[size:]
    return found


def test_a_file_that_starts_at_sea_has_armed_home_and_fence():
    ticks = [(number, inputs_of(number)) for number in range(TICKS - 20, TICKS)]
    assert boat(TICKS - 20).armed
    assert [event["Id"] for event in messages_of(ardupilot_formats.EVENT, ticks)] == [10, 25, 41]


@pytest.mark.parametrize("phase", range(5))
def test_the_fix_interval_is_logged_for_any_phase(phase):
    ticks = [
        (number, msgspec.structs.replace(inputs_of(number - phase), tick=inputs_of(number).tick))
        for number in range(100)
    ]
    intervals = [message["Delta"] for message in messages_of(ardupilot_formats.RECEIVER, ticks)]
    assert len(intervals) == 9
    assert set(intervals) <= {499, 500}


def test_attitude_is_upright_without_roll_and_pitch_and_absent_without_a_heading():
    ticks = [(number, inputs_of(number)) for number in range(100)]
    for kind in (ardupilot_formats.ATTITUDE, ardupilot_formats.ATTITUDE_B):
        messages = messages_of(kind, ticks, roll_rad=None, pitch_rad=None)
        assert messages
        assert {(message["Roll"], message["Pitch"]) for message in messages} == {(0.0, 0.0)}
        assert messages_of(kind, ticks, heading_rad=None) == []


def test_the_log_grows_by_a_tenth_at_most(read, log):
    found, _, sizes = read
    names = {one.name for one in ardupilot_formats.TYPES}
    added = sum(len(messages) * sizes[name] for name, messages in found.items() if name in names)
    assert 0 < added <= 0.1 * (log.stat().st_size - added)


def test_mavexplorer_draws_sixty_of_its_graphs(read):
    _, messages, _ = read
    graphs, of = drawn(messages)
    assert of > 500
    assert graphs >= 60


# mavsummarize reads telemetry logs alone: tests/unit/firmware_py/link/test_endpoint.py.
TOOLS = {"mavflightmodes.py": "GUIDED", "mavtogpx.py": r"with [1-9]\d* points"}


@pytest.mark.parametrize(("tool", "says"), TOOLS.items())
def test_pymavlinks_tools_work(tool, says, log, tmp_path):
    script = shutil.which(tool, path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip(f"{tool} is not beside this Python")
    copy = tmp_path / "boat.BIN"
    shutil.copy(log, copy)
    done = subprocess.run([sys.executable, script, str(copy)], capture_output=True, text=True, check=True)
    assert re.search(says, done.stdout)
    assert "bad" not in done.stdout


@pytest.mark.parametrize("software", ["rambler", "", "rambler 999.0.0 (git zzz)"])
def test_a_version_without_numbers_is_written(software):
    assert version_bytes(1.0, software)
