"""The computer's watchdog, with a terminal in place of the device: it accepts bytes and no ioctl of a watchdog."""

import os
import pty
import select
import tty
from pathlib import Path

import pytest

from firmware_py.system import watchdogs
from firmware_py.system.watchdogs import HardwareWatchdog, WatchdogError

INTERVAL_S = 2.0
TIMEOUT_S = 15


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
    assert requests == [(0xC0045706, TIMEOUT_S)]
    watchdog.disarm()


@pytest.mark.parametrize("name", ["file", "missing", "."])
def test_a_path_that_is_not_a_watchdog_is_an_error(tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(WatchdogError, match="leave it out"):
        HardwareWatchdog(tmp_path / name)
