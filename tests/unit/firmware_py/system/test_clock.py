"""Clocks of the computer and of the HIL, and the deadlines of the ticks."""

import json
import os
import random
import select
import socket
import struct
import threading
from pathlib import Path

import pytest

from firmware_py.install.service_files import Service, build_unit
from firmware_py.system import clock as clock_module
from firmware_py.system.clock import BOOT_ID, ClockError, LockstepClock, RealClock, TickTimer, boot_id, set_utc_s

LOCK_MARGIN_S = 0.002
MAX_PHASE_STEP = 0.005


def reply(now_s, *events, step_s=0.0, busy_wait_s=0.0):
    """Return the reply of the HIL: the new time, and time and line of earlier data."""
    return struct.pack("<ddd", now_s, step_s, busy_wait_s) + b"".join(struct.pack("<dQ", *event) for event in events)


def test_the_boot_id_is_read_if_it_exists(tmp_path):
    (tmp_path / "boot_id").write_bytes(b"0f3c-11\n")
    assert boot_id(tmp_path / "boot_id", {}) == "0f3c11"
    assert boot_id(tmp_path / "none", {}) == ""
    (tmp_path / "invalid").write_bytes(b"\xff\n")
    assert boot_id(tmp_path / "invalid", {}) == ""


def test_a_service_gets_the_boot_id_from_its_unit(tmp_path):
    """ProcSubset=pid hides the file from the service."""
    text = build_unit(Service(("/x",), Path("/y")))
    assert "\nProcSubset=pid\n" in text
    assert f"\nEnvironment={BOOT_ID}=%b\n" in text
    assert boot_id(tmp_path / "none", {BOOT_ID: "0f3c11"}) == "0f3c11"


def test_deadlines_are_absolute():
    timer = TickTimer(5.0, 10.0)
    for index in range(1, 1000):
        assert timer.advance(timer.deadline_s + 0.02) == 0
        assert timer.deadline_s == pytest.approx(5.0 + 0.1 * index, abs=1e-9)


