"""Asks the kernel and the interpreter for steady timing, and says what was not granted."""

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
# Of the other threads of this process: the loop waits for whoever of them holds the interpreter, and that one must not
# have to wait for other programs.
BACKGROUND_PRIORITY = 10
_MCL_CURRENT = 1
_MCL_ONFAULT = 4  # only what is touched, so that whole libraries are not drawn into memory
_MADV_COLLAPSE = 25  # since Linux 6.1, on kernels with large pages
_LARGE_PAGE = Path("/sys/kernel/mm/transparent_hugepage/hpage_pmd_size")
MOST_UNUSED_BYTES = 96 << 10  # of a large page: what it takes in memory beyond what the small ones took
_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29
_TIME_ERROR = 5  # adjtimex: the clock is not synchronised
# A background thread that computes gives the interpreter up after this long.
SWITCH_INTERVAL_S = 0.0005


def prepare(ordinary: Collection[str] = (), *, real_time: bool = True) -> tuple[str, ...]:
    """Set real-time priorities, lock memory, tighten timers, freeze the collector; return what failed.

    To be called when all threads are there. The `ordinary` ones, by name, keep the priority of other programs: those
    whose work others decide on, for Linux takes a processor from real-time work for 50 ms in a second full of it.
    Without `real_time`, where time stands still while the autopilot computes, the kernel is asked for nothing.
    """
    gc.collect()
    release_free_memory()  # locked memory cannot be
    refused = _ask_kernel(ordinary) if real_time else []
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.freeze()
    gc.disable()
    if real_time:
        use_large_pages()
    return tuple(refused)


def _ask_kernel(ordinary: Collection[str]) -> list[str]:
    """Set priorities, lock memory and tighten timers; return what failed."""
    refused = []
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
        refused.append(f"SCHED_FIFO not allowed ({error.strerror}): ticks may come late under load")
    if libc.mlockall(_MCL_CURRENT | _MCL_ONFAULT) != 0:
        reason = os.strerror(ctypes.get_errno())
        refused.append(f"mlockall not allowed ({reason}): a page fault may delay a tick")
    return refused


def release_free_memory() -> None:
    """Give what the start has freed back to the system, where the C library can."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def use_large_pages() -> None:
    """Put what lies close together in memory into large pages, where the kernel can.

    A tick begins with cold caches and touches memory all over: with one entry for 2 MiB it waits less for page tables.
    """
    try:
        size, maps = int(_LARGE_PAGE.read_text()), Path("/proc/self/maps").read_text(errors="replace")
    except (OSError, ValueError):
        return  # a kernel without large pages
    libc = ctypes.CDLL(None)
    resident = ctypes.create_string_buffer(size // mmap.PAGESIZE)
    for address in spans(maps, size):
        place = (ctypes.c_void_p(address), ctypes.c_size_t(size))
        if libc.mincore(*place, resident) != 0:
            continue
        if resident.raw.count(b"\0") * mmap.PAGESIZE <= MOST_UNUSED_BYTES:
            libc.madvise(*place, _MADV_COLLAPSE)


def spans(maps: str, size: int) -> Iterator[int]:
    """Yield the addresses of large pages of a size that lie within writable private memory without a file (proc(5))."""
    for line in maps.splitlines():
        bounds, mode, _offset, _device, inode, *name = line.split(maxsplit=5)
        if mode == "rw-p" and inode == "0" and name in ([], ["[heap]"]):
            begin, end = (int(bound, 16) for bound in bounds.split("-"))
            yield from range(-(-begin // size) * size, end - size + 1, size)


def reset_scheduling() -> None:
    """Give real-time priority back: a program started in place of this one, and its threads, would inherit it."""
    try:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:  # it was not granted either
        pass


def restart_program() -> NoReturn:
    """Replace this process by the same program with the same words; nothing after it is run."""
    reset_scheduling()
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - the words this process was started with


def clock_is_synchronised() -> bool:
    """Whether something (NTP, PTP, a GPS daemon) disciplines the machine's clock, as far as the kernel knows."""
    # struct timex begins with `modes`, 0 = only read; all of it is smaller than this on every Linux.
    timex = ctypes.create_string_buffer(512)
    return int(ctypes.CDLL(None).adjtimex(timex)) not in (-1, _TIME_ERROR)


def end_with_parent(pid: int) -> bool:
    """Have the kernel send SIGTERM when the parent dies, however it dies; False when it is no longer `pid`."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    return os.getppid() == pid


class LoadMeter:
    """How much of one core this process uses."""

    def __init__(self, clock: Clock) -> None:
        """Measure from now on."""
        self._clock = clock
        self._share = 0.0
        self._since_s, self._used_s = clock.now_s(), _used_s()

    def share(self) -> float:
        """Return the share, 0 to 1, averaged over the last second or more."""
        now_s = self._clock.now_s()
        if now_s - self._since_s >= 1.0:
            used_s = _used_s()
            self._share = min(1.0, (used_s - self._used_s) / (now_s - self._since_s))
            self._since_s, self._used_s = now_s, used_s
        return self._share


def _used_s() -> float:
    times = os.times()
    return times.user + times.system
