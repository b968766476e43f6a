"""Logs in the tools of ArduPilot: the messages that they need, correct values, and a limited size."""

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
from firmware_py.log.ardupilot_state import ArduPilotState, encode_version
from firmware_py.log.dataflash import Format
from support.full_log import TICKS, inputs_of, snapshot_of, write_log
from support.graphs import count_graphs


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_log(tmp_path_factory.mktemp("logs"))


@pytest.fixture(scope="module")
def contents(log):
    """Return the messages by name, pymavlink's state after the last message, and the message sizes by name."""
    reader = mavutil.mavlink_connection(str(log))
    messages = {}
    while (message := reader.recv_match()) is not None:
        messages.setdefault(message.get_type(), []).append(message)
    sizes = {file_format.name: file_format.len for file_format in reader.formats.values()}
    yield messages, dict(reader.messages), sizes
    reader.close()


@pytest.fixture
def rows(contents):
    """Return a function that selects fields of all messages of a name."""
    return lambda name, *fields: [tuple(getattr(row, field) for field in fields) for row in contents[0][name]]


def test_track_attitude_plans_and_arming_are_logged(rows):
    attitude_deg = (math.degrees(0.1), math.degrees(-0.2), math.degrees(1.0))
    assert rows("ATT", "Roll", "Pitch", "Yaw")[-1] == pytest.approx(attitude_deg, abs=1e-3)
    assert rows("POS", "Lat", "Lng")[-1] == pytest.approx((math.degrees(0.7), math.degrees(-0.2)), abs=1e-6)
    assert rows("CMD", "CTot", "CNum", "CId", "Prm1") == [(3, 1, 16, 0.0), (3, 2, 177, 1.0)]
    assert rows("CMD", "Lat", "Lng")[0] == pytest.approx((40.0, -10.0))
    fence = [(4, 0, 98, 3, 0.0), (4, 1, 98, 3, 0.0), (4, 2, 98, 3, 0.0), (4, 3, 93, 0, 50.0)]
    assert rows("FNCE", "Tot", "Seq", "Type", "Count", "Radius") == fence
    assert rows("RALY", "Tot", "Alt") == [(1, 1.0)]
    assert rows("EV", "Id") == [(11,), (25,), (10,), (41,)]
    assert rows("ARM", "ArmState") == [(0,), (1,)]
    assert rows("STAT", "Armed")[-1] == (1,)


def test_faults_manual_rudder_version_and_batteries_are_logged(rows):
    assert rows("ERR", "Subsys", "ECode") == [(9, 1), (9, 0)]
    pulses = [(round(time_us * 1e-6, 1), pulse_us) for time_us, pulse_us in rows("RCIN", "TimeUS", "C1") if pulse_us]
    assert pulses == [(140.0, 1750)]  # then the request times out
    assert rows("VER", "Maj", "Min", "Pat", "GH")[0] == (1, 2, 3, 0x0123ABCD)
    assert dict(rows("BAT", "Inst", "Volt")) == pytest.approx({0: 12.9, 1: 12.0}, abs=1e-4)
    assert rows("BAT", "CurrTot")[-2][0] == pytest.approx(0.5 * 50.0 / 3.6, rel=0.05)


def test_the_estimate_is_over_ground_and_relative_to_home(rows):
    velocity_m_s = (0.4 * math.cos(1.02) + 0.2, 0.4 * math.sin(1.02) - 0.1)
    assert rows("XKF1", "VN", "VE")[-1] == pytest.approx(velocity_m_s, abs=1e-4)
    assert pytest.approx(6371e3 * 1e-4 * math.cos(0.7), rel=0.01) == rows("XKF1", "PE")[-1][0]


