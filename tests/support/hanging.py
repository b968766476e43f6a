"""`rambler` with parts that hang forever on request: by a file in HANG_DIRECTORY with the name of the part."""

import ctypes
import os
import sys
import threading
import time
from pathlib import Path

from firmware_py.__main__ import main
from firmware_py.core import autopilot
from firmware_py.log.writer import LogWriter
from firmware_py.system.serial_port import SerialPort
from firmware_py.system.slots import SlotWriter

DIRECTORY = Path(os.environ["HANG_DIRECTORY"])


def is_requested(part):
    """Return whether this part must hang; it is True only once for each request."""
    try:
        (DIRECTORY / part).unlink()
    except FileNotFoundError:
        return False
    return True


def hang_before(part, hang, function):
    def wrapped(*args, **kwargs):
        if is_requested(part):
            hang()
        return function(*args, **kwargs)

    return wrapped


def deadlock():
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()


def sleep():
    while True:
        time.sleep(3600.0)


def wait_in_kernel():
    """Wait in the kernel like a process on a blocked disk, until a write to a pipe.

    The child of vfork(2) opens the pipe. This is the only such wait that needs no device. ctypes lets the other threads
    run at the same time.
    """
    libc = ctypes.CDLL(None)
    actions, pid = ctypes.create_string_buffer(256), ctypes.c_int()
    libc.posix_spawn_file_actions_init(actions)
    libc.posix_spawn_file_actions_addopen(actions, 0, bytes(DIRECTORY / "pipe"), os.O_RDONLY, 0)
    words = (ctypes.c_char_p * 2)(b"/bin/true", None)
    libc.posix_spawn(ctypes.byref(pid), words[0], actions, None, words, (ctypes.c_char_p * 1)(None))


def read_nothing():
    read = SerialPort.read
    SerialPort.read = lambda line: read(line)[:0]


def send_nothing():
    SerialPort.write = lambda _line, _data: False


autopilot.step = hang_before("tick", sleep, autopilot.step)
SlotWriter.write = hang_before("store", sleep, hang_before("disk", wait_in_kernel, SlotWriter.write))
SerialPort.read = hang_before("samples", read_nothing, SerialPort.read)
SerialPort.write = hang_before("actuation", send_nothing, SerialPort.write)
LogWriter.drain = hang_before("log", deadlock, LogWriter.drain)
LogWriter._check_free_space = hang_before("ended", sys.exit, LogWriter._check_free_space)
sys.exit(main())
