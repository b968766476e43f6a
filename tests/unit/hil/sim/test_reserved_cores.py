import os
import socket
import subprocess
import sys

import pytest

from hil.sim import reserved_cores as module
from hil.sim.reserved_cores import GOOD_POLLS, PAUSE_S, POLL_S, TurnTaking, reserved_cores

CORES = os.sched_getaffinity(0)


@pytest.fixture
def names(monkeypatch):
    """Core names that differ from those of runs outside the tests."""
    own, claimed = f"test-{os.getpid()}-", module._claimed

    class Claim:
        def __init__(self, socket):
            self._socket = socket

        def bind(self, name):
            self._socket.bind(name.replace("lockstep-", own))

    monkeypatch.setattr(module, "_claimed", lambda claim, core: claimed(Claim(claim), core))


def cores_of_a_child():
    command = [sys.executable, "-c", "import os; print(*os.sched_getaffinity(0))"]
    return set(map(int, subprocess.check_output(command).split()))


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_a_run_and_its_children_use_one_core_and_release_it(names):
    with reserved_cores():
        mine = os.sched_getaffinity(0)
        assert len(mine) == 1
        assert cores_of_a_child() == mine
    assert os.sched_getaffinity(0) == CORES


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_parallel_runs_use_different_cores(names):
    with reserved_cores():
        first = os.sched_getaffinity(0)
        os.sched_setaffinity(0, CORES)  # like another process
        with reserved_cores():
            assert first.isdisjoint(os.sched_getaffinity(0))
    os.sched_setaffinity(0, CORES)


def test_no_core_left(names, monkeypatch):
    monkeypatch.setattr("hil.sim.reserved_cores._claimed", lambda claim, core: False)
    with reserved_cores():
        assert os.sched_getaffinity(0) == CORES


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_a_run_can_reserve_two_cores(names):
    with reserved_cores(2) as cores:
        assert len(set(cores)) == 2
        assert os.sched_getaffinity(0) == {cores[0]}
        os.sched_setaffinity(0, CORES)
        with reserved_cores(len(CORES)) as others:
            assert set(others) == CORES - set(cores)
    os.sched_setaffinity(0, CORES)


class Peer:
    """The other program: records its core assignments and replies after 100 yields."""

    def __init__(self, monkeypatch):
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.now_s, self.jump_s, self.yields, self.assigned = 100.0, 1e-6, 0, []
        monkeypatch.setattr(module.time, "monotonic", self.monotonic)
        monkeypatch.setattr(module.os, "sched_yield", self.yield_core)
        monkeypatch.setattr(module.os, "sched_setaffinity", lambda _pid, cores: self.assigned.append(cores))

    def monotonic(self):
        return self.now_s

    def yield_core(self):
        self.now_s += self.jump_s
        self.yields += 1
        if self.yields == 100:
            self.theirs.send(b"answer")


@pytest.fixture
def peer(monkeypatch):
    """The other program, with a clock that advances when this program yields."""
    peer = Peer(monkeypatch)
    with peer.ours, peer.theirs:
        yield peer


def test_with_two_cores_each_program_keeps_its_own_and_polls(peer):
    turns = TurnTaking((4, 7))
    turns.begin(peer.ours)
    assert turns.poll_time_s() == POLL_S
    assert peer.assigned == [{7}]
    turns.poll()
    assert peer.yields == 100
    assert peer.ours.recv(10) == b"answer"
    assert turns.poll_time_s() == POLL_S
    assert peer.assigned == [{7}]


@pytest.mark.parametrize("jump_s", [0.001, 1e-4], ids=["another process", "a long turn"])
def test_after_a_timeout_both_programs_share_one_core_for_a_while(peer, jump_s):
    turns = TurnTaking((4, 7))
    turns.begin(peer.ours)
    turns.poll_time_s()
    peer.jump_s = jump_s
    turns.poll()
    assert peer.yields < 100
    assert peer.assigned == [{7}, {4}]
    assert turns.poll_time_s() == 0.0
    peer.now_s += PAUSE_S
    assert turns.poll_time_s() == 0.0
    before = peer.yields
    turns.poll()  # returns at once
    assert peer.yields == before
    peer.now_s += PAUSE_S
    assert turns.poll_time_s() == POLL_S
    assert peer.assigned == [{7}, {4}, {7}]


def test_repeated_timeouts_double_the_pause(peer):
    turns = TurnTaking((4, 7))
    turns.begin(peer.ours)
    pauses_s = []
    for good in (0, 0, 0, 0, 0, 0, GOOD_POLLS, 0):
        assert turns.poll_time_s() == POLL_S
        peer.theirs.send(b"answer")
        for _ in range(good):
            turns.poll()
        peer.ours.recv(10)
        peer.jump_s, begun_s = 0.001, peer.now_s
        turns.poll()
        while turns.poll_time_s() == 0.0:
            peer.now_s += 0.001
        pauses_s.append(round(peer.now_s - begun_s, 2))
    assert pauses_s == [0.1, 0.2, 0.4, 0.8, 1.6, 1.6, 0.05, 0.1]


@pytest.mark.parametrize("cores", [(), (3,)])
def test_with_fewer_than_two_cores_no_polling(peer, cores):
    turns = TurnTaking(cores)
    turns.begin(peer.ours)
    assert turns.poll_time_s() == 0.0
    turns.poll()
    assert (peer.yields, peer.assigned) == (0, [])
