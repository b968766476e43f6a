"""Several links at once, and a sudden end: seen by a third party's script."""

import os
import signal
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
from firmware_py.system.realtime import BACKGROUND_PRIORITY

HOLD = 4


def test_several_links_show_the_same_boat(start_hil, connect):
    hil = start_hil("udpout", "tcpin", "udpin")  # besides the serial one, on which the HIL's operator sits
    kinds = ("udpin", "tcp", "udpout")  # of the other end
    stations = [connect(f"{kinds[index]}:127.0.0.1:{port}", 201 + index) for index, port in enumerate(hil.ports)]
    first, *others = stations
    # A change is reported to all stations; a request is answered to its sender.
    assert first.set_parameter("CTL_K1", 33.5, mavlink.MAV_PARAM_TYPE_REAL32) == 33.5
    for other in others:
        value = other.receive("PARAM_VALUE")
        assert (value.param_id, value.param_value) == ("CTL_K1", 33.5)
    assert first.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == mavlink.MAV_RESULT_ACCEPTED
    for station in stations:
        station.receive("HEARTBEAT", lambda beat: beat.custom_mode == HOLD)
    yaws = [yaws_of_two_seconds(station) for station in stations]
    common = yaws[0].keys() & yaws[1].keys() & yaws[2].keys()
    assert len(common) >= 5
    assert all(yaws[0][stamp] == yaws[1][stamp] == yaws[2][stamp] for stamp in common)
    assert all("COMMAND_ACK" not in other.link.messages for other in others)
    # One that goes leaves the others alone.
    stations[1].link.close()
    stayed = (stations[0], stations[2])
    assert [station.parameter("CTL_K1") for station in stayed] == [33.5, 33.5]
    assert max(station.link.packet_loss() for station in stayed) < 5.0
    hil.end()


def yaws_of_two_seconds(station):
    """By the stamps of the messages."""
    found = {}
    while not found or max(found) - min(found) < 2000:
        message = station.receive("ATTITUDE")
        found[message.time_boot_ms] = message.yaw
    return found


def test_parameters_survive_a_sudden_end(boot, free_ports, connect):
    """Confirmed parameters are stored: after a kill they are loaded, and the list is complete."""

    def begin(name):
        (port,) = free_ports(["tcpin"])
        return boot(name, f"tcpin:127.0.0.1:{port}"), connect(f"tcp:127.0.0.1:{port}")

    program, station = begin("first")
    assert station.set_parameter("CTL_K2", 0.7, mavlink.MAV_PARAM_TYPE_REAL32) == pytest.approx(0.7)
    assert station.set_parameter("LOOP_RATE_HZ", 20, mavlink.MAV_PARAM_TYPE_INT32) == 20
    program.send_signal(signal.SIGKILL)
    program.exit_code()
    program, station = begin("second")
    check_list(station, {"CTL_K2": 0.7, "LOOP_RATE_HZ": 20, "STAT_BOOTCNT": 2})
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def test_no_other_program_holds_up_a_thread_that_the_loop_may_wait_for(boot, free_ports, connect):
    """All threads that hold the interpreter lock have real-time priority; that of the loop is the highest."""
    (port,) = free_ports(["tcpin"])
    program = boot("boat", f"tcpin:127.0.0.1:{port}")
    connect(f"tcp:127.0.0.1:{port}")  # and wait for the heartbeat
    if "SCHED_FIFO not allowed" in program.text():
        pytest.skip("real-time priority is not allowed here")
    threads = [int(path.name) for path in Path(f"/proc/{program.pid}/task").iterdir()]
    # One is for stations to load as they like, with file transfers: Linux stops real-time work beyond 95 %.
    policies = [os.sched_getscheduler(thread) for thread in threads]
    assert sorted(policies) == [os.SCHED_OTHER, *[os.SCHED_FIFO] * (len(threads) - 1)]
    steady = [thread for thread, policy in zip(threads, policies, strict=True) if policy == os.SCHED_FIFO]
    loop, *others = sorted((os.sched_getparam(thread).sched_priority for thread in steady), reverse=True)
    assert len(others) >= 3
    assert set(others) == {BACKGROUND_PRIORITY}
    assert loop > BACKGROUND_PRIORITY
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def check_list(station, changed):
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
