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

from firmware_py.system.port_users import port_users
from firmware_py.system.serial_port import MAX_EMPTY_READS, MAX_UNSENT_BYTES, PortError, SerialPort


class Cable:
    """A pty behind a path that can be pulled and put back."""

    def __init__(self, path):
        self.path = path
        self.master = -1
        self.plug()

    def plug(self):
        self.master, slave = pty.openpty()
        self.path.symlink_to(os.ttyname(slave))
        os.set_blocking(self.master, False)
        self._slave = slave

    def pull(self):
        os.close(self.master)
        os.close(self._slave)
        self.path.unlink()


@pytest.fixture
def cable(tmp_path):
    made = Cable(tmp_path / "port")
    yield made
    if made.path.exists():
        made.pull()


@pytest.fixture
def line(cable):
    made = SerialPort(str(cable.path), 38400)
    made.open()
    yield made
    made.close()


def read_all(line, count):
    """Read until count bytes are there; the kernel hands them over in its own time."""
    data = b""
    while len(data) < count:
        data += line.read()
    return data


def test_bytes_go_both_ways_untouched(line, cable):
    every = bytes(range(256))
    os.write(cable.master, every)
    assert read_all(line, 256) == every
    assert line.read() == b""
    assert line.write(every)
    assert line.written == 256
    os.set_blocking(cable.master, True)
    assert os.read(cable.master, 256) == every


def test_bytes_that_are_there_wake_until_they_are_read(line, cable):
    assert select.select([line.fileno()], [], [], 0.0)[0] == []
    os.write(cable.master, b"wake")
    assert select.select([line.fileno()], [], [], 60.0)[0] == [line.fileno()]
    assert select.select([line.fileno()], [], [], 60.0)[0] == [line.fileno()]
    assert line.read() == b"wake"
    assert select.select([line.fileno()], [], [], 0.0)[0] == []


def test_an_unplugged_cable_wakes_and_is_detected_at_once(line, cable):
    cable.pull()
    assert select.select([line.fileno()], [], [], 60.0)[0] == [line.fileno()]
    assert line.read() == b""
    assert not line.connected


def test_an_empty_terminal_is_neither_polled_nor_read(line, cable, monkeypatch):
    """Either would wait inside the kernel, whatever the priority, for what a busy computer does when it likes."""
    assert not os.isatty(line.fileno())
    reads = []
    monkeypatch.setattr(os, "read", lambda *args, read=os.read: reads.append(args) or read(*args))
    assert line.read() == b""
    assert not reads
    os.write(cable.master, b"now")
    assert read_all(line, 3) == b"now"
    assert len(reads) == 1


def test_a_port_without_epoll_is_an_error_and_is_closed(cable, monkeypatch):
    def refused():
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    with monkeypatch.context() as patch:
        patch.setattr(select, "epoll", refused)
        made = SerialPort(str(cable.path), 38400)
        with pytest.raises(PortError, match="Too many open files"):
            made.open()
        assert not made.connected
    made.open()
    made.close()


def test_a_port_that_reappears_is_opened_again(line, cable):
    cable.pull()
    assert [line.read() for _ in range(MAX_EMPTY_READS)] == [b""] * MAX_EMPTY_READS
    assert not line.connected
    assert line.fileno() == -1
    assert not line.write(b"x")
    line.reopen(10.0)
    assert not line.connected
    cable.plug()
    line.reopen(10.5)  # within a second of the last try
    assert not line.connected
    line.reopen(11.1)
    assert line.connected
    assert line.openings == 2
    os.write(cable.master, b"again")
    assert read_all(line, 5) == b"again"


def test_a_port_that_reappears_before_the_next_check_is_opened_again(line, cable):
    """Of a line that is only read: the old terminal reads nothing for ever, beside a path that is there."""
    cable.pull()
    line.read()
    cable.plug()
    for number in range(10 * MAX_EMPTY_READS):
        line.read()
        line.reopen(10.0 + number)
    assert line.openings == 2
    os.write(cable.master, b"again")
    assert read_all(line, 5) == b"again"


def test_a_path_that_leads_elsewhere_is_followed(line, cable, tmp_path):
    """As when an adapter's name is given to another one while the first is still there."""
    other = Cable(tmp_path / "other")
    other.path.replace(cable.path)
    for number in range(2 * MAX_EMPTY_READS):
        line.read()
        line.reopen(10.0 + number)
    assert line.openings == 2
    os.write(other.master, b"here")
    assert read_all(line, 4) == b"here"


def test_a_line_that_is_silent_is_not_opened_again(line, cable):
    for number in range(10 * MAX_EMPTY_READS):
        line.read()
        line.reopen(10.0 + number)
    assert line.openings == 1


def set_as_a_terminal(cable, then=lambda descriptor: None):
    """What getty, stty and others do, on a descriptor of their own; return what the settings were."""
    descriptor = os.open(cable.path, os.O_RDWR | os.O_NOCTTY)
    try:
        before = termios.tcgetattr(descriptor)
        cooked = [before[0] | termios.ICRNL | termios.IXON, before[1] | termios.OPOST, before[2],
                  before[3] | termios.ICANON | termios.ECHO, termios.B9600, termios.B9600, before[6]]  # fmt: skip
        termios.tcsetattr(descriptor, termios.TCSANOW, cooked)
        assert termios.tcgetattr(descriptor) != before
        then(descriptor)
    finally:
        os.close(descriptor)
    return before


