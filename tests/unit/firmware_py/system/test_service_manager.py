"""Notifications to a service manager at a socket with a path and at an abstract one."""

import os
import secrets
import socket
from pathlib import Path

import pytest

from firmware_py.system.service_manager import ServiceManager, runtime_directory


@pytest.fixture(params=["path", "abstract"])
def manager_side(request, tmp_path):
    """The socket of a manager, and how NOTIFY_SOCKET names it."""
    name = "@rambler-" + secrets.token_hex(8) if request.param == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(name.replace("@", "\0", 1))
        made.setblocking(False)
        yield made, name


def notifications(made):
    lines = []
    while True:
        try:
            lines.append(made.recv(4096).decode().splitlines())
        except BlockingIOError:
            return lines


def test_ready_is_sent_once_then_watchdog_resets_and_changes(manager_side):
    made, name = manager_side
    manager = ServiceManager({"NOTIFY_SOCKET": name})
    assert manager.present
    manager.notify_alive("HOLD")
    manager.notify_alive("HOLD")
    manager.notify_alive("AUTO\nREADY=0 " + "x" * 500)
    manager.notify_stopping()
    first, second, third, last = notifications(made)
    assert (first, second, last) == (["READY=1", "WATCHDOG=1", "STATUS=HOLD"], ["WATCHDOG=1"], ["STOPPING=1"])
    assert third[0] == "WATCHDOG=1"
    assert third[1].startswith("STATUS=AUTO READY=0 x")
    assert len(third) == 2


def test_a_failed_notification_is_repeated(tmp_path):
    manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "late")})
    manager.notify_alive("HOLD")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(str(tmp_path / "late"))
        made.setblocking(False)
        manager.notify_alive("HOLD")
        assert notifications(made) == [["READY=1", "WATCHDOG=1", "STATUS=HOLD"]]


def test_a_manager_that_does_not_read_does_not_block(manager_side):
    _, name = manager_side
    manager = ServiceManager({"NOTIFY_SOCKET": name})
    for _ in range(2000):
        manager.notify_alive("HOLD")


@pytest.mark.parametrize("name", ["", "vsock:2:1234", "relative/path"])
def test_without_a_socket_nothing_is_sent(name):
    manager = ServiceManager({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "5000000"})
    assert not manager.present
    assert manager.watchdog_s is None
    manager.notify_alive("HOLD")


@pytest.mark.parametrize(
    ("more", "watchdog_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "5000000"}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": str(os.getpid())}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_time_is_read_from_the_environment(more, watchdog_s):
    assert ServiceManager({"NOTIFY_SOCKET": "@x", **more}).watchdog_s == watchdog_s


@pytest.mark.parametrize(
    ("value", "found"), [("", None), ("/run/rambler", "/run/rambler"), ("/run/a:/run/b", "/run/a"), ("a", None)]
)
def test_the_runtime_directory(value, found):
    assert runtime_directory({"RUNTIME_DIRECTORY": value}) == (None if found is None else Path(found))
