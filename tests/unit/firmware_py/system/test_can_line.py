"""Lines of a CAN bus: an interface of the kernel, and an adapter by python-can with its virtual bus as the far end."""

import math
import socket
import sys
from types import SimpleNamespace

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame

from firmware_py.assemble.devices import create_line, share_line
from firmware_py.devices import SECTIONS
from firmware_py.system import can_line as module
from firmware_py.system.can_line import CanAdapterLine, CanLine, can_line
from firmware_py.system.serial_port import PortError
from hil.devices import nmea2000_frames as n2k

HEADING_PGN, GNSS_POSITION_PGN = 127250, 129029
# Priority 2, HEADING_PGN, source 0x23.
HEADING = can.Message(arbitration_id=0x09F11223, data=bytes(range(8)), is_extended_id=True)


def without_padding(frame):
    return frame[:5] + frame[8:]  # newer kernels have a second length there


class Sockets:
    """In place of the module socket: a CAN interface can0 whose far end is `far`."""

    AF_CAN, SOCK_RAW, SOCK_NONBLOCK, CAN_RAW = 29, 3, 0o4000, 1

    def __init__(self):
        self.far = None
        self.arguments = ()
        self.error = None

    def socket(self, *arguments):
        self.arguments = arguments
        if self.error:
            raise self.error
        near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        near.setblocking(False)
        return SimpleNamespace(bind=self.bind, recv=near.recv, fileno=near.fileno, close=near.close)

    def bind(self, address):
        if address != ("can0",):
            raise OSError(19, "No such device")


@pytest.fixture
def sockets(monkeypatch):
    sockets = Sockets()
    monkeypatch.setattr(module, "socket", sockets)
    yield sockets
    if sockets.far is not None:
        sockets.far.close()


def test_complete_frames_of_the_kernel_are_read(sockets):
    line = can_line("can:can0")
    assert (line.connected, line.read(), line.fileno()) == (False, b"", -1)
    line.open()
    assert sockets.arguments == (Sockets.AF_CAN, Sockets.SOCK_RAW | Sockets.SOCK_NONBLOCK, Sockets.CAN_RAW)
    assert (line.connected, line.openings, line.read()) == (True, 1, b"")
    assert line.fileno() >= 0
    frame = build_can_frame(HEADING)
    sockets.far.send(frame)
    sockets.far.send(frame[:8])  # not a frame
    sockets.far.send(frame)
    assert line.read() == frame * 2
    assert line.write(b"x") is False
    line.close()
    assert not line.connected


def test_number_of_frames_of_a_read_is_limited(sockets):
    line = CanLine("can:can0")
    line.open()
    sockets.far.setblocking(False)
    sent = 0
    try:
        while True:
            sockets.far.send(build_can_frame(HEADING))
            sent += 1
    except BlockingIOError:
        pass
    assert sent > 256
    assert len(line.read()) == 256 * 16
    assert len(line.read()) == min(sent - 256, 256) * 16
    line.close()


def test_interface_that_fails_is_opened_again(sockets):
    line = CanLine("can:can0")
    line.open()
    sockets.far.close()
    line.read()  # the end of the stream is no frame
    line._socket.recv = lambda _size: (_ for _ in ()).throw(OSError(100, "Network is down"))
    assert line.read() == b""
    assert not line.connected
    line.reopen(1.0)
    assert (line.connected, line.openings) == (True, 2)
    line.close()


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [("can:can9", None, "port can:can9: no such device; start it with ip link set NAME up type can bitrate 250000"),
     ("can:can0", OSError(97, "Address family not supported by protocol"),
      "port can:can0: address family not supported by protocol; load the kernel modules can and can_raw")],
)  # fmt: skip
def test_interface_that_cannot_be_opened_is_an_error_with_the_remedy(sockets, name, error, text):
    sockets.error = error
    with pytest.raises(PortError) as raised:
        CanLine(name).open()
    assert str(raised.value) == text


def test_port_name_selects_an_interface_of_the_kernel_or_an_adapter():
    assert isinstance(create_line("can:can0", 38400), CanLine)
    line = create_line("can:virtual:bus", 38400)
    assert (type(line), line.name) == (CanAdapterLine, "can:virtual:bus")


