import os
import subprocess
import sys

import pytest

from hil.sim.one_core import one_core

CORES = os.sched_getaffinity(0)


@pytest.fixture
def names(monkeypatch):
    """Cores by names that no run beside the tests has."""
    import hil.sim.one_core as module  # noqa: PLC0415 - patched only here

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
    with one_core():
        mine = os.sched_getaffinity(0)
        assert len(mine) == 1
        assert cores_of_a_child() == mine
    assert os.sched_getaffinity(0) == CORES


@pytest.mark.skipif(len(CORES) < 2, reason="one core")
def test_runs_beside_one_another_keep_to_different_cores(names):
    with one_core():
        first = os.sched_getaffinity(0)
        os.sched_setaffinity(0, CORES)  # as a process beside it is
        with one_core():
            assert first.isdisjoint(os.sched_getaffinity(0))
    os.sched_setaffinity(0, CORES)


def test_one_that_finds_no_core_goes_without(names, monkeypatch):
    monkeypatch.setattr("hil.sim.one_core._claimed", lambda claim, core: False)
    with one_core():
        assert os.sched_getaffinity(0) == CORES
