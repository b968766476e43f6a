"""The computer's watchdog, with a terminal in place of the device: it accepts bytes and no ioctl of a watchdog."""

import os
import pty
import select
import tty
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.system import watchdogs
from firmware_py.system.watchdogs import HardwareWatchdog, WatchdogError, Watchdogs, is_in_uninterruptible_wait

INTERVAL_S = 2.0
TIMEOUT_S = 15
WDIOC_SETTIMEOUT = 0xC0045706  # linux/watchdog.h


@pytest.fixture
def device():
    """Return the path of a device, and a function that returns the bytes written to it."""
    master, slave = pty.openpty()
    tty.setraw(slave)

    def read_until_disarmed():
        data = b""
        while not data.endswith(b"V") and select.select([master], [], [], 10.0)[0]:
            data += os.read(master, 4096)
        return data

    yield Path(os.ttyname(slave)), read_until_disarmed
    os.close(master)
    os.close(slave)


def test_the_watchdog_is_reset_every_two_seconds_and_disarmed_at_the_end(device):
    path, read_until_disarmed = device
    watchdog = HardwareWatchdog(path)
    assert "timeout not set" in watchdog.note
    for tenth in range(41):
        watchdog.notify_alive(tenth / 10.0)
    watchdog.disarm()
    assert read_until_disarmed() == b"\0" * (1 + round(4.0 / INTERVAL_S)) + b"V"
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(watchdog._descriptor)


@pytest.mark.parametrize(("granted_s", "note"), [(TIMEOUT_S, ""), (60, "60 s instead of 15 s")])
def test_the_timeout_is_set_and_a_deviation_is_noted(device, monkeypatch, granted_s, note):
    requests = []

    def ioctl(_descriptor, number, data):
        requests.append((number, int.from_bytes(data, "little")))
        return granted_s.to_bytes(4, "little")

    monkeypatch.setattr(watchdogs.fcntl, "ioctl", ioctl)
    watchdog = HardwareWatchdog(device[0])
    assert note in watchdog.note
    assert bool(note) == bool(watchdog.note)
    assert requests == [(WDIOC_SETTIMEOUT, TIMEOUT_S)]
    watchdog.disarm()


@pytest.mark.parametrize("name", ["file", "missing", "."])
def test_a_path_that_is_not_a_watchdog_is_an_error(tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(WatchdogError, match="leave it out"):
        HardwareWatchdog(tmp_path / name)


@pytest.mark.parametrize("error", [(16, "Device or resource busy"), (13, "Permission denied")])
def test_a_watchdog_that_cannot_be_opened_names_the_reason(device, monkeypatch, error):
    def fail(*_arguments):
        raise OSError(*error)

    monkeypatch.setattr(watchdogs.os, "open", fail)
    reason = "in use, by systemd perhaps" if error[0] == 16 else "Permission denied"
    with pytest.raises(WatchdogError, match=reason):
        HardwareWatchdog(device[0])


@pytest.mark.parametrize(
    ("has_manager", "has_hardware", "restart", "calls"),
    [
        (True, True, False, ["a", "a", "b", "reset 1.0", "reset 2.0", "reset 3.0", "stopping", "disarm"]),
        (False, True, True, ["a", "a", "b", "reset 1.0", "reset 2.0", "reset 3.0", "stopping"]),
        (True, False, True, ["a", "a", "b", "stopping"]),
        (False, False, False, ["a", "a", "b", "stopping"]),
    ],
)
def test_available_watchdogs_are_reset_until_the_end(has_manager, has_hardware, restart, calls):
    statuses, resets = [], []
    manager = SimpleNamespace(
        is_present=has_manager, notify_alive=statuses.append, notify_stopping=lambda: resets.append("stopping")
    )
    hardware = SimpleNamespace(
        notify_alive=lambda now_s: resets.append(f"reset {now_s}"), disarm=lambda: resets.append("disarm")
    )
    both = Watchdogs(manager, hardware if has_hardware else None)
    assert both.can_restart is (has_manager or has_hardware)
    for now_s, status in ((1.0, "a"), (2.0, ""), (3.0, "b")):
        both.notify_alive(now_s, status)
    both.stop(restart=restart)
    assert statuses + resets == calls


@pytest.mark.parametrize(
    ("stat", "is_waiting"), [("7 (a D) S 1", False), ("7 (a) S) D 1", True), ("", False), (None, False)]
)
def test_a_thread_that_waits_for_a_disk_is_recognised(tmp_path, monkeypatch, stat, is_waiting):
    monkeypatch.setattr(watchdogs, "_THREADS", tmp_path)
    (tmp_path / "7").mkdir()
    if stat is not None:
        (tmp_path / "7/stat").write_text(stat)
    assert is_in_uninterruptible_wait(7) is is_waiting
