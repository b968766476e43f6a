import os
import socket
import subprocess
import sys

import pytest

from hil.sim import own_cores as module
from hil.sim.own_cores import GOOD_LOOKS, LOOK_S, PAUSE_S, Turns, own_cores

CORES = os.sched_getaffinity(0)


@pytest.fixture
def names(monkeypatch):
    """Cores by names that no run beside the tests has."""
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
def test_a_run_and_what_it_starts_keep_to_one_core_and_give_it_back(names):
    with own_cores():
        mine = os.sched_getaffinity(0)
        assert len(mine) == 1
        assert cores_of_a_child() == mine
    assert os.sched_getaffinity(0) == CORES


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_runs_beside_one_another_keep_to_different_cores(names):
    with own_cores():
        first = os.sched_getaffinity(0)
        os.sched_setaffinity(0, CORES)  # as a process beside it is
        with own_cores():
            assert first.isdisjoint(os.sched_getaffinity(0))
    os.sched_setaffinity(0, CORES)


def test_one_that_finds_no_core_goes_without(names, monkeypatch):
    monkeypatch.setattr("hil.sim.own_cores._claimed", lambda claim, core: False)
    with own_cores():
        assert os.sched_getaffinity(0) == CORES


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_a_run_that_wants_two_keeps_to_the_first_and_leaves_none_of_them_to_others(names):
    with own_cores(2) as cores:
        assert len(set(cores)) == 2
        assert os.sched_getaffinity(0) == {cores[0]}
        os.sched_setaffinity(0, CORES)
        with own_cores(len(CORES)) as left:
            assert set(left) == CORES - set(cores)
    os.sched_setaffinity(0, CORES)


class Peer:
    """A program that takes turns with this one: where it is kept, and what it answers when."""

    def __init__(self, monkeypatch):
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.now_s, self.jump_s, self.yields, self.kept_to = 100.0, 1e-6, 0, []
        monkeypatch.setattr(module.time, "monotonic", self.monotonic)
        monkeypatch.setattr(module.os, "sched_yield", self.give_way)
        monkeypatch.setattr(module.os, "sched_setaffinity", lambda _pid, cores: self.kept_to.append(cores))

    def monotonic(self):
        return self.now_s

    def give_way(self):
        self.now_s += self.jump_s
        self.yields += 1
        if self.yields == 100:
            self.theirs.send(b"answer")


@pytest.fixture
def peer(monkeypatch):
    """The other program, and a clock that goes on when this one gives way."""
    peer = Peer(monkeypatch)
    with peer.ours, peer.theirs:
        yield peer


def test_with_two_cores_each_keeps_to_its_own_and_looks_for_the_answer(peer):
    turns = Turns((4, 7))
    turns.begin(peer.ours)
    assert turns.look_s() == LOOK_S
    assert peer.kept_to == [{7}]
    turns.look()
    assert peer.yields == 100
    assert peer.ours.recv(10) == b"answer"
    assert turns.look_s() == LOOK_S
    assert peer.kept_to == [{7}]


@pytest.mark.parametrize("jump_s", [0.001, 1e-4], ids=["somebody else", "a long turn"])
def test_where_looking_is_in_vain_both_keep_to_one_core_for_a_while(peer, jump_s):
    turns = Turns((4, 7))
    turns.begin(peer.ours)
    turns.look_s()
    peer.jump_s = jump_s
    turns.look()
    assert peer.yields < 100
    assert peer.kept_to == [{7}, {4}]
    assert turns.look_s() == 0.0
    peer.now_s += PAUSE_S
    assert turns.look_s() == 0.0
    before = peer.yields
    turns.look()  # which sleeps at once
    assert peer.yields == before
    peer.now_s += PAUSE_S
    assert turns.look_s() == LOOK_S
    assert peer.kept_to == [{7}, {4}, {7}]


def test_who_is_in_the_way_again_and_again_is_left_alone_for_longer(peer):
    turns = Turns((4, 7))
    turns.begin(peer.ours)
    pauses_s = []
    for good in (0, 0, 0, 0, 0, 0, GOOD_LOOKS, 0):
        assert turns.look_s() == LOOK_S
        peer.theirs.send(b"answer")
        for _ in range(good):
            turns.look()
        peer.ours.recv(10)
        peer.jump_s, begun_s = 0.001, peer.now_s
        turns.look()
        while turns.look_s() == 0.0:
            peer.now_s += 0.001
        pauses_s.append(round(peer.now_s - begun_s, 2))
    assert pauses_s == [0.1, 0.2, 0.4, 0.8, 1.6, 1.6, 0.05, 0.1]


@pytest.mark.parametrize("cores", [(), (3,)])
def test_with_less_than_two_cores_nobody_is_moved_and_nobody_looks(peer, cores):
    turns = Turns(cores)
    turns.begin(peer.ours)
    assert turns.look_s() == 0.0
    turns.look()
    assert (peer.yields, peer.kept_to) == (0, [])