def test_classic_frames_of_an_adapter_have_the_format_of_the_kernel():
    line = CanAdapterLine("can:virtual:rambler")
    line.open()
    with can.Bus(interface="virtual", channel="rambler") as far:
        remote = can.Message(arbitration_id=0x09F11223, is_remote_frame=True, dlc=8)
        short = can.Message(arbitration_id=0x123, data=b"\x01", is_extended_id=False)
        flexible = can.Message(arbitration_id=0x123, data=bytes(12), is_fd=True)
        flexible_short = can.Message(arbitration_id=0x123, data=bytes(8), is_fd=True)
        error = can.Message(arbitration_id=0x4, is_error_frame=True, is_extended_id=False)
        for message in (HEADING, remote, flexible, flexible_short, short, error):
            far.send(message)
        frames = line.read()
    assert without_padding(frames[:16]) == without_padding(build_can_frame(HEADING))
    assert int.from_bytes(frames[16:20], "little") == 0x09F11223 | socket.CAN_EFF_FLAG | socket.CAN_RTR_FLAG
    assert without_padding(frames[32:48]) == without_padding(build_can_frame(short))
    assert int.from_bytes(frames[48:52], "little") == 4 | socket.CAN_ERR_FLAG
    assert (line.connected, line.openings, line.fileno(), line.write(b"x"), line.read()) == (True, 1, -1, False, b"")
    line.close()
    assert (line.connected, line.read()) == (False, b"")


def test_compass_and_position_share_an_adapter_without_transmitting():
    line = create_line("can:virtual:bus", 38400)
    line.open()
    views = share_line(line, 2)
    devices = [SECTIONS[section]["nmea2000"] for section in ("compass", "position")]
    compass, position = (driver.make(view, driver.options()) for driver, view in zip(devices, views, strict=True))
    with can.Bus(interface="virtual", channel="bus") as far:
        frames = [(HEADING_PGN, frame) for frame in (n2k.heading(1.0, n2k.TRUE),)]
        frames += [(GNSS_POSITION_PGN, frame) for frame in n2k.frames(n2k.gnss_position(50.0, -3.0, 1.6e9), 2)]
        for pgn, frame in frames:
            far.send(can.Message(arbitration_id=n2k.identifier(pgn, 0x23), data=frame, is_extended_id=True))
        compass.receive(1.0)
        position.receive(1.0)
        assert far.recv(0.0) is None  # nothing was transmitted
    assert [sample.heading_rad for sample in compass.poll()] == [1.0]
    assert [round(math.degrees(fix.latitude_rad), 9) for fix in position.poll()] == [50.0]
    line.close()


def test_adapter_that_fails_is_opened_again():
    line = CanAdapterLine("can:virtual:rambler")
    line.open()
    line._bus.shutdown()  # the next read raises an error of python-can
    assert line.read() == b""
    assert not line.connected
    line.reopen(1.0)
    assert (line.connected, line.openings) == (True, 2)
    line.reopen(9.0)
    assert line.openings == 2
    line.close()


def test_adapter_without_a_descriptor_has_minus_one():
    line, closed, waits_s = CanAdapterLine("can:slcan:/dev/ttyACM0"), [], []
    assert line.fileno() == -1
    line._bus = SimpleNamespace(recv=lambda wait_s: waits_s.append(wait_s) or HEADING)
    assert (len(line.read()), line.fileno()) == (256 * 16, -1)
    assert waits_s == [0.0] * 256
    line._bus = SimpleNamespace(fileno=lambda: 5, shutdown=lambda: closed.append(True))
    assert line.fileno() == 5
    line.close()
    assert (line.fileno(), closed) == (-1, [True])


def test_adapter_that_cannot_be_opened_is_an_error_with_the_remedy():
    line = CanAdapterLine("can:nonsense:0")
    with pytest.raises(PortError, match=r"port can:nonsense:0: .*; plug the adapter in, or write can:INTERFACE"):
        line.open()
    line.reopen(1.0)
    assert not line.connected


def test_reason_of_an_adapter_is_a_short_text_without_error_numbers(monkeypatch):
    text = "could not open port /dev/serial/usb-0:1.2:1.0: {}No such file or directory"

    def fail(**options):
        assert options == {"interface": "slcan", "channel": "/dev/serial/usb-0:1.2:1.0", "bitrate": 250_000}
        raise OSError("[Errno 2] " + text.format("[Errno 2] ") + ": " + 80 * "x")

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(PortError) as raised:
        CanAdapterLine("can:slcan:/dev/serial/usb-0:1.2:1.0").open()
    reason = (text.format("") + ": " + 80 * "x")[:80]
    assert str(raised.value).startswith(f"port can:slcan:/dev/serial/usb-0:1.2:1.0: {reason}; plug the adapter in")


def test_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(PortError, match=r"needs python-can; install rambler-autopilot\[can\]"):
        CanAdapterLine("can:virtual:rambler").open()
