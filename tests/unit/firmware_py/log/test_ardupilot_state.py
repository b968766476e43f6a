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

from firmware_py.common.intents import ManualRudder, Request
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample, RudderCommand
from firmware_py.common.reports import Home, Navigation, Output, Power, Water
from firmware_py.faults.fault import Fault
from firmware_py.log import ardupilot_formats
from firmware_py.log.ardupilot_formats import VERSION
from firmware_py.log.ardupilot_state import ArduPilotState, encode_version
from firmware_py.log.dataflash import Format
from support.full_log import ESTIMATE, inputs_of, snapshot_of, write_log
from support.graphs import count_graphs

# Events of ArduPilot (LogEvent).
ARMED, DISARMED, HOME_SET, FENCE_ENABLED = 10, 11, 25, 41


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


def test_plans_faults_and_changes_of_state_are_logged(rows):
    items = rows("CMD", "CTot", "CNum", "CId", "Prm1", "Lat", "Lng", "Frame")
    assert items == [(3, 1, 16, 0.0, 40.0, -10.0, 3), (3, 2, 177, 1.0, 0.0, 0.0, 2)]
    fence = [(4, 0, 98, 3, 0.0), (4, 1, 98, 3, 0.0), (4, 2, 98, 3, 0.0), (4, 3, 93, 0, 50.0)]
    assert rows("FNCE", "Tot", "Seq", "Type", "Count", "Radius") == fence
    assert rows("RALY", "Tot", "Seq", "Lat", "Lng", "Alt") == [(1, 0, 1.1e-6, 1.2e-6, 1.0)]
    assert rows("EV", "Id") == [(DISARMED,), (HOME_SET,), (ARMED,), (FENCE_ENABLED,)]
    assert rows("ARM", "ArmState") == [(0,), (1,)]
    assert rows("ERR", "Subsys", "ECode") == [(9, 1), (9, 0)]  # fence failsafe
    version = (0, 1, 2, 3, 0, 0x0123ABCD, "rambler 1.2.3.dev0 (git 0123abcd-dirty)", 1)
    assert rows("VER", "BT", "Maj", "Min", "Pat", "FWT", "GH", "FWS", "BU") == [version]


def all_messages(state, tick, requests=(), *, log_all=False, dropped=0, positions=(), **changes):
    """Return all messages of a tick as (name, values without the time)."""
    kinds = {kind.number: kind for kind in ardupilot_formats.TYPES}
    inputs = msgspec.structs.replace(inputs_of(tick), requests=requests, positions=positions)
    output = Output(RudderCommand(0.0, torque_on=True), msgspec.structs.replace(snapshot_of(tick), **changes))
    data = state.encode_tick(inputs, output, ParameterSet(), dropped=dropped, log_all=log_all)
    messages = []
    while data:
        kind = kinds[data[2]]
        values = Format(kind.number, kind.size, kind.name, kind.values, kind.labels).unpack(data, 0)
        assert values[0] == pytest.approx((100.0 + 0.1 * tick) * 1e6, abs=1)
        messages.append((kind.name, values[1:]))
        data = data[kind.size :]
    return messages


def assert_messages(messages, expected):
    assert [name for name, _ in messages] == [name for name, _ in expected]
    for (name, values), (_, expected_values) in zip(messages, expected, strict=True):
        assert values == pytest.approx(expected_values, rel=1e-4, abs=1e-6, nan_ok=True), name


NAN, NO_CHANNELS = math.nan, (0,) * 11


def test_values_of_a_tick_have_the_units_of_ardupilot():
    """Angles in degrees: 0.1 rad are 5.72958 deg. The limit of the rudder is 30 deg."""
    place = (401070457, -114591559)
    messages = all_messages(
        ArduPilotState(), 200, log_all=True, dropped=3, skipped_total=7, late_s=0.02, faults=0b1,
        home=Home(0.6999, -0.2001, 1.0), estimate=msgspec.structs.replace(ESTIMATE, innovation_square=0.64),
        water=Water(0.4, 0.1, 0.2, -0.1, 0.1, leeway_rad=0.05),
    )  # fmt: skip
    east_m = 637.10088 * math.cos(0.69995)
    assert_messages(messages, [
        ("ARM", (1, 1, 0, 1)), ("EV", (ARMED,)), ("STAT", (1, 1.0, 1, 0)),
        ("EV", (HOME_SET,)), ("EV", (FENCE_ENABLED,)),
        ("ERR", (3, 1)),  # compass
        ("ATT", (0.0, 5.72958, 0.0, -11.45916, 114.59156, 57.29578, 0)),
        ("POS", (*place, 3.0, 2.0, 2.0)),
        ("XKF1", (0, 5.72958, -11.45916, 58.44170, 0.4 * math.cos(1.07) + 0.2, 0.4 * math.sin(1.07) - 0.1, 0.0, 0.0,
                  637.1009, east_m, 0.0, 1.0)),
        ("RCOU", (1739, *NO_CHANNELS)),
        ("STER", (14.32394, 11.45916, 0.004, 0.572958)),
        ("CTUN", (0.0, 5.72958, 0.0, -11.45916, 0.0, 14.32394, 0.4, 1.0)),
        ("RATE", (0.572958, 0.0, 0.0, 0.477465, 0.0)),
        ("NTUN", (40.0, 68.75494, 114.59156, 57.29578, 1.5)),
        ("RCIN", (0, *NO_CHANNELS)),
        ("STAT", (1, 1.0, 1, 0)), ("THR", (0.0, 0.0, 0.5, 0.4)), ("ARSP", (0, 0.4)),
        ("XKF4", (0, 0.0, 0.0, 0.0, 0.8, 0.0, 1 | 2 | 16, 0, 0)),  # attitude, horizontal velocity and position
        ("AHR2", (5.72958, -11.45916, 57.29578, 3.0, *place)),
        ("BAT", (0, 12.9, 12.9, 0.5, 0.0138889, 15.0, 80.0)),
        ("BAT", (1, 12.0, 12.0, 0.2, 0.00555556, 31.0, NAN)),
        ("PM", (7, 100, 120_000, 3)),
    ])  # fmt: skip