def test_ticks_lock_to_shortly_after_the_arrivals():
    rng = random.Random(1)
    timer = TickTimer(0.0, 10.0)
    phase_s, period_s = 0.057, 0.1 * (1 + 50e-6)  # a compass that is 50 ppm slow
    offsets = []
    for _ in range(4000):
        deadline_s = timer.deadline_s
        newest_s = phase_s + period_s * int((deadline_s - phase_s) / period_s) + rng.gauss(0.0, 0.0003)
        if deadline_s > phase_s:
            timer.lock(newest_s)
        timer.advance(deadline_s + 0.001)
        assert timer.deadline_s - deadline_s == pytest.approx(0.1, abs=0.1 * MAX_PHASE_STEP + 1e-9)
        offsets.append(deadline_s - newest_s)
    locked = sorted(offsets[2000:])
    assert locked[len(locked) // 2] == pytest.approx(LOCK_MARGIN_S, abs=0.0005)
    assert locked[0] > 0.0


@pytest.mark.parametrize(
    ("arrival_s", "shift_s"),
    [(-0.004, -0.0002), (0.0, 0.0002), (-0.012, -0.0005), (0.02, 0.0005), (-0.104, -0.0002), (0.096, -0.0002)],
)
def test_phase_moves_by_a_tenth_of_the_error_and_at_most_half_a_percent_of_the_period(arrival_s, shift_s):
    """The aim is 2 ms after an arrival."""
    timer = TickTimer(0.0, 10.0)
    timer.lock(arrival_s)
    assert timer.advance(0.0) == 0
    assert timer.deadline_s == pytest.approx(0.1 + shift_s, abs=1e-9)


@pytest.mark.parametrize(
    ("end_s", "skipped", "deadline_s"),
    [(0.374, 0, 0.25), (0.375, 1, 0.5), (0.624, 1, 0.5), (0.87, 2, 0.75), (1000.0, 3999, 1000.0)],
)
def test_deadlines_are_skipped_half_a_period_after_them(end_s, skipped, deadline_s):
    timer = TickTimer(0.0, 4.0)
    assert (timer.advance(end_s), timer.deadline_s) == (skipped, deadline_s)


def test_without_arrivals_the_interval_is_the_period():
    timer = TickTimer(0.0, 10.0)
    timer.lock(0.05)
    timer.advance(0.0)
    first_s = timer.deadline_s
    timer.advance(first_s)
    assert timer.deadline_s == pytest.approx(first_s + 0.1, abs=1e-12)


def test_the_rate_can_change():
    timer = TickTimer(0.0, 10.0)
    timer.set_rate(50.0)
    assert timer.rate_hz == 50.0
    timer.advance(0.0)
    assert timer.deadline_s == pytest.approx(0.02)


def test_the_real_clock_wakes_for_a_descriptor_before_the_deadline():
    clock = RealClock()
    reader, writer = os.pipe()
    os.write(writer, b"x")
    assert list(clock.wait(clock.now_s() + 30.0, [reader])) == [reader]
    assert list(clock.wait(clock.now_s() - 1.0, [])) == []
    os.close(reader)
    os.close(writer)


def test_the_real_clock_counts_from_its_start_and_waits_for_the_remaining_time(monkeypatch):
    monotonic_s, waits_s = [100.0], []
    monkeypatch.setattr(clock_module.time, "monotonic", lambda: monotonic_s[0])
    monkeypatch.setattr(clock_module.select, "select", lambda *values: waits_s.append(values[3]) or ([],))
    monkeypatch.setattr(clock_module.time, "time", lambda: 1.8e9)
    clock = RealClock()
    monotonic_s[0] = 130.0
    assert (clock.now_s(), clock.utc_s()) == (30.0, 1.8e9)
    for deadline_s in (31.5, 30.0, 29.0):
        clock.wait(deadline_s, [])
    assert waits_s == [1.5, 0.0, 0.0]


def test_the_calendar_clock_is_set_if_that_is_permitted(monkeypatch):
    calls = []
    monkeypatch.setattr(clock_module.time, "clock_settime", lambda *values: calls.append(values))
    assert set_utc_s(1.8e9)
    assert calls == [(clock_module.time.CLOCK_REALTIME, 1.8e9)]
    monkeypatch.setattr(
        clock_module.time, "clock_settime", lambda *_values: os.kill(2**22 + 1, 0)
    )  # OSError: no process
    assert not set_utc_s(1.8e9)


@pytest.fixture
def lockstep(tmp_path):
    """Return a lockstep clock and the socket of the HIL."""
    server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server.bind(str(tmp_path / "socket"))
    server.listen(1)
    connections = []

    def accept():
        connection = server.accept()[0]
        assert json.loads(connection.recv(4096)) == {"protocol": 2, "lines": ["/a", "/b"]}
        connection.sendall(json.dumps({"start_s": 3.0, "utc_s": 1000.0}).encode())
        connection.settimeout(10.0)
        connections.append(connection)

    thread = threading.Thread(target=accept)
    thread.start()
    settle_calls, fed = [], []
    clock = LockstepClock(
        str(tmp_path / "socket"),
        ["/a", "/b"],
        lambda: [7, 9],
        lambda: bool(settle_calls and settle_calls.pop(0)()),
        lambda: fed,
    )
    clock._socket.settimeout(10.0)  # a test fails instead of waiting for ever
    clock.settle_calls, clock.fed = settle_calls, fed
    thread.join()
    yield clock, connections[0]
    connections[0].close()
    server.close()
    clock.close()


def is_readable(hil):
    return bool(select.select([hil], [], [], 0.0)[0])


def test_lockstep_time_advances_only_by_replies_of_the_hil(lockstep):
    clock, hil = lockstep
    assert (clock.now_s(), clock.utc_s()) == (3.0, 1000.0)
    hil.sendall(reply(3.05))  # the reply may arrive before the request
    clock.wait(3.1, [])
    assert struct.unpack("<dQQQ", hil.recv(64)) == (3.1, 0, 7, 9)
    assert clock.now_s() == 3.05
    assert clock.utc_s() == pytest.approx(1000.05)


def test_an_external_socket_ends_a_wait_without_an_advance_of_time(lockstep):
    clock, hil = lockstep
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(b"x")
        assert list(clock.wait(3.1, [ours.fileno()])) == [ours.fileno()]
        assert clock.now_s() == 3.0
        ours.recv(1)
        hil.sendall(reply(3.1))
        assert list(clock.wait(3.1, [ours.fileno()])) == []
        assert clock.now_s() == 3.1
        hil.recv(64)
        assert not is_readable(hil)  # one request for both waits


def test_lines_of_the_hil_are_not_readable_when_an_external_socket_ends_the_wait(lockstep):
    """Their bytes belong to a later time, and would get a wrong time stamp."""
    clock, hil = lockstep
    (ours, theirs), (fed, other) = socket.socketpair(), socket.socketpair()
    descriptors = [fed.fileno(), ours.fileno()]
    with ours, theirs, fed, other:
        clock.fed += [-1, fed.fileno()]
        theirs.sendall(b"x")
        other.sendall(b"x")
        assert list(clock.wait(3.1, descriptors)) == [ours.fileno()]
        clock.settle_calls.append(lambda: True)
        assert list(clock.wait(3.1, descriptors)) == [ours.fileno()]
        hil.sendall(reply(3.1, (3.05, 1)))
        ours.recv(1)
        assert list(clock.wait(3.1, descriptors)) == [fed.fileno()]
        assert clock.now_s() == 3.05
        assert list(clock.wait(3.05, descriptors)) == []  # the other bytes are of 3.1
        assert list(clock.wait(3.1, descriptors)) == [fed.fileno()]
        assert clock.now_s() == 3.1


def test_bytes_on_a_line_of_the_hil_do_not_stop_the_time(lockstep):
    clock, hil = lockstep
    fed, other = socket.socketpair()
    with fed, other:
        clock.fed.append(fed.fileno())
        hil.sendall(reply(3.05, (3.02, 0)))
        assert list(clock.wait(3.05, [fed.fileno()])) == [fed.fileno()]  # of line 0, also if the bytes arrive later
        assert clock.now_s() == 3.02
        assert list(clock.wait(3.05, [fed.fileno()])) == []
        other.sendall(b"x")
        hil.sendall(reply(3.1))
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert clock.now_s() == 3.1
        clock.fed.clear()  # the descriptor now belongs to a socket
        assert list(clock.wait(3.2, [fed.fileno()])) == [fed.fileno()]
        assert clock.now_s() == 3.1


def test_the_hil_gets_the_lines_to_wait_for_and_waits_return_at_their_data(lockstep):
    clock, hil = lockstep
    fed, other = socket.socketpair()
    with fed, other:
        clock.fed += [-1, fed.fileno()]
        hil.sendall(reply(3.1, (3.05, 1), (3.06, 0), step_s=5.0))
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert struct.unpack("<dQQQ", hil.recv(64)) == (3.1, 0b10, 7, 9)
        assert clock.now_s() == 3.05
        assert list(clock.wait(3.05, [fed.fileno()])) == []  # the deadline is the present time
        assert list(clock.wait(3.1, [fed.fileno()])) == []  # the other line is not in the set
        assert clock.now_s() == 3.06
        other.sendall(b"x")
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert (clock.now_s(), clock.utc_s()) == (3.1, pytest.approx(1005.1))
        assert not is_readable(hil)  # one request for all waits


def test_a_reply_that_has_arrived_needs_no_busy_waiting(lockstep, monkeypatch):
    clock, hil = lockstep
    hil.sendall(reply(3.05, busy_wait_s=30.0))
    clock.wait(3.1, [])
    hil.sendall(reply(3.1))
    monkeypatch.setattr(os, "sched_yield", lambda: pytest.fail("the reply is there"))
    clock.wait(3.1, [])
    assert clock.now_s() == 3.1


@pytest.mark.parametrize("busy_wait_s", [0.0, 0.002, 30.0])
def test_busy_waiting_gives_the_same_result(lockstep, busy_wait_s):
    clock, hil = lockstep
    hil.sendall(reply(3.05, busy_wait_s=busy_wait_s))
    clock.wait(3.1, [])
    thread = threading.Thread(target=lambda: (hil.recv(64), hil.recv(64), hil.sendall(reply(3.1))))
    thread.start()
    assert list(clock.wait(3.1, [])) == []
    assert clock.now_s() == 3.1
    thread.join()


def test_readable_descriptors_keep_the_requested_order(lockstep):
    clock, hil = lockstep
    pairs = [socket.socketpair() for _ in range(4)]
    descriptors = [pair[0].fileno() for pair in pairs]
    for requested in (descriptors, descriptors[::-1], descriptors[1:3]):
        for _, other in pairs:
            other.sendall(b"x")
        hil.sendall(reply(3.0))
        assert list(clock.wait(3.0, requested)) == requested
    for pair in pairs:
        for end in pair:
            end.close()


def test_in_lockstep_the_disk_takes_no_time(lockstep):
    """Its results arrive before the time advances, so that a run does not depend on the speed of the disk."""
    clock, hil = lockstep
    ours, theirs = socket.socketpair()
    with ours, theirs:
        clock.settle_calls.append(lambda: theirs.send(b"x"))
        assert list(clock.wait(3.1, [ours.fileno()])) == [ours.fileno()]
        assert not is_readable(hil)  # no request to advance
        ours.recv(1)
        clock.settle_calls.append(lambda: theirs.send(b"x"))
        hil.sendall(reply(3.1))
        assert list(clock.wait(3.1, [])) == []  # shortly before a tick, the loop does not wait for the disk
        assert clock.now_s() == 3.1


def test_a_closed_connection_is_an_error(lockstep):
    clock, hil = lockstep
    hil.close()
    with pytest.raises(ClockError, match="connection to the HIL lost: Broken pipe"):
        clock.wait(4.0, [])


def test_the_end_of_the_hil_is_an_error(lockstep):
    clock, hil = lockstep
    thread = threading.Thread(target=lambda: (hil.recv(64), hil.close()))
    thread.start()
    with pytest.raises(ClockError, match="the HIL has ended the run"):
        clock.wait(4.0, [])
    thread.join()


def test_the_end_of_the_autopilot_closes_the_connection(lockstep):
    clock, hil = lockstep
    clock.close()
    assert hil.recv(64) == b""


def test_a_missing_hil_is_an_error(tmp_path):
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(ClockError, match=r"none: No such file or directory; is the HIL running"):
        LockstepClock(str(tmp_path / "none"), [], list)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count
