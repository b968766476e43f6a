"""Serial ports on pseudo-terminals: reading, writing, reopening, and other programs."""

import errno
import fcntl
import os
import pty
import select
import subprocess
import sys
import termios
from pathlib import Path

import pytest
import serial

from firmware_py.system.port_users import find_port_users
from firmware_py.system.serial_port import PortError, SerialPort

MAX_EMPTY_READS = 16
MAX_UNSENT_BYTES = 4096


class Cable:
    """A pseudo-terminal behind a path that can be unplugged and plugged in."""

    def __init__(self, path):
        self.path = path
        self.plug()

    def plug(self):
        self.master, self.slave = pty.openpty()
        self.path.symlink_to(os.ttyname(self.slave))
        os.set_blocking(self.master, False)

    def unplug(self):
        os.close(self.master)
        os.close(self.slave)
        self.path.unlink()


@pytest.fixture
def cable(tmp_path):
    plugged = Cable(tmp_path / "port")
    yield plugged
    if plugged.path.exists():
        plugged.unplug()


@pytest.fixture
def line(cable):
    port = SerialPort(str(cable.path), 38400)
    port.open()
    yield port
    port.close()


@pytest.fixture
def impatient_line(cable):
    port = SerialPort(str(cable.path), 38400, silent_s=10.0)
    port.open()
    yield port
    port.close()


def read_all(line, count):
    """Read until `count` bytes have arrived."""
    data = b""
    while len(data) < count:
        assert is_readable(line, 10.0)
        data += line.read()
    return data


def is_readable(line, timeout_s=0.0):
    return select.select([line.fileno()], [], [], timeout_s)[0] == [line.fileno()]


def read_and_reopen(line, count):
    for number in range(count):
        line.read()
        line.reopen(10.0 + number)


def test_all_bytes_pass_unchanged_in_both_directions(line, cable):
    data = bytes(range(256))
    os.write(cable.master, data)
    assert read_all(line, 256) == data
    assert line.read() == b""
    assert line.write(data)
    assert line.written == 256
    os.set_blocking(cable.master, True)
    assert os.read(cable.master, 256) == data


def test_the_descriptor_is_readable_until_the_bytes_are_read(line, cable):
    assert not is_readable(line)
    os.write(cable.master, b"wake")
    assert is_readable(line, 60.0)
    assert is_readable(line, 60.0)
    assert line.read() == b"wake"
    assert not is_readable(line)


def test_an_unplugged_cable_makes_the_descriptor_readable_and_is_detected(line, cable):
    cable.unplug()
    assert is_readable(line, 60.0)
    assert line.read() == b""
    assert not line.connected


def test_an_empty_terminal_is_neither_polled_nor_read(line, cable, monkeypatch):
    """Both can block in the kernel."""
    assert not os.isatty(line.fileno())
    reads = []
    monkeypatch.setattr(os, "read", lambda *args, read=os.read: reads.append(args) or read(*args))
    assert line.read() == b""
    assert not reads
    os.write(cable.master, b"now")
    assert read_all(line, 3) == b"now"
    assert [count for _, count in reads] == [4096]


def test_the_device_is_looked_up_after_sixteen_empty_reads(line, monkeypatch):
    checks = []
    monkeypatch.setattr(termios, "tcgetattr", checks.append)
    counts = [(line.read(), len(checks))[1] for _ in range(33)]
    assert counts == [0] * 15 + [1] * 16 + [2] * 2
    assert line.connected


def test_a_port_without_epoll_is_an_error_and_is_closed(cable, monkeypatch):
    def fail():
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    port = SerialPort(str(cable.path), 38400)
    with monkeypatch.context() as patches:
        patches.setattr(select, "epoll", fail)
        with pytest.raises(PortError, match="Too many open files"):
            port.open()
        assert not port.connected
    port.open()
    port.close()


def test_a_port_that_reappears_is_opened_again(line, cable):
    cable.unplug()
    assert [line.read() for _ in range(MAX_EMPTY_READS)] == [b""] * MAX_EMPTY_READS
    assert (line.connected, line.fileno(), line.write(b"x")) == (False, -1, False)
    line.reopen(10.0)
    assert not line.connected
    cable.plug()
    line.reopen(10.9)  # less than a second after the last attempt
    assert not line.connected
    line.reopen(11.0)
    assert (line.connected, line.openings, line.written) == (True, 2, 0)
    os.write(cable.master, b"again")
    assert read_all(line, 5) == b"again"


def test_a_port_that_reappears_before_the_next_check_is_opened_again(line, cable):
    """The closed terminal reads as empty, and the path exists."""
    cable.unplug()
    line.read()
    cable.plug()
    read_and_reopen(line, 10 * MAX_EMPTY_READS)
    assert line.openings == 2
    os.write(cable.master, b"again")
    assert read_all(line, 5) == b"again"


