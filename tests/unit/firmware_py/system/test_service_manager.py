"""Notifications to a service manager at a socket with a path and at an abstract socket."""

import os
import secrets
import socket
from pathlib import Path

import pytest

from firmware_py.system.service_manager import ServiceManager, runtime_directory


@pytest.fixture(params=["path", "abstract"])
def manager_socket(request, tmp_path):
    """Return the socket of a manager, and its name in NOTIFY_SOCKET."""
    name = "@rambler-" + secrets.token_hex(8) if request.param == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as bound:
        bound.bind(name.replace("@", "\0", 1))
        bound.setblocking(False)
        yield bound, name


def read_notifications(bound):
    lines = []
    while True:
        try:
            lines.append(bound.recv(4096).decode().splitlines())
        except BlockingIOError:
            return lines


def test_ready_is_sent_once_then_watchdog_resets_and_changes(manager_socket):
    bound, name = manager_socket
    manager = ServiceManager({"NOTIFY_SOCKET": name})
    assert manager.is_present
    for status in ("HOLD", "HOLD", "AUTO\nREADY=0 " + "x" * 500):
        manager.notify_alive(status)
    manager.notify_stopping()
    first, second, third, last = read_notifications(bound)
    assert (first, second, last) == (["READY=1", "WATCHDOG=1", "STATUS=HOLD"], ["WATCHDOG=1"], ["STOPPING=1"])
    assert third[0] == "WATCHDOG=1"
    assert third[1:] == ["STATUS=AUTO READY=0 " + "x" * 107]  # 120 characters


def test_a_failed_notification_is_repeated(tmp_path):
    manager = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "late")})
    manager.notify_alive("HOLD")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as bound:
        bound.bind(str(tmp_path / "late"))
        bound.setblocking(False)
        manager.notify_alive("HOLD")
        assert read_notifications(bound) == [["READY=1", "WATCHDOG=1", "STATUS=HOLD"]]


def test_a_manager_that_does_not_read_does_not_block(manager_socket):
    manager = ServiceManager({"NOTIFY_SOCKET": manager_socket[1]})
    for _ in range(2000):
        manager.notify_alive("HOLD")


@pytest.mark.parametrize("name", ["", "vsock:2:1234", "relative/path"])
def test_without_a_socket_no_notification_is_sent(name):
    manager = ServiceManager({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "5000000"})
    assert not manager.is_present
    assert manager.watchdog_s is None
    manager.notify_alive("HOLD")


@pytest.mark.parametrize(
    ("environment", "watchdog_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "5000000"}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "this process"}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "1"}, 1e-6),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_time_is_read_from_the_environment(environment, watchdog_s):
    environment = {name: value.replace("this process", str(os.getpid())) for name, value in environment.items()}
    assert ServiceManager({"NOTIFY_SOCKET": "@x", **environment}).watchdog_s == watchdog_s


@pytest.mark.parametrize(
    ("value", "path"),
    [("", None), ("/run/rambler", Path("/run/rambler")), ("/run/a:/run/b", Path("/run/a")), ("a", None)],
)
def test_the_runtime_directory_is_the_first_absolute_path(value, path):
    assert runtime_directory({"RUNTIME_DIRECTORY": value}) == path
