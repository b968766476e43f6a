import json
import os
import random
import socket
import struct
import threading
from pathlib import Path

import pytest

from firmware_py.install.service_files import Service, unit_text
from firmware_py.system.clock import (
    BOOT_ID,
    LOCK_MARGIN_S,
    LOCK_SLEW,
    ClockError,
    LockstepClock,
    RealClock,
    TickTimer,
    boot_id,
)


def answer(now_s, *events, step_s=0.0, look_s=0.0):
    """What the HIL answers: the new time, and who has said something when before it."""
    return struct.pack("<ddd", now_s, step_s, look_s) + b"".join(struct.pack("<dQ", *one) for one in events)


def test_the_boot_id_is_read_if_there_is_one(tmp_path):
    (tmp_path / "boot_id").write_bytes(b"0f3c-11\n")
    assert boot_id(tmp_path / "boot_id", {}) == "0f3c11"
    assert boot_id(tmp_path / "none", {}) == ""
    (tmp_path / "strange").write_bytes(b"\xff\n")
    assert boot_id(tmp_path / "strange", {}) == ""


def test_a_service_gets_the_boot_id_from_its_unit(tmp_path):
    """ProcSubset=pid hides the file from it."""
    text = unit_text(Service(("/x",), Path("/y")))
    assert "\nProcSubset=pid\n" in text
    assert f"\nEnvironment={BOOT_ID}=%b\n" in text
    assert boot_id(tmp_path / "none", {BOOT_ID: "0f3c11"}) == "0f3c11"


def test_deadlines_are_absolute():
    tick_timer = TickTimer(5.0, 10.0)
    for index in range(1, 1000):
        assert tick_timer.advance(tick_timer.deadline_s + 0.02) == 0
        assert tick_timer.deadline_s == pytest.approx(5.0 + 0.1 * index, abs=1e-9)


def test_missed_deadlines_are_skipped_in_phase_and_counted():
    tick_timer = TickTimer(0.0, 10.0)
    assert tick_timer.advance(0.349) == 2  # 0.1 and 0.2 are gone, 0.3 is 49 ms late and still served
    assert tick_timer.deadline_s == pytest.approx(0.3)
    assert tick_timer.advance(3.0) == 26
    assert tick_timer.deadline_s == pytest.approx(3.0)


def test_a_long_stall_never_makes_a_burst():
    tick_timer = TickTimer(0.0, 50.0)
    skipped = tick_timer.advance(1000.0)
    assert skipped + 1 == 50_000
    assert tick_timer.deadline_s >= 999.98


