"""Requests real-time scheduling from kernel and interpreter, and reports what was refused."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import mmap
import os
import signal
import sys
import threading
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NoReturn

from firmware_py.common.interfaces import Clock

PRIORITY = 40
# Of the other threads of this process: the loop waits for the thread that has the interpreter lock, so that thread must
# not wait for other programs.
BACKGROUND_PRIORITY = 10
_MCL_CURRENT = 1
_MCL_ONFAULT = 4  # only pages in use, not whole libraries
_MADV_COLLAPSE = 25  # since Linux 6.1, on kernels with large pages
_LARGE_PAGE = Path("/sys/kernel/mm/transparent_hugepage/hpage_pmd_size")
MAX_UNUSED_BYTES = 96 << 10  # maximum additional memory of a large page compared with small pages
_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29
_TIME_ERROR = 5  # adjtimex: the clock is not synchronised
SWITCH_INTERVAL_S = 0.0005  # after which a computing background thread releases the interpreter lock


def prepare(ordinary: Collection[str] = (), *, real_time: bool = True) -> tuple[str, ...]:
    """Set real-time priorities, lock memory, set exact timers, disable garbage collection; return the failures.

    Call this when all threads are running. The threads named in `ordinary` keep the normal priority: external clients
    determine their load, and Linux suspends real-time threads for 50 ms per second under full load. Without
    `real_time`, for simulated time, nothing is requested from the kernel.
    """
    gc.collect()
    release_free_memory()  # locked memory cannot be released
    failures = _request_from_kernel(ordinary) if real_time else []
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.freeze()
    gc.disable()
    if real_time:
        use_large_pages()
    return tuple(failures)


def _request_from_kernel(ordinary: Collection[str]) -> list[str]:
    """Set priorities, lock memory and set exact timers; return the failures."""
    failures = []
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        for thread in threading.enumerate():
            if thread is threading.current_thread() or thread.name in ordinary:
                continue
            if thread.native_id is not None:
                os.sched_setscheduler(thread.native_id, os.SCHED_FIFO, os.sched_param(BACKGROUND_PRIORITY))
    except OSError as error:
        failures.append(f"SCHED_FIFO not allowed ({error.strerror}): ticks may come late under load")
    if libc.mlockall(_MCL_CURRENT | _MCL_ONFAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
        failures.append(f"mlockall not allowed ({reason}): a page fault may delay a tick")
    return failures


def release_free_memory() -> None:
    """Return memory that the start has freed to the system, if the C library supports it."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def use_large_pages() -> None:
    """Merge densely used memory into large pages, if the kernel supports it.

    A tick starts with cold caches and accesses much memory; with entries for 2 MiB it reads fewer page tables.
    """
    try:
        size, maps = int(_LARGE_PAGE.read_text()), Path("/proc/self/maps").read_text(errors="replace")
    except (OSError, ValueError):
        return  # a kernel without large pages
    libc = ctypes.CDLL(None)
    resident = ctypes.create_string_buffer(size // mmap.PAGESIZE)
    for address in large_page_addresses(maps, size):
        page = (ctypes.c_void_p(address), ctypes.c_size_t(size))
        if libc.mincore(*page, resident) != 0:
            continue
        if resident.raw.count(b"\0") * mmap.PAGESIZE <= MAX_UNUSED_BYTES:
            libc.madvise(*page, _MADV_COLLAPSE)


def large_page_addresses(maps: str, size: int) -> Iterator[int]:
    """Yield the addresses of possible large pages in writable private anonymous memory.

    `maps` is the content of /proc/self/maps (proc(5)), `size` the size of a large page in bytes.
    """
    for line in maps.splitlines():
        bounds, mode, _offset, _device, inode, *name = line.split(maxsplit=5)
        if mode == "rw-p" and inode == "0" and name in ([], ["[heap]"]):
            begin, end = (int(bound, 16) for bound in bounds.split("-"))
            yield from range(-(-begin // size) * size, end - size + 1, size)


def reset_scheduling() -> None:
    """Reset the scheduling to normal, because a program that replaces this one would inherit the priority."""
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:  # as for real-time priority
        pass


def restart_program() -> NoReturn:
    """Replace this process by the same program with the same arguments."""
    reset_scheduling()
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - the arguments of this process


def clock_is_synchronised() -> bool:
    """Return whether the kernel reports the computer's clock as synchronised (by NTP, PTP or a GPS daemon)."""
    # struct timex starts with `modes`, 0 = read only; the buffer is larger than the struct on every Linux.
    timex = ctypes.create_string_buffer(512)
    return int(ctypes.CDLL(None).adjtimex(timex)) not in (-1, _TIME_ERROR)


def end_with_parent(pid: int) -> bool:
    """Request SIGTERM when the parent process ends; return False if the parent is no longer `pid`."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    return os.getppid() == pid


class LoadMeter:
    """Measures the processor load of this process as a fraction of one core."""

    def __init__(self, clock: Clock) -> None:
        """Start the measurement."""
        self._clock = clock
        self._fraction = 0.0
        self._start_s, self._start_processor_s = clock.now_s(), _processor_time_s()

    def fraction(self) -> float:
        """Return the load, 0 to 1, averaged over at least one second."""
        now_s = self._clock.now_s()
        if now_s - self._start_s >= 1.0:
            processor_s = _processor_time_s()
            self._fraction = min(1.0, (processor_s - self._start_processor_s) / (now_s - self._start_s))
            self._start_s, self._start_processor_s = now_s, processor_s
        return self._fraction


def _processor_time_s() -> float:
    times = os.times()
    return times.user + times.system