UNKNOWN = (
    *("yaw_rate_rad_s", "roll_rad", "pitch_rad", "goal_heading_rad", "bearing_rad", "distance_m", "rudder_rad"),
    *("servo", "home", "estimate", "water"),
)


def test_unknown_and_impossible_values_are_nan_or_zero():
    messages = all_messages(
        ArduPilotState(), 50, log_all=True, **dict.fromkeys(UNKNOWN), rudder_command_rad=NAN, rate_hz=0.0, late_s=1e9,
        skipped_total=-1, position=PositionSample(1.0, FixType.FIX_2D, 0.0, math.tau), power=Power(1e39, 0.5),
        navigation=Navigation(),
    )  # fmt: skip
    assert_messages(messages, [
        ("ARM", (0, 1, 0, 1)), ("EV", (DISARMED,)), ("STAT", (0, 0.0, 0, 0)),
        ("ATT", (0.0, 0.0, 0.0, 0.0, NAN, 57.29578, 0)),
        ("POS", (0, 0, 0.0, 0.0, 0.0)),
        ("XKF1", (0, 0.0, 0.0, 57.29578, NAN, NAN, 0.0, 0.0, NAN, NAN, 0.0, NAN)),
        ("RCOU", (1500, *NO_CHANNELS)),
        ("STER", (NAN, NAN, NAN, NAN)),
        ("CTUN", (0.0, 0.0, 0.0, 0.0, 0.0, NAN, NAN, 1.0)),
        ("RATE", (NAN, 0.0, 0.0, 0.0, 0.0)),
        ("NTUN", (NAN, NAN, NAN, 57.29578, NAN)),
        ("RCIN", (0, *NO_CHANNELS)),
        ("STAT", (0, 0.0, 0, 0)), ("THR", (0.0, 0.0, 0.5, NAN)), ("ARSP", (0, NAN)),
        ("AHR2", (0.0, 0.0, 57.29578, 0.0, 0, 0)),
        ("BAT", (0, NAN, NAN, -0.5, 0.0, NAN, NAN)),
        ("PM", (0, 100, 4_000_000_000, 0)),
    ])  # fmt: skip


def test_a_tick_lasts_at_most_ten_seconds():
    messages = dict(all_messages(ArduPilotState(), 0, log_all=True, rate_hz=0.05, late_s=0.0, servo=None))
    assert (messages["PM"][2], messages["BAT"][4]) == (10_000_000, pytest.approx(1.388889, rel=1e-4))


def test_faults_have_the_numbers_of_subsystems_of_ardupilot():
    """Compass 3, battery failsafe 6, ground station failsafe 8, fence failsafe 9, GPS 11, others 1 (main)."""
    numbers = {
        **dict.fromkeys(("COMPASS_LOST", "COMPASS_SILENT", "COMPASS_FROZEN", "COMPASS_JUMPING"), 3),
        **dict.fromkeys(("BATTERY_LOW", "BATTERY_CRITICAL"), 6),
        "STATION_SILENT": 8,
        "FENCE_BREACHED": 9,
        "POSITION_LOST": 11,
        "POSITION_JUMPING": 11,
    }
    state = ArduPilotState()
    all_messages(state, 1, faults=0)
    messages = all_messages(state, 2, faults=sum(1 << fault for fault in Fault))
    assert messages == [("ERR", (numbers.get(fault.name, 1), 1)) for fault in Fault]
    remaining = sum(1 << fault for fault in Fault if fault is not Fault.FENCE_BREACHED)
    assert all_messages(state, 3, faults=remaining) == [("ERR", (9, 0))]


