"""`rambler` with parts that hang for good when told to, by a file in HANG_DIRECTORY that names the part."""

import os
import sys
import threading
import time
from pathlib import Path

from firmware_py.__main__ import main
from firmware_py.core import autopilot
from firmware_py.log.writer import LogWriter
from firmware_py.system.slots import SlotWriter

DIRECTORY = Path(os.environ["HANG_DIRECTORY"])


def told(part):
    """Whether this part is to hang; told once."""
    try:
        (DIRECTORY / part).unlink()
    except FileNotFoundError:
        return False
    return True


def before(part, hang, function):
    def wrapped(*words, **more):
        if told(part):
            hang()
        return function(*words, **more)

    return wrapped


def compute():
    while True:
        pass


def deadlock():
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()


def sleep():
    while True:
        time.sleep(3600.0)


autopilot.step = before("tick", compute, autopilot.step)
SlotWriter.write = before("store", sleep, SlotWriter.write)
LogWriter.drain = before("log", deadlock, LogWriter.drain)
LogWriter._look_for_room = before("ended", sys.exit, LogWriter._look_for_room)
sys.exit(main())
