"""`rambler` with parts that hang for good on request, by a file in HANG_DIRECTORY that names the part."""

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
    """Return whether this part must hang; True once."""
    try:
        (DIRECTORY / part).unlink()
    except FileNotFoundError:
        return False
    return True


def before(part, hang, function):
    def wrapped(*words, **more):
        if is_requested(part):
            hang()
        return function(*words, **more)

    return wrapped


def deadlock():
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()


def sleep():
    while True:
        time.sleep(3600.0)


def wait_in_kernel():
    """Wait like a process on a blocked disk, until a write to a pipe: by vfork(2), whose child opens it.

    Of all that puts a thread there by itself this alone needs no device. ctypes lets the other threads run meanwhile.
    """
    libc = ctypes.CDLL(None)
    actions, pid = ctypes.create_string_buffer(256), ctypes.c_int()
    libc.posix_spawn_file_actions_init(actions)
    libc.posix_spawn_file_actions_addopen(actions, 0, bytes(DIRECTORY / "pipe"), os.O_RDONLY, 0)
    words = (ctypes.c_char_p * 2)(b"/bin/true", None)
    libc.posix_spawn(ctypes.byref(pid), words[0], actions, None, words, (ctypes.c_char_p * 1)(None))


def hear_nothing():
    read = SerialPort.read
    SerialPort.read = lambda line: read(line)[:0]


def send_nothing():
    SerialPort.write = lambda _line, _data: False


autopilot.step = before("tick", sleep, autopilot.step)
SlotWriter.write = before("store", sleep, before("disk", wait_in_kernel, SlotWriter.write))
SerialPort.read = before("samples", hear_nothing, SerialPort.read)
SerialPort.write = before("actuation", send_nothing, SerialPort.write)
LogWriter.drain = before("log", deadlock, LogWriter.drain)
LogWriter._check_free_space = before("ended", sys.exit, LogWriter._check_free_space)
sys.exit(main())