def test_settings_that_another_program_has_changed_are_restored_and_reported_once(line, cable):
    assert line.reopen(10.0) == ""
    before = set_as_a_terminal(cable)
    os.write(cable.master, b"no line end")
    assert line.reopen(10.5) == ""  # within a second of the last look
    assert line.reopen(11.0) == f"Port {cable.path}: changed by another program, restored"
    assert termios.tcgetattr(cable._slave) == before
    assert read_all(line, 11) == b"no line end"
    assert line.openings == 1
    set_as_a_terminal(cable)
    assert line.reopen(12.0) == ""  # reported a second ago
    assert termios.tcgetattr(cable._slave) == before
    set_as_a_terminal(cable)
    assert line.reopen(612.0)


def test_a_port_whose_settings_cannot_be_restored_is_opened_again(line, cable, monkeypatch):
    line.reopen(10.0)
    before = set_as_a_terminal(cable)
    tries = []
    with monkeypatch.context() as patch:
        patch.setattr(
            termios,
            "tcsetattr",
            lambda *words, real=termios.tcsetattr: tries.append(words) or (tries[1:] and real(*words)),
        )
        assert line.reopen(11.0)
    assert termios.tcgetattr(cable._slave) == before
    assert (line.connected, line.openings) == (True, 1)


def test_a_silent_port_is_opened_again_after_increasing_times(cable):
    line = SerialPort(str(cable.path), 38400, silent_s=10.0)
    line.open()
    line.write(b"ask")
    opened_at_s, descriptor = [], line._port
    for now_s in range(100):
        line.reopen(float(now_s))
        if line._port is not descriptor:
            descriptor = line._port
            opened_at_s.append(now_s)
    assert opened_at_s == [10, 30, 70]
    assert (line.openings, line.written) == (1, 3)
    os.write(cable.master, b"here")
    assert read_all(line, 4) == b"here"
    for now_s in range(100, 112):
        line.reopen(float(now_s))
        opened_at_s += [now_s] if line._port is not descriptor else []
        descriptor = line._port
    assert opened_at_s == [10, 30, 70, 110]
    line.close()


def test_a_silent_port_that_disappears_is_a_new_line_afterwards(cable):
    line = SerialPort(str(cable.path), 38400, silent_s=10.0)
    line.open()
    line.reopen(0.0)
    cable.path.unlink()
    line.reopen(10.0)
    assert not line.connected
    cable.path.symlink_to(os.ttyname(cable._slave))
    line.reopen(11.0)
    assert (line.connected, line.openings) == (True, 2)
    line.close()


OPENER = """
import os, sys
if os.geteuid() == 0 and sys.argv[2] == "user":
    os.setuid(65534)  # TIOCEXCL does not keep root out
try:
    descriptor = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    print("opened", flush=True)
    sys.stdin.read()
except OSError as error:
    print(error.errno, flush=True)
"""


def another_program(cable, who):
    terminal = os.ttyname(cable._slave)
    Path(terminal).chmod(0o666)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", OPENER, terminal, who], **pipes)


def test_other_programs_cannot_open_the_port(line, cable):
    with another_program(cable, "user") as other:
        assert other.stdout.readline() == f"{errno.EBUSY}\n"
    line.close()
    with another_program(cable, "user") as other:
        assert other.stdout.readline() == "opened\n"


def test_exclusive_access_is_restored(line, cable):
    line.reopen(0.0)
    fcntl.ioctl(cable._slave, termios.TIOCNXCL)
    line.reopen(10.0)
    with another_program(cable, "user") as other:
        assert other.stdout.readline() == f"{errno.EBUSY}\n"


def test_other_users_of_a_port_are_listed(line, cable):
    assert port_users([str(cable.path)]) == {}
    line.close()
    with another_program(cable, "root") as other:
        assert other.stdout.readline() == "opened\n"
        line.open()
        users = f"{port_name(other.pid)} (process {other.pid})"
        assert port_users(["/dev/none", str(cable.path)]) == {str(cable.path): users}
        line.reopen(10.0)
        set_as_a_terminal(cable)
        assert line.reopen(11.0).endswith(f"changed by another program, restored; open in {users}")
    assert port_users([str(cable.path)]) == {}


def port_name(process):
    return Path(f"/proc/{process}/comm").read_text().strip()


def test_a_line_that_takes_no_more_refuses_whole_messages_and_keeps_order(line, cable):
    sent = b""
    number = 0
    while line.write(message := b"%06d." % number):
        sent += message
        number += 1
        assert len(sent) < 10_000_000
    assert 0 < len(line._unsent) <= MAX_UNSENT_BYTES
    os.set_blocking(cable.master, True)
    received = os.read(cable.master, 4096)
    while line.write(b""):
        if not line._unsent:
            break
        received += os.read(cable.master, 4096)
    while len(received) < len(sent):
        received += os.read(cable.master, 4096)
    assert received == sent


def test_a_blocked_line_recovers(line, cable):
    """What waits is pushed by the next write, also by one that is too large to be added to it."""
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
    ("name", "text"), [("none", "no such port"), ("port", "in use by another program"), ("file", "serial port")]
)
def test_a_port_that_cannot_be_opened_is_an_error_with_a_remedy(line, tmp_path, name, text):
    (tmp_path / "file").write_text("")
    with pytest.raises(PortError, match=text):
        SerialPort(str(tmp_path / name), 9600).open()
