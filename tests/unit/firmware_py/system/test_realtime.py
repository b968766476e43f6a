"""Large pages are used only where possible, without changing data or using much memory; freed memory is released."""

import json
import os
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest

from firmware_py.system import realtime
from firmware_py.system.realtime import LoadMeter, large_page_addresses

MAX_UNUSED_BYTES = 96 << 10

MAPS = """\
10000-13000 rw-p 00000000 00:00 0
20800-22800 rw-p 00000000 00:00 0                                        [heap]
30800-31800 rw-p 00000000 00:00 0
40000-42000 r--p 00000000 00:00 0
50000-52000 rw-s 00000000 00:00 0
60000-62000 rw-p 00001000 fe:00 26933                                    /usr/lib/a library.so
70000-72000 rw-p 00000000 00:00 0                                        [stack]
"""

COMMON = """
import ctypes, json, mmap
from firmware_py.system import realtime
def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * mmap.PAGESIZE
"""
# One area is completely in use, the other half.
USE_LARGE_PAGES = """
size = 8 << 20
full, half = (mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) for _ in range(2))
for offset in range(0, size, mmap.PAGESIZE):
    full[offset] = offset // mmap.PAGESIZE % 251
    if offset // mmap.PAGESIZE % 2:
        half[offset] = 7
start_bytes = resident_bytes()
realtime.use_large_pages()
added_bytes = resident_bytes() - start_bytes
is_unchanged = all(full[offset] == offset // mmap.PAGESIZE % 251 for offset in range(0, size, mmap.PAGESIZE))
print(json.dumps([added_bytes, is_unchanged]))
"""
# The C library keeps the freed blocks, because the last block is in use.
RELEASE_MEMORY = """
ctypes.CDLL(None).mallopt(-3, 1 << 20)  # M_MMAP_THRESHOLD: no block is a mapping of its own
blocks = [bytes(60000) for _ in range(300)]
last = blocks.pop()
blocks.clear()
start_bytes = resident_bytes()
realtime.prepare(real_time=False)
print(json.dumps(start_bytes - resident_bytes()))
"""


def run(program):
    command = [sys.executable, "-c", COMMON + program]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return json.loads(result.stdout)


def test_large_pages_are_within_private_memory_without_a_file():
    assert list(large_page_addresses(MAPS, 0x1000)) == [0x10000, 0x11000, 0x12000, 0x21000]


def test_large_pages_change_no_data_and_add_little_memory():
    added_bytes, is_unchanged = run(USE_LARGE_PAGES)
    assert is_unchanged
    assert added_bytes <= 16 * MAX_UNUSED_BYTES


def test_memory_freed_by_the_start_is_released():
    assert run(RELEASE_MEMORY) > 200 * 60000


def test_kernel_is_asked_for_priorities_exact_timers_and_locked_memory(monkeypatch):
    """Numbers of linux/prctl.h (PR_SET_TIMERSLACK 29) and linux/mman.h (MCL_CURRENT 1, MCL_ONFAULT 4)."""
    calls, priorities = [], []
    libc = SimpleNamespace(
        prctl=lambda *values: calls.append(("prctl", *values)),
        mlockall=lambda flags: calls.append(("mlockall", flags)) or 0,
    )
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda *_values, **_options: libc)
    monkeypatch.setattr(
        realtime.os, "sched_setscheduler", lambda thread, policy, value: priorities.append((thread, policy, value))
    )
    current = threading.current_thread()
    threads = [current, SimpleNamespace(name="writer", native_id=7), SimpleNamespace(name="view", native_id=8)]
    monkeypatch.setattr(realtime.threading, "enumerate", lambda: threads)
    assert realtime._request_from_kernel({"view"}) == []
    assert calls == [("prctl", 29, 1, 0, 0, 0), ("mlockall", 5)]
    assert [(thread, value.sched_priority) for thread, _policy, value in priorities] == [(0, 40), (7, 10)]
    assert {policy for _thread, policy, _value in priorities} == {os.SCHED_FIFO}