def test_ticks_lock_to_just_after_the_arrivals():
    rng = random.Random(1)
    tick_timer = TickTimer(0.0, 10.0)
    phase_s, period_s = 0.057, 0.1 * (1 + 50e-6)  # a compass of its own phase, 50 ppm slow
    offsets = []
    for _ in range(4000):
        deadline_s = tick_timer.deadline_s
        newest_s = phase_s + period_s * int((deadline_s - phase_s) / period_s) + rng.gauss(0.0, 0.0003)
        if deadline_s > phase_s:
            tick_timer.lock(newest_s)
        tick_timer.advance(deadline_s + 0.001)
        assert tick_timer.deadline_s - deadline_s == pytest.approx(0.1, abs=0.1 * LOCK_SLEW + 1e-9)
        offsets.append(deadline_s - newest_s)
    settled = sorted(offsets[2000:])
    assert settled[len(settled) // 2] == pytest.approx(LOCK_MARGIN_S, abs=0.0005)
    assert settled[0] > 0.0


def test_without_arrivals_the_ticks_run_free():
    tick_timer = TickTimer(0.0, 10.0)
    tick_timer.lock(0.05)
    tick_timer.advance(0.0)
    first_s = tick_timer.deadline_s
    tick_timer.advance(first_s)
    assert tick_timer.deadline_s == pytest.approx(first_s + 0.1, abs=1e-12)


def test_the_rate_can_change():
    tick_timer = TickTimer(0.0, 10.0)
    tick_timer.set_rate(50.0)
    tick_timer.advance(0.0)
    assert tick_timer.deadline_s == pytest.approx(0.02)


def test_the_real_clock_wakes_for_a_descriptor_before_the_deadline():
    clock = RealClock()
    reader, writer = os.pipe()
    try:
        os.write(writer, b"x")
        assert list(clock.wait(clock.now_s() + 30.0, [reader])) == [reader]
        assert list(clock.wait(clock.now_s() - 1.0, [])) == []
    finally:
        os.close(reader)
        os.close(writer)


@pytest.fixture
def lockstep(tmp_path):
    """A lockstep clock and the HIL's end of its socket."""
    server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server.bind(str(tmp_path / "socket"))
    server.listen(1)
    ends = []

    def greet():
        end = server.accept()[0]
        hello = json.loads(end.recv(4096))
        assert hello == {"protocol": 2, "lines": ["/a", "/b"]}
        end.sendall(json.dumps({"start_s": 3.0, "utc_s": 1000.0}).encode())
        ends.append(end)

    thread = threading.Thread(target=greet)
    thread.start()
    settled, fed = [], []
    clock = LockstepClock(
        str(tmp_path / "socket"), ["/a", "/b"], lambda: [7, 9], lambda: bool(settled and settled.pop(0)()), lambda: fed
    )
    clock.settled, clock.fed = settled, fed
    thread.join()
    yield clock, ends[0]
    ends[0].close()
    server.close()
    clock.close()


def test_lockstep_time_stands_still_until_the_hil_moves_it(lockstep):
    clock, hil = lockstep
    assert (clock.now_s(), clock.utc_s()) == (3.0, 1000.0)
    hil.sendall(answer(3.05))  # the answer may already be there
    clock.wait(3.1, [])
    assert struct.unpack("<dQQQ", hil.recv(64)) == (3.1, 0, 7, 9)
    assert clock.now_s() == 3.05
    assert clock.utc_s() == pytest.approx(1000.05)


def test_lockstep_serves_an_outside_socket_without_time_going_by(lockstep):
    clock, hil = lockstep
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(b"x")
        assert list(clock.wait(3.1, [ours.fileno()])) == [ours.fileno()]
        assert clock.now_s() == 3.0
        ours.recv(1)
        hil.sendall(answer(3.1))
        assert list(clock.wait(3.1, [ours.fileno()])) == []
        assert clock.now_s() == 3.1
        hil.recv(64)
        hil.setblocking(False)
        with pytest.raises(BlockingIOError):
            hil.recv(64)  # one packet each way, although there were two waits


def test_bytes_of_a_later_time_are_not_read_when_an_outside_socket_ends_the_wait(lockstep):
    """They would be stamped too early, and the HIL would wait for their arrival in vain."""
    clock, hil = lockstep
    (ours, theirs), (fed, other) = socket.socketpair(), socket.socketpair()
    descriptors = [fed.fileno(), ours.fileno()]
    with ours, theirs, fed, other:
        clock.fed += [-1, fed.fileno()]
        theirs.sendall(b"x")
        other.sendall(b"x")
        assert list(clock.wait(3.1, descriptors)) == [ours.fileno()]
        clock.settled.append(lambda: True)
        assert list(clock.wait(3.1, descriptors)) == [ours.fileno()]
        hil.sendall(answer(3.1, (3.05, 1)))
        ours.recv(1)
        assert list(clock.wait(3.1, descriptors)) == [fed.fileno()]
        assert clock.now_s() == 3.05
        assert list(clock.wait(3.05, descriptors)) == []  # the rest is of 3.1
        assert list(clock.wait(3.1, descriptors)) == [fed.fileno()]
        assert clock.now_s() == 3.1


def test_bytes_on_a_line_of_the_hil_do_not_keep_time_from_going_on(lockstep):
    clock, hil = lockstep
    fed, other = socket.socketpair()
    with fed, other:
        clock.fed.append(fed.fileno())
        other.sendall(b"x")
        hil.sendall(answer(3.1))
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert clock.now_s() == 3.1
        clock.fed.clear()  # that number is a socket's now
        assert list(clock.wait(3.2, [fed.fileno()])) == [fed.fileno()]
        assert clock.now_s() == 3.1


def test_the_hil_gets_the_lines_to_wait_for_and_waits_return_at_their_data(lockstep):
    clock, hil = lockstep
    fed, other = socket.socketpair()
    with fed, other:
        clock.fed += [-1, fed.fileno()]
        hil.sendall(answer(3.1, (3.05, 1), (3.06, 0), step_s=5.0))
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert struct.unpack("<dQQQ", hil.recv(64)) == (3.1, 0b10, 7, 9)
        assert clock.now_s() == 3.05
        assert list(clock.wait(3.05, [fed.fileno()])) == []  # who is busy does not go on
        assert list(clock.wait(3.1, [fed.fileno()])) == []  # the other line is not in the set
        assert clock.now_s() == 3.06
        other.sendall(b"x")
        assert list(clock.wait(3.1, [fed.fileno()])) == [fed.fileno()]
        assert (clock.now_s(), clock.utc_s()) == (3.1, pytest.approx(1005.1))
        hil.setblocking(False)
        with pytest.raises(BlockingIOError):
            hil.recv(64)  # one packet each way, although there were three waits


@pytest.mark.parametrize("look_s", [0.0, 0.002, 30.0])
def test_busy_waiting_gives_the_same_result(lockstep, look_s):
    clock, hil = lockstep
    hil.sendall(answer(3.05, look_s=look_s))
    clock.wait(3.1, [])
    other = threading.Thread(target=lambda: (hil.recv(64), hil.recv(64), hil.sendall(answer(3.1))))
    other.start()
    assert list(clock.wait(3.1, [])) == []
    assert clock.now_s() == 3.1
    other.join()


def test_readable_descriptors_keep_the_requested_order(lockstep):
    clock, hil = lockstep
    pairs = [socket.socketpair() for _ in range(4)]
    descriptors = [pair[0].fileno() for pair in pairs]
    for wanted in (descriptors, descriptors[::-1], descriptors[1:3]):
        for _, other in pairs:
            other.sendall(b"x")
        hil.sendall(answer(3.0))
        assert list(clock.wait(3.0, wanted)) == wanted
    for pair in pairs:
        for end in pair:
            end.close()


def test_in_lockstep_the_disk_takes_no_time(lockstep):
    """Its answers come before time goes on, so that a run is the same however fast the disk is."""
    clock, hil = lockstep
    ours, theirs = socket.socketpair()
    with ours, theirs:
        clock.settled.append(lambda: theirs.send(b"x"))
        assert list(clock.wait(3.1, [ours.fileno()])) == [ours.fileno()]
        hil.setblocking(False)
        with pytest.raises(BlockingIOError):
            hil.recv(64)  # time has not been asked to go on
        ours.recv(1)
        clock.settled.append(lambda: theirs.send(b"x"))
        hil.sendall(answer(3.1))
        assert list(clock.wait(3.1, [])) == []  # shortly before a tick the disk is not in the set
        assert clock.now_s() == 3.1


def test_a_hil_that_ends_is_an_error_in_one_line(lockstep):
    clock, hil = lockstep
    hil.close()
    with pytest.raises(ClockError, match="HIL"):
        clock.wait(4.0, [])


def test_no_hil_at_all_is_an_error_in_one_line(tmp_path):
    with pytest.raises(ClockError, match="is the HIL running"):
        LockstepClock(str(tmp_path / "none"), [], list)