def messages_of(kind, ticks, **unknown):
    """Return the messages of a type for these ticks as dictionaries; the first tick opens a file."""
    state, messages = ArduPilotState(), []
    layout = Format(kind.number, kind.size, kind.name, kind.values, kind.labels)
    sizes = {other.number: other.size for other in ardupilot_formats.TYPES}
    for number, inputs in ticks:
        output = Output(RudderCommand(0.0, torque_on=True), msgspec.structs.replace(snapshot_of(number), **unknown))
        data = state.encode_tick(inputs, output, ParameterSet(), dropped=0, log_all=number == ticks[0][0])
        while data:
            if data[2] == kind.number:
                messages.append(dict(zip(layout.labels, layout.unpack(data, 0), strict=True)))
            data = data[sizes[data[2]] :]
    return messages


def test_a_file_that_starts_at_sea_has_armed_home_and_fence():
    ticks = [(number, inputs_of(number)) for number in range(TICKS - 20, TICKS)]
    assert snapshot_of(TICKS - 20).armed
    assert [event["Id"] for event in messages_of(ardupilot_formats.EVENT, ticks)] == [10, 25, 41]


@pytest.mark.parametrize("phase", range(5))
def test_the_fix_interval_is_logged_for_any_phase(phase):
    ticks = [(n, msgspec.structs.replace(inputs_of(n - phase), tick=inputs_of(n).tick)) for n in range(100)]
    intervals = [message["Delta"] for message in messages_of(ardupilot_formats.RECEIVER, ticks)]
    assert len(intervals) == 9
    assert set(intervals) <= {499, 500}


@pytest.mark.parametrize("kind", [ardupilot_formats.ATTITUDE, ardupilot_formats.COMPASS_ATTITUDE])
def test_attitude_is_upright_without_roll_and_pitch_and_absent_without_a_heading(kind):
    ticks = [(number, inputs_of(number)) for number in range(100)]
    messages = messages_of(kind, ticks, roll_rad=None, pitch_rad=None)
    assert {(message["Roll"], message["Pitch"]) for message in messages} == {(0.0, 0.0)}
    assert messages_of(kind, ticks, heading_rad=None) == []


def test_the_messages_are_at_most_a_tenth_of_the_log(contents, log):
    messages, _, sizes = contents
    names = {kind.name for kind in ardupilot_formats.TYPES}
    added_bytes = sum(len(rows) * sizes[name] for name, rows in messages.items() if name in names)
    assert 0 < added_bytes <= 0.1 * (log.stat().st_size - added_bytes)


def test_mavexplorer_draws_sixty_of_its_graphs(contents):
    graphs, total = count_graphs(contents[1])
    assert total > 500
    assert graphs >= 60


# mavsummarize reads only telemetry logs: tests/unit/firmware_py/link/test_endpoint.py.
@pytest.mark.parametrize(
    ("tool", "pattern"), [("mavflightmodes.py", "GUIDED"), ("mavtogpx.py", r"with [1-9]\d* points")]
)
def test_pymavlinks_tools_read_the_log(tool, pattern, log, tmp_path):
    script = shutil.which(tool, path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip(f"{tool} is not installed with this Python")
    copy = tmp_path / "boat.BIN"
    shutil.copy(log, copy)
    result = subprocess.run([sys.executable, script, str(copy)], capture_output=True, text=True, check=True)
    assert re.search(pattern, result.stdout)
    assert "bad" not in result.stdout


@pytest.mark.parametrize("software", ["rambler", "", "rambler 999.0.0 (git zzz)"])
def test_a_version_without_numbers_is_written(software):
    assert encode_version(1.0, software)


@pytest.mark.parametrize(("t_s", "pulse_us"), [(12.0, 1750), (13.0, 1750), (13.1, 0)])
def test_manual_rudder_is_logged_until_its_timeout(t_s, pulse_us):
    state = ArduPilotState()
    state._manual_rudder = (10.0, 0.5)
    data = state._encode_inputs(msgspec.structs.replace(snapshot_of(0), t_s=t_s), 3.0)
    assert int.from_bytes(data[11:13], "little") == pulse_us  # after the head and the time
