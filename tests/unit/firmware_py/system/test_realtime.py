"""Large pages are used only where possible, without changing data or using much memory; freed memory is released."""

import json
import os
import subprocess
import sys
import threading
from types import SimpleNamespace

from firmware_py.system import realtime
from firmware_py.system.realtime import large_page_addresses

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
ctypes.CDLL(None).mallopt(-3, 1 << 20)  # no block is a mapping of its own
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
