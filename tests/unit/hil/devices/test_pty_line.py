import contextlib
import fcntl
import os
import random
import threading

import pytest
import serial

from firmware_py.system.serial_port import SerialPort
from hil.devices import pty_line
from hil.devices.pty_line import PtyLine


@pytest.fixture
def line(tmp_path):
    with contextlib.closing(PtyLine(tmp_path / "compass")) as made:
        yield made


@contextlib.contextmanager
def opened(line, path):
    """Open the port as any program would: nothing but the path is known."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def test_all_byte_values_without_echo(line, tmp_path):
    every = bytes(range(256)) * 2
    with opened(line, tmp_path / "compass") as peer:
        assert line.deliver(every)
        assert os.read(peer, 4096) == every
        os.write(peer, every)
        assert line.read_until_total(512) == every
        assert (line.total_read, line.total_written, line.overrun_bytes) == (512, 512, 0)
        assert line.read() == b""


def test_deliver_waits_for_the_bytes(line, tmp_path):
    sizes = random.Random(1)
    with opened(line, tmp_path / "compass") as peer:
        for turn in range(2000):
            data = bytes([turn % 256]) * sizes.randint(1, 40)
            assert line.deliver(data)
            assert os.read(peer, 4096) == data


def test_arrived_waits_for_posted_bytes(line, tmp_path):
    with opened(line, tmp_path / "compass") as peer:
        for posts in [1, 2, 0, 3] * 500:
            for _ in range(posts):
                assert line.post(b"12345")
            assert line.arrived()
            assert line.pending_at_slave() == 5 * posts
            if posts:
                assert os.read(peer, 4096) == b"12345" * posts
        assert line.post(b"12345")
    line.unplug()
    assert line.arrived()  # with the cable went what was under way


def test_read_until_total(line, tmp_path):
    with opened(line, tmp_path / "compass") as peer:
        for turn in range(2_000):
            os.write(peer, bytes([turn % 256]) * 7)
            assert line.read_until_total(7 * (turn + 1)) == bytes([turn % 256]) * 7
        os.write(peer, b"abcdef")
        assert line.read_until_total(7 * 2000 + 2) == b"ab"
        assert line.read_until_total(7 * 2000 + 6) == b"cdef"


def test_read_until_total_timeout(line, tmp_path):
    with opened(line, tmp_path / "compass") as peer:
        os.write(peer, b"abc")
        assert line.read_until_total(9, timeout_s=0.05) == b"abc"
        assert line.total_read == 3


def test_read_waits_for_a_late_writer(line, tmp_path):
    with opened(line, tmp_path / "compass") as peer:
        writer = threading.Timer(0.02, os.write, (peer, b"late"))
        writer.start()
        assert line.read_until_total(4) == b"late"
        writer.join()


def test_unread_deliveries_add_up(line):
    for count in range(1, 11):
        assert line.deliver(b"1234567")
        assert line.pending_at_slave() == 7 * count


def test_overrun_drops_the_newest(line, tmp_path):
    with opened(line, tmp_path / "compass") as peer:
        assert line.deliver(b"a" * 4000)
        assert not line.deliver(b"b" * 1000, timeout_s=0.05)
        assert line.overrun_bytes == 905
        assert line.write(b"c" * 100) in range(96)
        assert os.read(peer, 9000)[:4000] == b"a" * 4000


def test_pyserial_opens_it_exclusively_and_raw(line, tmp_path):
    with serial.Serial(str(tmp_path / "compass"), 38400, timeout=1, exclusive=True) as port:
        assert line.deliver(b"\x03\x04\x11\x13\x7f\r\n")
        assert port.read(7) == b"\x03\x04\x11\x13\x7f\r\n"
        port.write(b"\x00\n\r\xff")
        assert line.read_until_total(4) == b"\x00\n\r\xff"


def test_port_is_released_after_the_firmware_was_killed(line, tmp_path):
    """As the slave stays open here, the kernel keeps the exclusive use of one that has not closed the port."""

    def exclusive():
        return any(fcntl.ioctl(line._slave, pty_line._TIOCGEXCL, bytes(4)))

    firmware = SerialPort(str(tmp_path / "compass"), 38400)
    firmware.open()
    line.free()
    assert exclusive()
    fcntl.flock(firmware._fd, fcntl.LOCK_UN)  # as at the end of its process
    line.free()
    assert not exclusive()
    firmware.close()


def test_unplug(line, tmp_path):
    path = tmp_path / "compass"
    with opened(line, path) as peer:
        line.unplug()
        assert not os.path.lexists(path)
        with pytest.raises(OSError):
            os.write(peer, b"x")
        assert (line.plugged, line.fileno(), line.pending_at_slave()) == (False, -1, 0)
        assert (line.read(), line.write(b"x"), line.deliver(b"x")) == (b"", 0, False)
        assert line.read_until_total(5) == b""
        line.unplug()


def test_plug_again(line, tmp_path):
    path = tmp_path / "compass"
    with opened(line, path) as peer:
        os.write(peer, b"abc")
        assert line.deliver(b"xyz")
        line.read_until_total(3)
        line.unplug()
        line.plug()
        assert (line.total_read, line.total_written) == (0, 0)
        with opened(line, path) as second:
            assert line.deliver(b"new")
            assert os.read(second, 100) == b"new"
            os.write(second, b"back")
            assert line.read_until_total(4) == b"back"
        line.plug()
        assert os.path.lexists(path)


def test_no_hang_up_on_restart(line, tmp_path):
    for word in (b"one", b"two"):
        with opened(line, tmp_path / "compass") as peer:
            os.write(peer, word)
        assert line.read_until_total(line.total_read + 3) == word


def test_stale_link_and_existing_file(tmp_path):
    (tmp_path / "stale").symlink_to("/nowhere/at/all")
    with contextlib.closing(PtyLine(tmp_path / "stale")) as line, opened(line, tmp_path / "stale"):
        assert line.plugged
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FileExistsError):
        PtyLine(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"
