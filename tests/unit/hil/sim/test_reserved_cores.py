import os
import socket
import subprocess
import sys

import pytest

from hil.sim import reserved_cores as module
from hil.sim.reserved_cores import MIN_GOOD_POLLS, PAUSE_S, POLL_S, TurnTaking, reserved_cores

CORES = os.sched_getaffinity(0)
needs_cores = pytest.mark.skipif(len(CORES) < 2, reason="one core")


@pytest.fixture
def own_names(monkeypatch):
    """Names of reserved cores that differ from those of runs outside the tests."""
    prefix, claim_core = f"test-{os.getpid()}-", module._claim

    class Claim:
        def __init__(self, socket):
            self._socket = socket

        def bind(self, name):
            self._socket.bind(name.replace("lockstep-", prefix))

    monkeypatch.setattr(module, "_claim", lambda claim_socket, core: claim_core(Claim(claim_socket), core))


def cores_of_a_child():
    command = [sys.executable, "-c", "import os; print(*os.sched_getaffinity(0))"]
    return set(map(int, subprocess.check_output(command).split()))


@needs_cores
def test_run_and_its_children_use_one_core_and_release_it(own_names):
    with reserved_cores():
        cores = os.sched_getaffinity(0)
        assert len(cores) == 1
        assert cores_of_a_child() == cores
    assert os.sched_getaffinity(0) == CORES


@needs_cores
def test_parallel_runs_use_different_cores(own_names):
    with reserved_cores():
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, CORES)  # as in another process
        with reserved_cores():
            assert cores.isdisjoint(os.sched_getaffinity(0))
    os.sched_setaffinity(0, CORES)


def test_no_core_is_reserved_if_none_is_left(own_names, monkeypatch):
    monkeypatch.setattr("hil.sim.reserved_cores._claim", lambda claim_socket, core: False)
    with reserved_cores():
        assert os.sched_getaffinity(0) == CORES


@needs_cores
def test_run_can_reserve_two_cores(own_names):
    with reserved_cores(2) as cores:
        assert len(set(cores)) == 2
        assert os.sched_getaffinity(0) == {cores[0]}
        os.sched_setaffinity(0, CORES)
        with reserved_cores(len(CORES)) as others:
            assert set(others) == CORES - set(cores)
    os.sched_setaffinity(0, CORES)


class Peer:
    """The other program with a simulated clock; it replies after 100 yields. Records the core assignments."""

    def __init__(self, monkeypatch):
        self.socket, self.far_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.now_s, self.yield_s, self.yields, self.assigned = 100.0, 1e-6, 0, []
        monkeypatch.setattr(module.time, "monotonic", self.monotonic)
        monkeypatch.setattr(module.os, "sched_yield", self.yield_core)
        monkeypatch.setattr(module.os, "sched_setaffinity", lambda _pid, cores: self.assigned.append(cores))

    def monotonic(self):
        return self.now_s

    def yield_core(self):
        self.now_s += self.yield_s
        self.yields += 1
        if self.yields == 100:
            self.far_socket.send(b"reply")


@pytest.fixture
def peer(monkeypatch):
    peer = Peer(monkeypatch)
    with peer.socket, peer.far_socket:
        yield peer


def test_each_of_two_programs_keeps_its_core_and_polls(peer):
    turn_taking = TurnTaking((4, 7))
    turn_taking.begin(peer.socket)
    assert turn_taking.poll_time_s() == POLL_S
    assert peer.assigned == [{7}]
    turn_taking.poll()
    assert peer.yields == 100
    assert peer.socket.recv(10) == b"reply"
    assert turn_taking.poll_time_s() == POLL_S
    assert peer.assigned == [{7}]


@pytest.mark.parametrize("yield_s", [0.001, 1e-4], ids=["another process", "long reply"])
def test_both_programs_share_one_core_after_a_timeout(peer, yield_s):
    turn_taking = TurnTaking((4, 7))
    turn_taking.begin(peer.socket)
    turn_taking.poll_time_s()
    peer.yield_s = yield_s
    turn_taking.poll()
    assert peer.yields < 100
    assert peer.assigned == [{7}, {4}]
    assert turn_taking.poll_time_s() == 0.0
    peer.now_s += PAUSE_S
    assert turn_taking.poll_time_s() == 0.0
    yields = peer.yields
    turn_taking.poll()  # returns at once
    assert peer.yields == yields
    peer.now_s += PAUSE_S
    assert turn_taking.poll_time_s() == POLL_S
    assert peer.assigned == [{7}, {4}, {7}]


def test_repeated_timeouts_double_the_pause(peer):
    turn_taking = TurnTaking((4, 7))
    turn_taking.begin(peer.socket)
    pauses_s = []
    for good_polls in (0, 0, 0, 0, 0, 0, MIN_GOOD_POLLS, 0):
        assert turn_taking.poll_time_s() == POLL_S
        peer.far_socket.send(b"reply")
        for _ in range(good_polls):
            turn_taking.poll()
        peer.socket.recv(10)
        peer.yield_s, start_s = 0.001, peer.now_s
        turn_taking.poll()
        while turn_taking.poll_time_s() == 0.0:
            peer.now_s += 0.001
        pauses_s.append(round(peer.now_s - start_s, 2))
    assert pauses_s == [0.1, 0.2, 0.4, 0.8, 1.6, 1.6, 0.05, 0.1]


@pytest.mark.parametrize("cores", [(), (3,)])
def test_programs_with_fewer_than_two_cores_do_not_poll(peer, cores):
    turn_taking = TurnTaking(cores)
    turn_taking.begin(peer.socket)
    assert turn_taking.poll_time_s() == 0.0
    turn_taking.poll()
    assert (peer.yields, peer.assigned) == (0, [])
