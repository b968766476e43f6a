"""The bare limits: that they do what they are compared for."""

import os
import select
import socket

import pytest

from hil.bench import bare_sleep
from hil.bench.helper import answer_of, background
from hil.bench.steady import steady
from hil.devices.pty_line import PtyLine
from hil.errors import HilError


def test_the_sleeper_counts_every_tick_and_is_never_early():
    late_s = bare_sleep.lateness_s(500.0, 5)
    assert len(late_s) == 5
    assert min(late_s) >= 0.0


def test_the_sleeper_tells_its_lateness_as_json():
    assert len(answer_of(["-m", "hil.bench.bare_sleep", "500", "3"], 1.0)) == 3
    assert len(answer_of(["-m", "hil.bench.bare_sleep", "500", "3", "0.5"], 1.0)) == 3


def test_datagrams_come_back():
    with background("-m", "hil.bench.bare_echo", "udp") as (_, port), socket.socket(type=socket.SOCK_DGRAM) as asker:
        asker.settimeout(10.0)
        asker.connect(("127.0.0.1", int(port)))
        asker.send(b"one")
        assert asker.recv(100) == b"one"


def test_bytes_are_carried_from_pty_to_pty(tmp_path):
    inward, outward = PtyLine(tmp_path / "in"), PtyLine(tmp_path / "out")
    try:
        with background("-m", "hil.bench.bare_echo", "pty", str(tmp_path / "in"), str(tmp_path / "out")):
            inward.write(b"\n\x03one")
            assert outward.read_until_total(5, 10.0) == b"\n\x03one"
        assert select.select([inward], [], [], 0.0)[0] == []
    finally:
        inward.close()
        outward.close()


def test_a_helper_that_fails_is_told():
    with pytest.raises(HilError, match="boom"):
        answer_of(["-c", "raise SystemExit('boom')"], 1.0)
    with pytest.raises(HilError, match="failed"), background("-c", "pass"):
        pytest.fail("a helper that is not there was taken for one that is")


def test_steadiness_ends_with_its_context_and_is_not_inherited():
    before = os.sched_getscheduler(0)
    with steady() as real_time:
        if real_time:
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
        assert answer_of(["-c", "import os; print(os.sched_getscheduler(0))"], 1.0) == os.SCHED_OTHER
    assert os.sched_getscheduler(0) == before