def test_a_path_that_leads_to_another_device_is_opened_again(line, cable, tmp_path):
    other = Cable(tmp_path / "other")
    other.path.replace(cable.path)
    read_and_reopen(line, 2 * MAX_EMPTY_READS)
    assert line.openings == 2
    os.write(other.master, b"here")
    assert read_all(line, 4) == b"here"


def test_a_port_that_is_missing_at_the_start_is_opened_by_the_first_attempt(cable, monkeypatch):
    latency_modes = []
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _port, is_low: latency_modes.append(is_low))
    port = SerialPort(str(cable.path), 38400)
    assert (port.connected, port.openings, port.written, port.fileno()) == (False, 0, 0, -1)
    port.reopen(0.0)
    assert (port.name, port.baud, port.connected, port.openings) == (str(cable.path), 38400, True, 1)
    assert latency_modes == [True]
    port.close()


def test_a_silent_line_without_a_limit_is_not_opened_again(line):
    read_and_reopen(line, 10 * MAX_EMPTY_READS)
    assert line.openings == 1


def change_settings(cable):
    """Change the settings as getty and stty do; return the former settings."""
    descriptor = os.open(cable.path, os.O_RDWR | os.O_NOCTTY)
    settings = termios.tcgetattr(descriptor)
    cooked = [settings[0] | termios.ICRNL | termios.IXON, settings[1] | termios.OPOST, settings[2],
              settings[3] | termios.ICANON | termios.ECHO, termios.B9600, termios.B9600, settings[6]]  # fmt: skip
    termios.tcsetattr(descriptor, termios.TCSANOW, cooked)
    assert termios.tcgetattr(descriptor) != settings
    os.close(descriptor)
    return settings


def test_settings_changed_by_another_program_are_restored_and_reported_every_ten_minutes(line, cable):
    assert line.reopen(10.0) == ""
    settings, port = change_settings(cable), line._port
    os.write(cable.master, b"no line end")
    assert line.reopen(10.5) == ""  # less than a second after the last check
    assert line.reopen(11.0) == f"Port {cable.path}: changed by another program, restored"
    assert termios.tcgetattr(cable.slave) == settings
    assert (line.openings, line._port) == (1, port)
    assert read_all(line, 11) == b"no line end"
    change_settings(cable)
    assert line.reopen(610.0) == ""
    assert termios.tcgetattr(cable.slave) == settings
    change_settings(cable)
    assert line.reopen(611.0)


def test_a_port_whose_settings_cannot_be_restored_is_opened_again(line, cable, monkeypatch):
    line.reopen(10.0)
    settings, tcsetattr, calls = change_settings(cable), termios.tcsetattr, []

    def fail_once(*arguments):
        calls.append(arguments)
        if len(calls) > 1:
            tcsetattr(*arguments)

    with monkeypatch.context() as patches:
        patches.setattr(termios, "tcsetattr", fail_once)
        assert line.reopen(11.0)
    assert termios.tcgetattr(cable.slave) == settings
    assert (line.connected, line.openings) == (True, 1)


def test_a_silent_port_is_opened_again_after_increasing_times(impatient_line, cable):
    line, opened_at_s = impatient_line, []

    def reopen_until(begin_s, end_s):
        for now_s in range(begin_s, end_s):
            port = line._port
            line.reopen(float(now_s))
            opened_at_s.extend([now_s] if line._port is not port else [])

    line.write(b"ask")
    reopen_until(0, 100)
    assert opened_at_s == [10, 30, 70]
    assert (line.openings, line.written) == (1, 3)
    os.write(cable.master, b"here")
    assert read_all(line, 4) == b"here"
    reopen_until(100, 112)
    assert opened_at_s == [10, 30, 70, 110]


def test_a_silent_port_is_opened_again_at_least_every_five_minutes(cable):
    line, opened_at_s = SerialPort(str(cable.path), 38400, silent_s=200.0), []
    line.open()
    for now_s in range(900):
        port = line._port
        line.reopen(float(now_s))
        opened_at_s.extend([now_s] if line._port is not port else [])
    assert opened_at_s == [200, 500, 800]
    line.close()


def test_a_silent_port_that_disappears_is_a_new_line_afterwards(impatient_line, cable):
    line = impatient_line
    line.reopen(0.0)
    cable.path.unlink()
    line.reopen(10.0)
    assert not line.connected
    cable.path.symlink_to(os.ttyname(cable.slave))
    line.reopen(11.0)
    assert (line.connected, line.openings) == (True, 2)