@pytest.mark.parametrize(
    ("unused_pages", "refused", "calls"), [(24, 0, [(0x200000, 2 << 20, 25)]), (25, 0, []), (0, 1, [])]
)
def test_large_page_may_add_96_kibibytes(monkeypatch, tmp_path, unused_pages, refused, calls):
    """MADV_COLLAPSE is 25 in linux/mman-common.h."""
    advised = []

    def mincore(_address, size, resident):
        used = size.value // 4096 - unused_pages
        resident.raw = b"\1" * used + b"\0" * unused_pages
        return refused

    libc = SimpleNamespace(
        mincore=mincore, madvise=lambda address, size, advice: advised.append((address.value, size.value, advice))
    )
    monkeypatch.setattr(realtime, "_LARGE_PAGE", tmp_path / "size")
    realtime.use_large_pages()  # a kernel without large pages
    (tmp_path / "size").write_text(f"{2 << 20}\n")
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda *_values: libc)
    monkeypatch.setattr(realtime.mmap, "PAGESIZE", 4096)
    monkeypatch.setattr(realtime, "large_page_addresses", lambda _maps, size: [size])
    realtime.use_large_pages()
    assert advised == calls


@pytest.mark.parametrize("real_time", [False, True])
def test_garbage_collection_ends_and_the_interpreter_lock_changes_every_half_millisecond(monkeypatch, real_time):
    calls = []
    for name in ("collect", "freeze", "disable"):
        monkeypatch.setattr(realtime.gc, name, lambda name=name: calls.append(name))
    monkeypatch.setattr(realtime, "release_free_memory", lambda: calls.append("release"))
    monkeypatch.setattr(realtime, "use_large_pages", lambda: calls.append("pages"))
    monkeypatch.setattr(realtime, "_request_from_kernel", lambda names: [*names])
    monkeypatch.setattr(realtime.sys, "setswitchinterval", calls.append)
    assert realtime.prepare(["a"], real_time=real_time) == (("a",) if real_time else ())
    assert calls == ["collect", "release", 0.0005, "freeze", "disable", *(["pages"] if real_time else [])]


def test_refused_requests_are_reported(monkeypatch):
    def refuse(*_values):
        raise PermissionError(1, "Operation not permitted")

    libc = SimpleNamespace(prctl=lambda *_values: 0, mlockall=lambda _flags: -1)
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda *_values, **_options: libc)
    monkeypatch.setattr(realtime.ctypes, "get_errno", lambda: 12)
    monkeypatch.setattr(realtime.os, "sched_setscheduler", refuse)
    assert realtime._request_from_kernel(()) == [
        "SCHED_FIFO not allowed (Operation not permitted): ticks may come late under load",
        "mlockall not allowed (Cannot allocate memory): a page fault may delay a tick",
    ]
    realtime.reset_scheduling()


def test_program_that_replaces_this_one_has_normal_priority_and_the_same_arguments(monkeypatch):
    calls = []
    monkeypatch.setattr(
        realtime.os, "sched_setscheduler", lambda *values: calls.append((*values[:2], values[2].sched_priority))
    )
    monkeypatch.setattr(realtime.os, "execv", lambda *values: calls.append(values))
    monkeypatch.setattr(realtime.sys, "orig_argv", ["python3", "-m", "firmware_py", "run"])
    realtime.restart_program()
    arguments = [sys.executable, "-m", "firmware_py", "run"]
    assert calls == [(0, os.SCHED_OTHER, 0), (sys.executable, arguments)]


@pytest.mark.parametrize(("state", "expected"), [(-1, False), (0, True), (4, True), (5, False)])
def test_clock_is_synchronised_unless_the_kernel_reports_an_error(monkeypatch, state, expected):
    """TIME_ERROR of adjtimex(2) is 5."""
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda _name: SimpleNamespace(adjtimex=lambda _timex: state))
    assert realtime.clock_is_synchronised() is expected


def test_process_ends_with_its_parent(monkeypatch):
    """PR_SET_PDEATHSIG is 1 in linux/prctl.h."""
    calls = []
    libc = SimpleNamespace(prctl=lambda *values: calls.append(values))
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda _name: libc)
    assert [realtime.end_with_parent(pid) for pid in (os.getppid(), os.getppid() + 1)] == [True, False]
    assert calls == [(1, signal.SIGTERM, 0, 0, 0)] * 2


def test_load_is_the_share_of_a_core_over_a_second(monkeypatch):
    now_s, processor_s = [5.0], [2.0]
    monkeypatch.setattr(realtime.os, "times", lambda: SimpleNamespace(user=processor_s[0], system=1.0))
    meter = LoadMeter(SimpleNamespace(now_s=lambda: now_s[0]))
    fractions = []
    for now_s[0], processor_s[0] in ((5.9, 2.5), (6.0, 2.25), (6.9, 3.0), (8.0, 3.25), (9.0, 9.0)):
        fractions.append(meter.fraction())
    assert fractions == [0.0, 0.25, 0.25, 0.5, 1.0]