def test_messages_follow_at_their_intervals():
    """Motion every 10 ticks, slow values every 100, with the largest delay and the sums since the last."""
    state, found, performance, used_mah = ArduPilotState(), {}, [], []
    for tick in range(101, 301):
        changes = {"late_s": 0.4 if tick == 150 else 0.01 * (tick // 100), "skipped_total": {200: 70_007, 300: 70_009}}
        changes["skipped_total"] = changes["skipped_total"].get(tick, 0)
        for name, values in all_messages(state, tick, log_all=tick == 101, dropped=tick, **changes):
            found.setdefault(name, []).append(tick)
            if name == "PM":
                performance.append(values)
            elif name == "BAT":
                used_mah.append(values[4])
    assert {tuple(found[name]) for name in ("ATT", "POS", "XKF1", "NTUN")} == {(101, *range(110, 301, 10))}
    assert {tuple(found[name]) for name in ("THR", "XKF4", "AHR2", "PM", "RCIN")} == {(101, 200, 300)}
    assert performance == [(0, 100, 110_000, 101), (0xFFFF, 100, 500_000, 200), (2, 100, 130_000, 300)]
    # 0.5 A and 0.2 A over 0.1, 10 and 20 s
    assert used_mah == pytest.approx([0.0138889, 0.00555556, 1.388889, 0.555556, 2.777778, 1.111111], rel=1e-4)


@pytest.mark.parametrize(("current_a", "used_mah"), [(-0.5, 0.0138889), (0.5, 0.0), (NAN, 0.0), (None, 0.0)])
def test_only_a_discharge_counts_as_used_charge(current_a, used_mah):
    messages = all_messages(ArduPilotState(), 0, log_all=True, power=Power(12.0, current_a))
    assert next(values[4] for name, values in messages if name == "BAT") == pytest.approx(used_mah, rel=1e-4)


@pytest.mark.parametrize(
    ("deflection", "pulse_us"), [(0.5, 1750), (-0.5, 1250), (1.1, 2000), (-1.1, 1000), (0.0, 1500)]
)
def test_manual_rudder_is_logged_at_once_and_until_its_timeout(deflection, pulse_us):
    def pulses(tick, *deflections, log_all=False):
        requests = tuple(Request(100.0 + 0.1 * tick, ManualRudder(value)) for value in deflections)
        messages = all_messages(state, tick, requests, log_all=log_all)
        return [values[0] for name, values in messages if name == "RCIN"]

    state = ArduPilotState()
    assert pulses(1, deflection) == [pulse_us]
    assert pulses(2, deflection) == []
    assert pulses(32, log_all=True) == [pulse_us]  # 3.0 s after the request
    assert pulses(33, log_all=True) == [0]
    assert pulses(34, None) == [0]
    assert pulses(35, None) == []


def test_without_a_heading_there_is_no_attitude_and_without_a_fresh_fix_no_position():
    messages = dict(all_messages(ArduPilotState(), 0, log_all=True, heading_rad=None))
    assert {"ATT", "AHR2"} & messages.keys() == set()
    assert messages["XKF1"][3] == pytest.approx(58.4417, rel=1e-4)  # of the estimate
    messages = dict(all_messages(ArduPilotState(), 0, log_all=True, position_ok=False))
    assert {"POS", "AHR2"} & messages.keys() == set()
    assert messages["XKF4"][6:] == (1, 1, 0)
    assert messages["XKF1"][8:10] == pytest.approx((NAN, NAN), nan_ok=True)
    for fix in (PositionSample(1.0, FixType.FIX_2D, None, 0.1), PositionSample(1.0, FixType.FIX_2D, 0.1, None)):
        assert "POS" not in dict(all_messages(ArduPilotState(), 0, log_all=True, position=fix))


@pytest.mark.parametrize(
    ("fixes_s", "interval_ms"),
    [((), None), ((1.0,), None), ((1.0, 1.25), 250), ((1.0, 2.0, 2.125), 125), ((2.0, 1.0), 0), ((0.0, 2e6), 10**9)],
)
def test_the_interval_of_the_latest_fixes_is_logged_once(fixes_s, interval_ms):
    state = ArduPilotState()
    positions = tuple(PositionSample(t_s, FixType.FIX_3D, 0.1, 0.2) for t_s in fixes_s)
    assert "GPA" not in dict(all_messages(state, 19, positions=positions, log_all=True))
    assert dict(all_messages(state, 20)).get("GPA") == (None if interval_ms is None else (0, interval_ms))
    assert "GPA" not in dict(all_messages(state, 30))


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


@pytest.mark.parametrize(
    ("software", "numbers"),
    [
        ("rambler", (0, 0, 0, 0)),
        ("", (0, 0, 0, 0)),
        ("rambler 256.255.1 (git zzz)", (255, 255, 1, 0)),
        ("rambler 1.2.3 (git 0123abcd9)" + "x" * 99, (1, 2, 3, 0x0123ABCD)),
    ],
)
def test_numbers_of_a_version_are_limited_or_0(software, numbers):
    layout = Format(VERSION.number, VERSION.size, VERSION.name, VERSION.values, VERSION.labels)
    values = dict(zip(layout.labels, layout.unpack(encode_version(1.0, software), 0), strict=True))
    assert tuple(values[name] for name in ("Maj", "Min", "Pat", "GH")) == numbers
    assert values["FWS"] == software.encode()[:64].ljust(64, b"\0")
