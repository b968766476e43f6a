"""Values of /proc, also of this process."""

import os
import subprocess
import sys

import pytest

from hil.bench.machine import Memory, autopilot_scheduling, children_of, cpu_of, memory, memory_of, parent


def test_parent_is_read_with_any_process_name():
    assert parent("123 (a) b) (c) S 45 123 123 0 -1 4194304\n") == 45


def test_memory_is_in_mib():
    status = "Name:\tpython\nVmHWM:\t   30720 kB\nVmRSS:\t   20480 kB\nCpus_allowed:\t3\n"
    assert memory(status) == Memory(20.0, 30.0)


def test_time_and_memory_of_this_process_are_read():
    start_s = cpu_of(os.getpid())
    while cpu_of(os.getpid()) == start_s:
        pass
    size = memory_of(os.getpid())
    assert 5.0 < size.now_mib <= size.max_mib


def test_children_are_those_that_run():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert child.pid in children_of(os.getpid())
        child.stdin.close()
    assert child.pid not in children_of(os.getpid())
    with pytest.raises(OSError):
        cpu_of(child.pid)


def test_scheduling_is_restored_and_not_inherited():
    policy = os.sched_getscheduler(0)
    with autopilot_scheduling() as has_real_time:
        if has_real_time:
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
        words = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
        assert int(subprocess.check_output(words)) == os.SCHED_OTHER
    assert os.sched_getscheduler(0) == policy