OPEN_PORT = """
import os, sys
if os.geteuid() == 0 and sys.argv[2] == "user":
    os.setuid(65534)  # TIOCEXCL does not exclude root
try:
    descriptor = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    print("opened", flush=True)
    sys.stdin.read()
except OSError as error:
    print(error.errno, flush=True)
"""


def start_other_program(cable, user):
    terminal = os.ttyname(cable.slave)
    Path(terminal).chmod(0o666)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", OPEN_PORT, terminal, user], **pipes)


def test_programs_of_other_users_cannot_open_the_port(line, cable):
    line.reopen(0.0)
    fcntl.ioctl(cable.slave, termios.TIOCNXCL)
    line.reopen(10.0)  # restores the exclusive access
    with start_other_program(cable, "user") as other:
        assert other.stdout.readline() == f"{errno.EBUSY}\n"
    line.close()
    with start_other_program(cable, "user") as other:
        assert other.stdout.readline() == "opened\n"


def test_other_users_of_a_port_are_listed(line, cable):
    assert find_port_users([str(cable.path)]) == {}
    with (cable.path.parent / "file").open("w") as file:
        assert find_port_users([file.name]) == {}  # of this program
    line.close()
    with start_other_program(cable, "root") as other:
        assert other.stdout.readline() == "opened\n"
        line.open()
        users = f"{Path(f'/proc/{other.pid}/comm').read_text().strip()} (process {other.pid})"
        assert find_port_users(["/dev/none", str(cable.path)]) == {str(cable.path): users}
        line.reopen(10.0)
        change_settings(cable)
        assert line.reopen(11.0).endswith(f"changed by another program, restored; open in {users}")
    assert find_port_users([str(cable.path)]) == {}


def test_a_full_line_refuses_whole_messages_and_keeps_their_order(line, cable):
    sent, number = b"", 0
    while line.write(message := b"%06d." % number):
        sent += message
        number += 1
        assert len(sent) < 100_000
    assert 0 < len(line._unsent) <= MAX_UNSENT_BYTES
    os.set_blocking(cable.master, True)
    received = os.read(cable.master, 4096)
    while line.write(b"") and line._unsent:
        received += os.read(cable.master, 4096)
    while len(received) < len(sent):
        received += os.read(cable.master, 4096)
    assert received == sent


def test_bytes_that_the_kernel_does_not_accept_are_kept_up_to_4096(line, monkeypatch):
    def refuse(*_arguments):
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    with monkeypatch.context() as patches:
        patches.setattr(os, "write", refuse)
        assert not line.write(bytes(4097))
        assert line.write(bytes(4000))
        assert not line.write(bytes(97))
        assert line.write(bytes(96))
        assert not line.write(b"x")
        assert (line.connected, line.written) == (True, 0)
    assert line.write(b"")
    assert 0 < line.written == 4096 - len(line._unsent)


def test_a_full_line_recovers_also_for_a_large_message(line, cable):
    while line.write(b"x" * 1200):
        pass
    assert len(line._unsent) + 1200 > MAX_UNSENT_BYTES
    os.set_blocking(cable.master, False)
    for _ in range(1000):
        try:
            os.read(cable.master, 65536)
        except BlockingIOError:
            break
    assert line.write(b"y" * 1200)


@pytest.mark.parametrize(
    ("name", "reason"), [("none", "no such port"), ("port", "in use by another program"), ("file", "serial port")]
)
def test_a_port_that_cannot_be_opened_is_an_error_with_the_reason(line, tmp_path, name, reason):
    (tmp_path / "file").write_text("")
    with pytest.raises(PortError, match=reason):
        SerialPort(str(tmp_path / name), 9600).open()


@pytest.mark.parametrize(
    ("error", "name", "reason"),
    [
        (serial.SerialException(errno.EBUSY, "busy"), "port", "in use by another program"),
        (serial.SerialException("Could not exclusively lock port"), "port", "in use by another program"),
        (serial.SerialException(errno.ENOENT, "gone"), "port", "no such port"),
        (serial.SerialException(errno.EIO, "gone"), "none", "no such port"),
        (serial.SerialException(errno.EACCES, "no"), "port", "permission denied; add the user to the dialout group"),
        (OSError(errno.EPERM, "no"), "port", "permission denied; add the user to the dialout group"),
        (ValueError("x" * 81 + "\ny"), "port", f"cannot be opened as a serial port: {'x' * 80}$"),
    ],
)
def test_each_error_of_a_port_has_its_reason(cable, monkeypatch, error, name, reason):
    def fail(*_arguments, **_options):
        raise error

    monkeypatch.setattr(serial, "Serial", fail)
    port = SerialPort(str(cable.path.with_name(name)), 9600)
    with pytest.raises(PortError, match=reason):
        port.open()
    assert port.reopen(1.0) == ""
    assert not port.connected
