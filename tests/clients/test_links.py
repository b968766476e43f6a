"""Several links at once, a killed process, and thread priorities, with pymavlink."""

import os
import signal
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from firmware_py.system.realtime import BACKGROUND_PRIORITY

HOLD = 4


def test_several_links_have_the_same_telemetry(start_hil, connect):
    hil = start_hil("udpout", "tcpin", "udpin")  # in addition to the serial one, which the HIL uses
    kinds = ("udpin", "tcp", "udpout")  # of the stations
    stations = [connect(f"{kinds[index]}:127.0.0.1:{port}", 201 + index) for index, port in enumerate(hil.ports)]
    first, *others = stations
    # All stations get a changed value; only the sender gets an acknowledgement.
    assert first.set_parameter("CTL_K1", 33.5, mavlink.MAV_PARAM_TYPE_REAL32) == 33.5
    for other in others:
        value = other.receive("PARAM_VALUE")
        assert (value.param_id, value.param_value) == ("CTL_K1", 33.5)
    assert first.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == mavlink.MAV_RESULT_ACCEPTED
    for station in stations:
        station.receive("HEARTBEAT", lambda heartbeat: heartbeat.custom_mode == HOLD)
    yaws = [yaws_of_two_seconds(station) for station in stations]
    common = yaws[0].keys() & yaws[1].keys() & yaws[2].keys()
    assert len(common) >= 5
    assert all(yaws[0][time_ms] == yaws[1][time_ms] == yaws[2][time_ms] for time_ms in common)
    assert all("COMMAND_ACK" not in other.link.messages for other in others)
    # A closed link does not affect the others.
    stations[1].link.close()
    remaining = (stations[0], stations[2])
    assert [station.parameter("CTL_K1") for station in remaining] == [33.5, 33.5]
    assert max(station.link.packet_loss() for station in remaining) < 5.0
    hil.end()


def yaws_of_two_seconds(station):
    """Return the received yaw angles of two seconds by their time stamps."""
    yaws = {}
    while not yaws or max(yaws) - min(yaws) < 2000:
        message = station.receive("ATTITUDE")
        yaws[message.time_boot_ms] = message.yaw
    return yaws


def test_parameters_are_kept_when_the_process_is_killed(boot, free_ports, connect):
    """Acknowledged parameters are stored: the next start loads them, and the list is complete."""

    def start_boat(name):
        (port,) = free_ports(["tcpin"])
        return boot(name, f"tcpin:127.0.0.1:{port}"), connect(f"tcp:127.0.0.1:{port}")

    program, station = start_boat("first")
    assert station.set_parameter("CTL_K2", 0.7, mavlink.MAV_PARAM_TYPE_REAL32) == pytest.approx(0.7)
    assert station.set_parameter("LOOP_RATE_HZ", 20, mavlink.MAV_PARAM_TYPE_INT32) == 20
    program.send_signal(signal.SIGKILL)
    program.exit_code()
    program, station = start_boat("second")
    check_list(station, {"CTL_K2": 0.7, "LOOP_RATE_HZ": 20, "STAT_BOOTCNT": 2})
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def test_threads_that_the_loop_may_wait_for_have_real_time_priority(boot, free_ports, connect):
    """All threads that hold the interpreter lock have real-time priority; that of the loop is the highest."""
    (port,) = free_ports(["tcpin"])
    program = boot("boat", f"tcpin:127.0.0.1:{port}")
    connect(f"tcp:127.0.0.1:{port}")  # waits for the heartbeat
    if "SCHED_FIFO not allowed" in program.text():
        pytest.skip("real-time priority is not allowed here")
    threads = [int(path.name) for path in Path(f"/proc/{program.pid}/task").iterdir()]
    # Except that of file transfers, whose load the stations choose: Linux stops real-time threads at a load of 95 %.
    policies = [os.sched_getscheduler(thread) for thread in threads]
    assert sorted(policies) == [os.SCHED_OTHER, *[os.SCHED_FIFO] * (len(threads) - 1)]
    real_time = [thread for thread, policy in zip(threads, policies, strict=True) if policy == os.SCHED_FIFO]
    loop, *others = sorted((os.sched_getparam(thread).sched_priority for thread in real_time), reverse=True)
    assert len(others) >= 3
    assert set(others) == {BACKGROUND_PRIORITY}
    assert loop > BACKGROUND_PRIORITY
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def check_list(station, changed):
    """Check the list of parameters, with changed values by name."""
    station.mav.param_request_list_send(1, 1)
    rows = {}
    while len(rows) < len(TABLE):
        row = station.receive("PARAM_VALUE")
        assert row.param_count == len(TABLE)
        rows[row.param_id] = row
    expected = {row.name: changed.get(row.name, row.default) for row in TABLE}
    assert {name: row.param_value for name, row in rows.items()} == pytest.approx(expected)
    kinds = {Kind.REAL: mavlink.MAV_PARAM_TYPE_REAL32, Kind.INTEGER: mavlink.MAV_PARAM_TYPE_INT32}
    assert {name: row.param_type for name, row in rows.items()} == {row.name: kinds[row.kind] for row in TABLE}
