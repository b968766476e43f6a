"""Reading /proc, and this very process."""

import os
import subprocess
import sys

import pytest

from hil.bench.machine import Memory, children_of, cpu_of, memory, memory_of, parent, steady


def test_parent_with_any_process_name():
    assert parent("123 (a) b) (c) S 45 123 123 0 -1 4194304\n") == 45


def test_memory_in_mib():
    status = "Name:\tpython\nVmHWM:\t   30720 kB\nVmRSS:\t   20480 kB\nCpus_allowed:\t3\n"
    assert memory(status) == Memory(20.0, 30.0)


def test_own_process():
    before_s = cpu_of(os.getpid())
    while cpu_of(os.getpid()) == before_s:
        pass
    found = memory_of(os.getpid())
    assert 5.0 < found.now_mib <= found.most_mib


def test_children():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert child.pid in children_of(os.getpid())
        child.stdin.close()
    assert child.pid not in children_of(os.getpid())
    with pytest.raises(OSError):
        cpu_of(child.pid)


def test_steady_scheduling():
    before = os.sched_getscheduler(0)
    with steady() as real_time:
        if real_time:
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
        words = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
        assert int(subprocess.check_output(words)) == os.SCHED_OTHER
    assert os.sched_getscheduler(0) == before
