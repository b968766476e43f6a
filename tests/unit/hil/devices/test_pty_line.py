import contextlib
import errno
import fcntl
import os
import random
import threading

import pytest
import serial

from firmware_py.system.serial_port import SerialPort
from hil.devices import pty_line
from hil.devices.pty_line import PtyLine
from hil.errors import UsageError


@pytest.fixture
def line(tmp_path):
    with contextlib.closing(PtyLine(tmp_path / "compass")) as line:
        yield line


@contextlib.contextmanager
def opened(path):
    """Open the port by its path, as the firmware does."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


@pytest.fixture
def peer(line, tmp_path):
    with opened(tmp_path / "compass") as descriptor:
        yield descriptor


def test_all_byte_values_are_transferred_without_echo(line, peer):
    data = bytes(range(256)) * 2
    assert line.deliver(data)
    assert os.read(peer, 4096) == data
    os.write(peer, data)
    assert line.read_until_total(512) == data
    assert (line.total_read, line.total_written, line.overrun_bytes) == (512, 512, 0)
    assert line.read() == b""


def test_deliver_waits_for_the_bytes(line, peer):
    sizes = random.Random(1)
    for turn in range(2000):
        data = bytes([turn % 256]) * sizes.randint(1, 40)
        assert line.deliver(data)
        assert os.read(peer, 4096) == data


def test_wait_for_posted_waits_for_all_posts(line, peer):
    for posts in [1, 2, 0, 3] * 500:
        for _ in range(posts):
            assert line.post(b"12345")
        assert line.wait_for_posted()
        assert line.pending_at_slave() == 5 * posts
        if posts:
            assert os.read(peer, 4096) == b"12345" * posts
    assert line.post(b"12345")
    line.unplug()
    assert line.wait_for_posted()  # unplugging discards the bytes


def test_read_until_total_returns_no_further_bytes(line, peer):
    for turn in range(2_000):
        os.write(peer, bytes([turn % 256]) * 7)
        assert line.read_until_total(7 * (turn + 1)) == bytes([turn % 256]) * 7
    os.write(peer, b"abcdef")
    assert line.read_until_total(7 * 2000 + 2) == b"ab"
    assert line.read_until_total(7 * 2000 + 6) == b"cdef"


def test_read_until_total_returns_after_the_timeout(line, peer):
    os.write(peer, b"abc")
    assert line.read_until_total(9, timeout_s=0.05) == b"abc"
    assert line.total_read == 3


def test_read_waits_for_a_late_writer(line, peer):
    writer = threading.Timer(0.02, os.write, (peer, b"late"))
    writer.start()
    assert line.read_until_total(4) == b"late"
    writer.join()


def test_unread_bytes_are_counted(line):
    for count in range(1, 11):
        assert line.deliver(b"1234567")
        assert line.pending_at_slave() == 7 * count


def test_overrun_drops_the_newest_bytes(line, peer):
    assert line.deliver(b"a" * 4000)
    assert not line.deliver(b"b" * 1000, timeout_s=0.05)
    assert line.overrun_bytes == 905
    assert line.write(b"c" * 100) in range(96)
    assert os.read(peer, 9000)[:4000] == b"a" * 4000


def test_pyserial_opens_the_port_exclusively_and_raw(line, tmp_path):
    with serial.Serial(str(tmp_path / "compass"), 38400, timeout=1, exclusive=True) as port:
        assert line.deliver(b"\x03\x04\x11\x13\x7f\r\n")
        assert port.read(7) == b"\x03\x04\x11\x13\x7f\r\n"
        port.write(b"\x00\n\r\xff")
        assert line.read_until_total(4) == b"\x00\n\r\xff"


def test_port_is_released_after_the_firmware_was_killed(line, tmp_path):
    def is_exclusive():
        return any(fcntl.ioctl(line._slave, pty_line._TIOCGEXCL, bytes(4)))

    firmware = SerialPort(str(tmp_path / "compass"), 38400)
    firmware.open()
    line.release_exclusive_use()
    assert is_exclusive()
    fcntl.flock(firmware._fd, fcntl.LOCK_UN)  # as at the end of its process
    line.release_exclusive_use()
    assert not is_exclusive()
    firmware.close()


def test_unplugged_line_hangs_up_and_sends_nothing(line, tmp_path):
    path = tmp_path / "compass"
    with opened(path) as peer:
        line.unplug()
        assert not os.path.lexists(path)
        with pytest.raises(OSError):
            os.write(peer, b"x")
        assert (line.is_plugged, line.fileno(), line.pending_at_slave()) == (False, -1, 0)
        assert (line.read(), line.write(b"x"), line.deliver(b"x")) == (b"", 0, False)
        assert line.read_until_total(5) == b""
        line.unplug()


def test_line_plugged_in_again_is_empty(line, tmp_path):
    path = tmp_path / "compass"
    with opened(path) as peer:
        os.write(peer, b"abc")
        assert line.deliver(b"xyz")
        line.read_until_total(3)
        line.unplug()
        line.plug()
        assert (line.total_read, line.total_written) == (0, 0)
        with opened(path) as second:
            assert line.deliver(b"new")
            assert os.read(second, 100) == b"new"
            os.write(second, b"back")
            assert line.read_until_total(4) == b"back"
        line.plug()
        assert os.path.lexists(path)


def test_port_stays_open_when_the_firmware_restarts(line, tmp_path):
    for word in (b"one", b"two"):
        with opened(tmp_path / "compass") as peer:
            os.write(peer, word)
        assert line.read_until_total(line.total_read + 3) == word


def test_stale_link_is_replaced_and_other_file_is_kept(tmp_path):
    (tmp_path / "stale").symlink_to("/missing")
    with contextlib.closing(PtyLine(tmp_path / "stale")) as line, opened(tmp_path / "stale"):
        assert line.is_plugged
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FileExistsError):
        PtyLine(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_missing_pseudo_terminals_are_named_with_the_remedy(tmp_path, monkeypatch):
    def fail():
        raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr("os.openpty", fail)
    with pytest.raises(UsageError, match=r"no pseudo-terminal: No such device; mount /dev/pts"):
        PtyLine(tmp_path / "compass")
